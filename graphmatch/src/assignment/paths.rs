use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::length::Length;
use super::state::{NONE, State};

/// The few entries of each row that are in play.
pub(super) trait Arcs {
    /// Columns and costs of a row's entries.
    fn of_row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_;

    /// Cost of an entry in play.
    fn cost(&self, row: usize, column: usize) -> f64;
}

/// Shortest alternating paths over few entries, with a heap; buffers stay from search to search.
pub(super) struct Paths {
    /// Length of the shortest path so far, +∞ where none was found.
    key: Vec<f64>,
    row_before: Vec<u32>,
    done: Vec<u32>,
    touched: Vec<u32>,
    /// Columns in `done`; rounding may make a second way to one look shorter.
    closed: Vec<bool>,
}

impl Paths {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            key: vec![f64::INFINITY; columns],
            row_before: vec![NONE; columns],
            done: Vec::new(),
            touched: Vec::new(),
            closed: vec![false; columns],
        }
    }

    /// Assigns the free row `start` along a shortest path, or says which rows cannot reach an idle column: those passed, and
    /// `start` last.
    pub(super) fn assign(
        &mut self,
        arcs: &impl Arcs,
        state: &mut State,
        start: usize,
    ) -> Result<(), Vec<usize>> {
        let end = self.shortest(arcs, state, start);
        if let Some(end) = end {
            let length = self.key[end];
            for &column in &self.done {
                state.v[column as usize] += self.key[column as usize] - length;
            }
            let before = &self.row_before;
            state.augment(start, end, |column| before[column] as usize);
        }
        let passed = self.done.iter().map(|&j| state.row_of_column[j as usize] as usize);
        let answer = if end.is_some() { Ok(()) } else { Err(passed.chain([start]).collect()) };
        for column in self.touched.drain(..) {
            self.key[column as usize] = f64::INFINITY;
            self.closed[column as usize] = false;
        }
        self.done.clear();
        answer
    }

    /// The idle column that a shortest path reaches; columns passed are in `done`, with their lengths in `key`.
    fn shortest(&mut self, arcs: &impl Arcs, state: &State, start: usize) -> Option<usize> {
        let mut heap = BinaryHeap::new();
        let (mut row, mut offset) = (start, 0.0);
        loop {
            for (j, cost) in arcs.of_row(row) {
                let length = cost - state.v[j] - offset;
                if length < self.key[j] && !self.closed[j] {
                    if self.key[j] == f64::INFINITY {
                        self.touched.push(j as u32);
                    }
                    self.key[j] = length;
                    self.row_before[j] = row as u32;
                    // Idle columns first among equals.
                    let busy = state.row_of_column[j] != NONE;
                    heap.push(Reverse((Length(length), busy, j as u32)));
                }
            }
            let (length, column) = loop {
                let Reverse((Length(length), _, column)) = heap.pop()?;
                if length <= self.key[column as usize] && !self.closed[column as usize] {
                    break (length, column as usize);
                }
            };
            if state.row_of_column[column] == NONE {
                return Some(column);
            }
            self.done.push(column as u32);
            self.closed[column] = true;
            row = state.row_of_column[column] as usize;
            offset = arcs.cost(row, column) - state.v[column] - length;
        }
    }
}

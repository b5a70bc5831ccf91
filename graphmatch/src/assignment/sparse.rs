use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::Assignment;
use super::length::Length;
use super::state::NONE;
use crate::Error;

/// Costs of the allowed pairs only, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SparseCosts {
    columns: usize,
    /// Entries of row `i` are `start[i]..start[i + 1]`.
    start: Vec<usize>,
    column: Vec<u32>,
    cost: Vec<f64>,
}

impl SparseCosts {
    /// From `rows[i]`, the allowed `(column, cost)` of row `i` in any order.
    ///
    /// # Errors
    /// A cost that is not finite, a column out of range; fewer columns than rows.
    pub fn new(columns: usize, rows: &[Vec<(usize, f64)>]) -> Result<Self, Error> {
        if rows.len() > columns {
            return Err(Error::WrongLength { what: "the rows", expected: columns, found: rows.len() });
        }
        let mut costs = Self { columns, start: vec![0], ..Self::default() };
        for (row, entries) in rows.iter().enumerate() {
            for &(column, value) in entries {
                if !value.is_finite() || column >= columns {
                    return Err(Error::BadCost { row, column, value });
                }
                costs.column.push(column as u32);
                costs.cost.push(value);
            }
            costs.start.push(costs.column.len());
        }
        Ok(costs)
    }

    fn rows(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let run = self.start[i]..self.start[i + 1];
        self.column[run.clone()].iter().map(|&j| j as usize).zip(self.cost[run].iter().copied())
    }
}

/// The assignment of least total cost over allowed pairs; every row gets a column.
///
/// # Errors
/// [`Error::Infeasible`] where no assignment of all rows exists.
///
/// Cost O(n (e + m) log m) at worst for e entries.
///
/// **Source**: Jonker, Volgenant, 1987 (sparse part), with a binary heap.
pub fn assign_sparse(costs: &SparseCosts) -> Result<Assignment, Error> {
    let mut search = Search {
        costs,
        v: vec![0.0; costs.columns],
        entry_of_row: vec![None; costs.rows()],
        row_of_column: vec![NONE; costs.columns],
        key: vec![f64::INFINITY; costs.columns],
        before: vec![NONE; costs.columns],
        closed: vec![false; costs.columns],
    };
    search.greedy();
    for row in 0..costs.rows() {
        if search.entry_of_row[row].is_none() {
            search.run(row)?;
        }
    }
    Ok(search.finish())
}

struct Search<'a> {
    costs: &'a SparseCosts,
    v: Vec<f64>,
    /// Column and cost of every assigned row.
    entry_of_row: Vec<Option<(usize, f64)>>,
    row_of_column: Vec<u32>,
    key: Vec<f64>,
    before: Vec<u32>,
    closed: Vec<bool>,
}

impl Search<'_> {
    /// Each row takes its cheapest column while all duals are 0, if it is idle.
    fn greedy(&mut self) {
        for row in 0..self.costs.rows() {
            let least = self.costs.row(row).min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            if let Some((column, cost)) = least
                && self.row_of_column[column] == NONE
            {
                self.entry_of_row[row] = Some((column, cost));
                self.row_of_column[column] = row as u32;
            }
        }
    }

    fn run(&mut self, start: usize) -> Result<(), Error> {
        let mut heap = BinaryHeap::new();
        let (mut touched, mut done) = (Vec::new(), Vec::new());
        let (mut row, mut offset) = (start, 0.0);
        let end = loop {
            for (j, cost) in self.costs.row(row) {
                let length = cost - self.v[j] - offset;
                if length < self.key[j] && !self.closed[j] {
                    if self.key[j] == f64::INFINITY {
                        touched.push(j);
                    }
                    self.key[j] = length;
                    self.before[j] = row as u32;
                    heap.push(Reverse((Length(length), self.row_of_column[j] != NONE, j)));
                }
            }
            let (length, column) = loop {
                let Some(Reverse((Length(length), _, column))) = heap.pop() else {
                    return Err(Error::Infeasible { row: start });
                };
                if length <= self.key[column] && !self.closed[column] {
                    break (length, column);
                }
            };
            if self.row_of_column[column] == NONE {
                break column;
            }
            self.closed[column] = true;
            done.push(column);
            row = self.row_of_column[column] as usize;
            let own = self.entry_of_row[row].map_or(0.0, |(_, cost)| cost);
            offset = own - self.v[column] - length;
        };
        for column in done {
            self.v[column] += self.key[column] - self.key[end];
        }
        self.flip(start, end);
        for column in touched {
            self.key[column] = f64::INFINITY;
            self.closed[column] = false;
        }
        Ok(())
    }

    fn flip(&mut self, start: usize, end: usize) {
        let mut column = end;
        loop {
            let row = self.before[column] as usize;
            let entries = self.costs.row(row).filter(|(j, _)| *j == column);
            let cheapest = entries.min_by(|a, b| a.1.total_cmp(&b.1));
            let next = std::mem::replace(&mut self.entry_of_row[row], cheapest);
            self.row_of_column[column] = row as u32;
            match next {
                Some((next, _)) if row != start => column = next,
                _ => break,
            }
        }
    }

    fn finish(self) -> Assignment {
        let some = |x: &u32| (*x != NONE).then_some(*x as usize);
        Assignment {
            column_of_row: self.entry_of_row.iter().map(|e| e.map(|(j, _)| j)).collect(),
            row_of_column: self.row_of_column.iter().map(some).collect(),
            row_duals: self.entry_of_row.iter().map(|e| e.map_or(0.0, |(j, c)| c - self.v[j])).collect(),
            cost: self.entry_of_row.iter().flatten().map(|(_, c)| c).sum(),
            column_duals: self.v,
        }
    }
}

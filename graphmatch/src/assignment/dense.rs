use pulp::{Arch, Simd, WithSimd};

use super::Costs;
use super::kernels::{Columns, two_least};
use super::row_reduction::{Bid, Rows, reduce_rows};
use super::state::{NONE, State, reduce_columns};
use crate::Error;

/// Bids a row after which the search takes over.
const BIDS: usize = 4;

/// Jonker and Volgenant's algorithm over all entries.
pub(super) fn solve(costs: Costs) -> Result<State, Error> {
    Arch::new().dispatch(Solve { costs })
}

struct Solve<'a> {
    costs: Costs<'a>,
}

impl WithSimd for Solve<'_> {
    type Output = Result<State, Error>;

    /// Everything below is inlined here, so that it is compiled for the vectors of the machine.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let costs = self.costs;
        let mut state = State::new(costs.rows, costs.columns);
        if costs.rows == costs.columns {
            reduce_columns(costs, &mut state);
        }
        let mut free = state.free_rows();
        for _ in 0..2 {
            reduce_rows(&All { costs, simd }, &mut state, &mut free, BIDS);
        }
        let mut search = Search::new(&state);
        for row in free {
            search.run(simd, costs, &mut state, row as usize)?;
        }
        Ok(state)
    }
}

/// All entries are in play.
struct All<'a, S> {
    costs: Costs<'a>,
    simd: S,
}

impl<S: Simd> Rows for All<'_, S> {
    fn len(&self) -> usize {
        self.costs.rows
    }

    #[inline(always)]
    fn bid(&self, row: usize, v: &[f64]) -> Option<Bid> {
        two_least(self.simd, self.costs.row(row), v)
    }

    fn second(&self, row: usize, v: &[f64], bid: &Bid) -> Option<usize> {
        let reduced = self.costs.row(row).iter().zip(v).map(|(c, v)| c - v).enumerate();
        reduced.filter(|(j, r)| *j != bid.best && *r == bid.next).map(|(j, _)| j).next()
    }
}

/// Buffers of the shortest-path search.
struct Search {
    columns: Columns,
    /// Columns done and their path lengths.
    done: Vec<(u32, f64)>,
}

impl Search {
    fn new(state: &State) -> Self {
        let busy = |row: &u32| if *row == NONE { 0.0 } else { f64::INFINITY };
        let columns = Columns {
            open_v: state.v.clone(),
            key: vec![0.0; state.v.len()],
            row_before: vec![0.0; state.v.len()],
            busy: state.row_of_column.iter().map(busy).collect(),
        };
        Self { columns, done: Vec::new() }
    }

    /// Assigns the free row `start` along a shortest alternating path.
    #[inline(always)]
    fn run<S: Simd>(&mut self, simd: S, costs: Costs, state: &mut State, start: usize) -> Result<(), Error> {
        let columns = &mut self.columns;
        columns.key.fill(f64::INFINITY);
        self.done.clear();
        let (mut row, mut offset, mut level) = (start, 0.0, f64::NEG_INFINITY);
        let length = loop {
            let nearest = columns.relax(simd, costs.row(row), row, [offset, level]);
            if nearest.idle < f64::INFINITY && nearest.idle <= nearest.length.max(level) {
                break nearest.idle;
            }
            if nearest.length == f64::INFINITY {
                return Err(Error::Infeasible { row: start });
            }
            let column = nearest.column;
            level = nearest.length;
            row = state.row_of_column[column] as usize;
            self.done.push((column as u32, level));
            columns.key[column] = f64::INFINITY;
            columns.open_v[column] = f64::NEG_INFINITY;
            offset = costs.row(row)[column] - state.v[column] - level;
        };
        let ends = columns.key.iter().zip(&columns.busy).position(|(key, busy)| key + busy == length);
        let Some(end) = ends else { return Err(Error::Infeasible { row: start }) };
        for &(column, at) in &self.done {
            let column = column as usize;
            state.v[column] += at - length;
            columns.open_v[column] = state.v[column];
        }
        columns.busy[end] = f64::INFINITY;
        state.augment(start, end, |column| columns.row_before[column] as usize);
        Ok(())
    }
}

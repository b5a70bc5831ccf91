use super::{Assignment, Costs};

pub(super) const NONE: u32 = u32::MAX;

/// Partners and column duals of a problem with at most as many rows as columns.
///
/// Invariant between steps: every assigned row's column has its least reduced cost `c − v` (among the arcs in
/// play), and columns that were never assigned have `v = 0` where there are more columns than rows.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) column_of_row: Vec<u32>,
    pub(super) row_of_column: Vec<u32>,
    pub(super) v: Vec<f64>,
}

impl State {
    pub(super) fn new(rows: usize, columns: usize) -> Self {
        Self { column_of_row: vec![NONE; rows], row_of_column: vec![NONE; columns], v: vec![0.0; columns] }
    }

    pub(super) fn assign(&mut self, row: usize, column: usize) {
        self.column_of_row[row] = column as u32;
        self.row_of_column[column] = row as u32;
    }

    pub(super) fn free_rows(&self) -> Vec<u32> {
        (0..self.column_of_row.len() as u32).filter(|&i| self.column_of_row[i as usize] == NONE).collect()
    }

    /// Flips the path that ends at `end`, back to row `start`.
    pub(super) fn augment(&mut self, start: usize, end: usize, row_before: impl Fn(usize) -> usize) {
        let mut column = end;
        loop {
            let row = row_before(column);
            let next = self.column_of_row[row];
            self.assign(row, column);
            if row == start {
                break;
            }
            column = next as usize;
        }
    }

    /// * `cost` – of an assigned row and column; the total is left to the caller.
    pub(super) fn finish(self, cost: impl Fn(usize, usize) -> f64) -> Assignment {
        let some = |x: &u32| (*x != NONE).then_some(*x as usize);
        let column_of_row: Vec<Option<usize>> = self.column_of_row.iter().map(some).collect();
        let row_duals = column_of_row
            .iter()
            .enumerate()
            .map(|(i, j)| j.map_or(0.0, |j| cost(i, j) - self.v[j]))
            .collect();
        let row_of_column = self.row_of_column.iter().map(some).collect();
        Assignment { column_of_row, row_of_column, row_duals, column_duals: self.v, cost: 0.0 }
    }
}

/// Column minima as duals, and each column to the row that has it, first come. Only for square problems.
#[inline(always)]
pub(super) fn reduce_columns(costs: Costs, state: &mut State) {
    let mut lowest = vec![f64::INFINITY; costs.columns];
    // As numbers of the costs' type, so that both are chosen in the same stroke.
    let mut row_of_lowest = vec![0.0; costs.columns];
    for i in 0..costs.rows {
        let number = i as f64;
        for ((c, low), row) in costs.row(i).iter().zip(&mut lowest).zip(&mut row_of_lowest) {
            let better = c < low;
            *low = if better { *c } else { *low };
            *row = if better { number } else { *row };
        }
    }
    for j in 0..costs.columns {
        // A column without allowed row keeps dual 0; the search finds it infeasible.
        if lowest[j] < f64::INFINITY {
            state.v[j] = lowest[j];
            let i = row_of_lowest[j] as usize;
            if state.column_of_row[i] == NONE {
                state.assign(i, j);
            }
        }
    }
}

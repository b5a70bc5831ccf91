use super::Assignment;
use super::paths::{Arcs, Paths};
use super::state::{NONE, State};
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
}

impl Arcs for SparseCosts {
    fn of_row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let run = self.start[row]..self.start[row + 1];
        self.column[run.clone()].iter().map(|&j| j as usize).zip(self.cost[run].iter().copied())
    }

    fn cost(&self, row: usize, column: usize) -> f64 {
        let entries = self.of_row(row).filter(|(j, _)| *j == column);
        entries.map(|(_, cost)| cost).fold(f64::INFINITY, f64::min)
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
    let mut state = State::new(costs.rows(), costs.columns);
    assign_cheapest(costs, &mut state);
    let mut paths = Paths::new(costs.columns);
    for row in state.free_rows() {
        let row = row as usize;
        paths.assign(costs, &mut state, row).map_err(|_| Error::Infeasible { row })?;
    }
    let found = state.finish(|row, column| costs.cost(row, column));
    let pairs = found.column_of_row.iter().enumerate();
    let cost = pairs.filter_map(|(i, j)| j.map(|j| costs.cost(i, j))).sum();
    Ok(Assignment { cost, ..found })
}

/// Each row takes its cheapest column while all duals are 0, if it is idle.
fn assign_cheapest(costs: &SparseCosts, state: &mut State) {
    for row in 0..costs.rows() {
        let least = costs.of_row(row).min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        if let Some((column, _)) = least
            && state.row_of_column[column] == NONE
        {
            state.assign(row, column);
        }
    }
}

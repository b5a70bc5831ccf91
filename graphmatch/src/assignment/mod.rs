//! Linear assignment: which row goes with which column at the least total cost.

mod costs;
mod dense;

pub use costs::Costs;
pub use dense::{assign, assign_or_leave};

/// An optimal assignment and the certificate that it is one.
///
/// With `u` the row and `v` the column duals, `u[i] + v[j] ≤ c[i][j]` everywhere and `=` on assigned pairs. The side
/// with more members has duals ≤ 0, and 0 where it is not assigned, so `cost` equals the sum of all duals, which
/// no assignment can undercut.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// Column of every row; `None` only where there are more rows than columns or rows may be left.
    pub column_of_row: Vec<Option<usize>>,
    /// Row of every column.
    pub row_of_column: Vec<Option<usize>>,
    /// Dual of every row.
    pub row_duals: Vec<f64>,
    /// Dual of every column.
    pub column_duals: Vec<f64>,
    /// Total cost of the assigned pairs, in order of rows (and of the rows left, where that has a cost).
    pub cost: f64,
}

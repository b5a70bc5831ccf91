use super::state::State;
use super::{Costs, core_arcs, dense};
use crate::Error;

/// An optimal assignment and the certificate that it is one.
///
/// With `u` the row and `v` the column duals, `u[i] + v[j] ≤ c[i][j]` everywhere and `=` on assigned pairs, to
/// rounding. The side with more members has duals ≤ 0, and 0 where it is not assigned, so `cost` equals the sum of
/// all duals, which no assignment can undercut.
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
    /// Total cost of the assigned pairs; with [`assign_or_leave`] also of those left (of the smaller side).
    pub cost: f64,
}

/// Fewest rows and columns for which a core of cheap arcs is tried first: below, the matrix (18 MB) stays in the cache and
/// looking at all entries is about as fast, or faster where few rows are in doubt.
const CORE_FROM: usize = 1500;

/// The assignment of least total cost: every row gets a column, or every column a row where there are fewer.
///
/// # Errors
/// [`Error::Infeasible`] where forbidden pairs leave a row (of the smaller side) without a partner.
///
/// Cost O(n² m) at worst for n ≤ m; typically a few passes over the matrix, because most of the work
/// happens in the first two steps, and in large square problems on each row's few cheapest entries.
///
/// **Source**: Jonker, Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment
/// problems", 1987; rectangular as in Bijsterbosch, Volgenant, 2010; core of cheap arcs as in Volgenant, 1996. We
/// leave out the reduction transfer, which the row reduction makes up for.
///
/// ```
/// use draco_graphmatch::{Costs, assign};
///
/// let costs = [4.0, 1.0, 3.0, 2.0, 0.0, f64::INFINITY];
/// let found = assign(Costs::new(2, 3, &costs)?)?;
/// assert_eq!(found.column_of_row, [Some(1), Some(0)]);
/// assert_eq!(found.cost, 3.0);
/// assert_eq!(found.row_duals.iter().chain(&found.column_duals).sum::<f64>(), 3.0);
/// # Ok::<(), draco_graphmatch::Error>(())
/// ```
pub fn assign(costs: Costs) -> Result<Assignment, Error> {
    let found = if costs.rows > costs.columns {
        let flipped = transpose(costs);
        let wide = Costs { rows: costs.columns, columns: costs.rows, values: &flipped };
        flip(assign_wide(wide)?.finish(|i, j| wide.row(i)[j]))
    } else {
        assign_wide(costs)?.finish(|i, j| costs.row(i)[j])
    };
    let pairs = found.column_of_row.iter().enumerate();
    let cost = pairs.filter_map(|(i, j)| j.map(|j| costs.row(i)[j])).sum();
    Ok(Assignment { cost, ..found })
}

/// The assignment of least total cost when leaving a row (of the smaller side: a column) without partner costs
/// `unmatched`. Always feasible. The duals are those of the problem with every cost capped at `unmatched`.
///
/// # Errors
/// `unmatched` is not finite.
pub fn assign_or_leave(costs: Costs, unmatched: f64) -> Result<Assignment, Error> {
    if !unmatched.is_finite() {
        return Err(Error::BadParameter { name: "unmatched", value: unmatched, need: "finite" });
    }
    // With at least as many columns as rows, a row that is left finds some idle column, so capping is exact.
    let capped: Vec<f64> = costs.values.iter().map(|c| c.min(unmatched)).collect();
    let mut found = assign(Costs { values: &capped, ..costs })?;
    for i in 0..costs.rows {
        if let Some(j) = found.column_of_row[i]
            && costs.row(i)[j] > unmatched
        {
            found.column_of_row[i] = None;
            found.row_of_column[j] = None;
        }
    }
    Ok(found)
}

fn assign_wide(costs: Costs) -> Result<State, Error> {
    if costs.rows >= CORE_FROM
        && costs.rows == costs.columns
        && let Some(state) = core_arcs::solve(costs)
    {
        return Ok(state);
    }
    dense::solve(costs)
}

fn transpose(costs: Costs) -> Vec<f64> {
    let mut flipped = vec![0.0; costs.values.len()];
    for i in 0..costs.rows {
        for (j, c) in costs.row(i).iter().enumerate() {
            flipped[j * costs.rows + i] = *c;
        }
    }
    flipped
}

fn flip(a: Assignment) -> Assignment {
    Assignment {
        column_of_row: a.row_of_column,
        row_of_column: a.column_of_row,
        row_duals: a.column_duals,
        column_duals: a.row_duals,
        cost: a.cost,
    }
}

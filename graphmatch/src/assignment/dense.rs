use super::{Assignment, Costs};
use crate::Error;

/// The assignment of least total cost: every row gets a column, or every column a row where there are fewer.
///
/// # Errors
/// [`Error::Infeasible`] where forbidden pairs leave a row (of the smaller side) without a partner.
///
/// **Source**: Jonker, Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment
/// problems", 1987; rectangular as in Bijsterbosch, Volgenant, 2010.
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
    if costs.rows > costs.columns {
        let flipped = transpose(costs);
        let found = assign_wide(Costs { rows: costs.columns, columns: costs.rows, values: &flipped })?;
        return Ok(with_cost(flip(found), costs));
    }
    Ok(with_cost(assign_wide(costs)?, costs))
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

fn with_cost(mut a: Assignment, costs: Costs) -> Assignment {
    a.cost = a.column_of_row.iter().enumerate().filter_map(|(i, j)| j.map(|j| costs.row(i)[j])).sum();
    a
}

/// Rows ≤ columns. Column duals start at 0 and only fall, so idle columns keep 0.
fn assign_wide(costs: Costs) -> Result<Assignment, Error> {
    let (n, m) = (costs.rows, costs.columns);
    let mut v = vec![0.0; m];
    let mut column_of_row = vec![None; n];
    let mut row_of_column: Vec<Option<usize>> = vec![None; m];
    let mut distance = vec![0.0; m];
    let mut previous = vec![0; m];
    for start in 0..n {
        let mut open: Vec<usize> = (0..m).collect();
        let mut closed = Vec::new();
        for j in 0..m {
            distance[j] = costs.row(start)[j] - v[j];
            previous[j] = start;
        }
        let end = loop {
            let Some((k, j)) = open
                .iter()
                .enumerate()
                .min_by(|x, y| distance[*x.1].total_cmp(&distance[*y.1]).then(x.1.cmp(y.1)))
                .map(|(k, &j)| (k, j))
                .filter(|&(_, j)| distance[j] < f64::INFINITY)
            else {
                return Err(Error::Infeasible { row: start });
            };
            open.swap_remove(k);
            let Some(i) = row_of_column[j] else { break j };
            closed.push(j);
            let offset = costs.row(i)[j] - v[j] - distance[j];
            for &k in &open {
                let d = costs.row(i)[k] - v[k] - offset;
                if d < distance[k] {
                    distance[k] = d;
                    previous[k] = i;
                }
            }
        };
        for j in closed {
            v[j] += distance[j] - distance[end];
        }
        let mut j = end;
        loop {
            let i = previous[j];
            row_of_column[j] = Some(i);
            let next = column_of_row[i].replace(j);
            match next {
                Some(k) if i != start => j = k,
                _ => break,
            }
        }
    }
    let row_duals = (0..n).map(|i| column_of_row[i].map_or(0.0, |j: usize| costs.row(i)[j] - v[j])).collect();
    Ok(Assignment { column_of_row, row_of_column, row_duals, column_duals: v, cost: 0.0 })
}

use crate::{Affinity, Costs, Error, Pair, assign};

/// The one-to-one pairs of largest total score, those with a score above 0.
///
/// * `scores` – one a pair, row-major as in [`Affinity`], finite.
///
/// # Errors
/// `scores` of another length, or not finite.
pub fn assign_scores(affinity: &Affinity, scores: &[f64]) -> Result<Vec<Pair>, Error> {
    let (rows, columns) = (affinity.rows(), affinity.columns());
    let costs: Vec<f64> = scores.iter().map(|s| -s).collect();
    let found = assign(Costs::new(rows, columns, &costs)?)?;
    let pairs = found.column_of_row.iter().enumerate();
    Ok(pairs
        .filter_map(|(first, second)| second.map(|second| Pair { first, second }))
        .filter(|p| scores[p.first * columns + p.second] > 0.0)
        .collect())
}

/// One-to-one pairs, the highest score first, those with a score above 0.
///
/// # Errors
/// `scores` of another length.
///
/// **Source**: Leordeanu, Hebert, 2005.
pub fn greedy_pairs(affinity: &Affinity, scores: &[f64]) -> Result<Vec<Pair>, Error> {
    let (rows, columns) = (affinity.rows(), affinity.columns());
    if scores.len() != rows * columns {
        return Err(Error::WrongLength { what: "the scores", expected: rows * columns, found: scores.len() });
    }
    let mut order: Vec<usize> = (0..scores.len()).filter(|&k| scores[k] > 0.0).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
    let (mut used1, mut used2) = (vec![false; rows], vec![false; columns]);
    let mut pairs = Vec::new();
    for k in order {
        let pair = Pair { first: k / columns, second: k % columns };
        if !used1[pair.first] && !used2[pair.second] {
            used1[pair.first] = true;
            used2[pair.second] = true;
            pairs.push(pair);
        }
    }
    pairs.sort_unstable();
    Ok(pairs)
}

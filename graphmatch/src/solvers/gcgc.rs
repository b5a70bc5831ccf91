use crate::{Affinity, Error, Pair};

/// The largest group of pairs that all agree with one another, grown greedily from each of the `seeds` pairs of highest
/// score.
///
/// * `scores` – such as [`principal_eigenvector`](crate::principal_eigenvector)'s, row-major.
///
/// # Errors
/// `scores` of another length.
///
/// Cost O(seeds · (N M + group² candidates)).
///
/// **Source**: Chen, Bhanu, "3D free-form object recognition in range images using local surface patches", 2007
/// (geometric consistency grouping); growth ordered by score times agreement with the seed.
pub fn gcgc(affinity: &Affinity, scores: &[f64], seeds: usize) -> Result<Vec<Pair>, Error> {
    let columns = affinity.columns();
    let expected = affinity.rows() * columns;
    if scores.len() != expected {
        return Err(Error::WrongLength { what: "the scores", expected, found: scores.len() });
    }
    let mut order: Vec<usize> = (0..expected).filter(|&k| scores[k] > 0.0).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
    let ends = |k: usize| (k / columns, k % columns);
    let mut best: Vec<usize> = Vec::new();
    for &seed in order.iter().take(seeds) {
        let mut near: Vec<(f64, usize)> = order
            .iter()
            .map(|&k| (affinity.entry(ends(seed), ends(k)) * scores[k], k))
            .filter(|(worth, _)| *worth > 0.0)
            .collect();
        near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut group = vec![seed];
        for (_, k) in near {
            if group.iter().all(|&g| affinity.entry(ends(g), ends(k)) > 0.0) {
                group.push(k);
            }
        }
        if group.len() > best.len() {
            best = group;
        }
    }
    let mut pairs: Vec<Pair> =
        best.into_iter().map(ends).map(|(first, second)| Pair { first, second }).collect();
    pairs.sort_unstable();
    Ok(pairs)
}

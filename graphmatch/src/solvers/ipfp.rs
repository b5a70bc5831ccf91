use super::assign_scores;
use crate::{Affinity, Error, Pair};

/// Pairs of large total agreement by integer projected fixed point: assign the gradient, step towards it as far as
/// the agreement grows, and keep the best assignment seen.
///
/// * `start` – scores to begin with, such as [`principal_eigenvector`](crate::principal_eigenvector)'s.
/// * `iterations` – most steps; 50 is plenty.
///
/// # Errors
/// `start` of another length or not finite.
///
/// **Source**: Leordeanu, Hebert, Sukthankar, "An integer projected fixed point method for graph matching and MAP
/// inference", 2009.
pub fn ipfp(affinity: &Affinity, start: &[f64], iterations: usize) -> Result<Vec<Pair>, Error> {
    let columns = affinity.columns();
    let mut best = assign_scores(affinity, start)?;
    let mut best_value = agreement(affinity, &best);
    let mut x = start.to_vec();
    let (mut gradient, mut along) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    for _ in 0..iterations {
        affinity.apply(&x, &mut gradient);
        let pairs = assign_scores(affinity, &gradient)?;
        let value = agreement(affinity, &pairs);
        if value > best_value {
            best_value = value;
            best = pairs.clone();
        }
        let mut step: Vec<f64> = x.iter().map(|x| -x).collect();
        for p in &pairs {
            step[p.first * columns + p.second] += 1.0;
        }
        affinity.apply(&step, &mut along);
        let slope: f64 = gradient.iter().zip(&step).map(|(g, s)| g * s).sum();
        let curvature: f64 = along.iter().zip(&step).map(|(a, s)| a * s).sum();
        if slope <= 1e-12 * best_value {
            break;
        }
        let length = if curvature >= 0.0 { 1.0 } else { (-slope / curvature).min(1.0) };
        x.iter_mut().zip(&step).for_each(|(x, s)| *x += length * s);
    }
    Ok(best)
}

/// Sum of the affinities among pairs.
fn agreement(affinity: &Affinity, pairs: &[Pair]) -> f64 {
    let ends = |p: &Pair| (p.first, p.second);
    pairs.iter().map(|p| pairs.iter().map(|q| affinity.entry(ends(p), ends(q))).sum::<f64>()).sum()
}

use super::sinkhorn::sinkhorn;
use crate::{Affinity, Error};

/// Knobs of [`rrwm`]; defaults as in pygmtools.
#[derive(Debug, Clone, PartialEq)]
pub struct RrwmParams {
    /// Most steps of the walk. Default 50.
    pub iterations: usize,
    /// Half steps of each Sinkhorn scaling. Default 20.
    pub sinkhorn_iterations: usize,
    /// Share of the jump in a step. Default 0.2.
    pub alpha: f64,
    /// Sharpness of the jump, at most 300. Default 30.
    pub beta: f64,
}

impl Default for RrwmParams {
    fn default() -> Self {
        Self { iterations: 50, sinkhorn_iterations: 20, alpha: 0.2, beta: 30.0 }
    }
}

/// Scores of all pairs by reweighted random walks; they sum to 1, or are all 0 if the affinity is.
///
/// # Errors
/// `alpha` outside 0 … 1, `beta` outside 0 … 300.
///
/// Cost O(iterations · (stored affinities + sinkhorn_iterations · N M)).
///
/// **Source**: Cho, Lee, Lee, "Reweighted random walks for graph matching", 2010.
pub fn rrwm(affinity: &Affinity, params: &RrwmParams) -> Result<Vec<f64>, Error> {
    for (name, value, most) in [("alpha", params.alpha, 1.0), ("beta", params.beta, 300.0)] {
        if !(0.0..=most).contains(&value) {
            return Err(Error::BadParameter { name, value, need: "from 0 to 1 (alpha), to 300 (beta)" });
        }
    }
    let (rows, columns) = (affinity.rows(), affinity.columns());
    let size = rows * columns;
    let mut walk = vec![1.0 / size.max(1) as f64; size];
    let mut moved = vec![0.0; size];
    affinity.apply(&vec![1.0; size], &mut moved);
    let most = moved.iter().copied().fold(0.0, f64::max);
    if most == 0.0 {
        return Ok(vec![0.0; size]);
    }
    // The tiny share of the least degree is the reference's guard against 0/0, kept for equal answers.
    let scale = (most + 1e-5 * moved.iter().copied().fold(f64::INFINITY, f64::min)).recip();
    let mut jump = vec![0.0; size];
    for _ in 0..params.iterations {
        affinity.apply(&walk, &mut moved);
        moved.iter_mut().for_each(|x| *x *= scale);
        let (sum, largest) =
            moved.iter().fold((0.0, 0.0), |(sum, most): (f64, f64), x| (sum + x, most.max(*x)));
        if sum == 0.0 {
            break;
        }
        for (jump, x) in jump.iter_mut().zip(&moved) {
            *jump = (params.beta * (x / largest - 1.0)).exp();
        }
        sinkhorn(&mut jump, rows, columns, params.sinkhorn_iterations);
        for ((walk, jump), x) in walk.iter_mut().zip(&jump).zip(&moved) {
            *walk = params.alpha * jump + (1.0 - params.alpha) * x / sum;
        }
        let total: f64 = walk.iter().sum();
        walk.iter_mut().for_each(|x| *x /= total);
        // As the reference does: against the walk before it was normalised.
        let change: f64 = walk.iter().zip(&moved).map(|(a, b)| (a - b) * (a - b)).sum();
        if change.sqrt() < 1e-5 {
            break;
        }
    }
    Ok(walk)
}

use pulp::{Arch, Simd, WithSimd};

use super::sinkhorn::sinkhorn;
use crate::lanes::{self, LANES};
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
    Ok(Arch::new().dispatch(Walk { affinity, params }))
}

/// Length of a step that changes no answer; the walk's entries sum to 1.
const STILL: f64 = 1e-12;

struct Walk<'a> {
    affinity: &'a Affinity,
    params: &'a RrwmParams,
}

impl WithSimd for Walk<'_> {
    type Output = Vec<f64>;

    /// The loops over all pairs are inlined here, so that they are compiled for the vectors of the machine.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vec<f64> {
        let Self { affinity, params: &RrwmParams { iterations, sinkhorn_iterations, alpha, beta } } = self;
        let (rows, columns) = (affinity.rows(), affinity.columns());
        let size = rows * columns;
        // Filled up with zeros to whole lanes.
        let padded = size.next_multiple_of(LANES);
        let (mut walk, mut moved, mut jump) = (vec![0.0; padded], vec![0.0; padded], vec![0.0; padded]);
        walk[..size].fill(1.0);
        affinity.apply(&walk[..size], &mut moved[..size]);
        let most = lanes::largest(&moved);
        if most == 0.0 {
            return vec![0.0; size];
        }
        // The tiny share of the least degree is the reference's guard against 0/0, kept for equal answers.
        let scale = (most + 1e-5 * moved[..size].iter().copied().fold(f64::INFINITY, f64::min)).recip();
        walk[..size].fill(1.0 / size as f64);
        moved.iter_mut().for_each(|x| *x /= size as f64);
        for step in 0..iterations {
            // The first product is that of the uniform walk, already known.
            if step > 0 {
                affinity.apply(&walk[..size], &mut moved[..size]);
            }
            let (sum, largest) = (lanes::sum(&moved), lanes::largest(&moved));
            let sharpness = beta / largest;
            // The walk has died out, or its entries are too small to compare.
            if !sharpness.is_finite() {
                break;
            }
            lanes::replace(&mut jump, &moved, &moved, |jump, x, _| {
                let mut exponent = [0.0; LANES];
                for lane in 0..LANES {
                    exponent[lane] = sharpness * x[lane] - beta;
                }
                *jump = lanes::exp(&exponent);
            });
            jump[size..].fill(0.0);
            sinkhorn(&mut jump[..size], rows, columns, sinkhorn_iterations);
            let rest = (1.0 - alpha) / sum;
            let mut totals = [0.0; LANES];
            lanes::replace(&mut jump, &moved, &moved, |jump, x, _| {
                for lane in 0..LANES {
                    jump[lane] = alpha * jump[lane] + rest * x[lane];
                    totals[lane] += jump[lane];
                }
            });
            let share = lanes::total(&totals).recip();
            // What the reference looks at is the change against the walk before it was normalised.
            let (mut change, mut length) = ([0.0; LANES], [0.0; LANES]);
            lanes::replace(&mut walk, &jump, &moved, |walk, jump, x| {
                for lane in 0..LANES {
                    let next = share * jump[lane];
                    let (from_moved, from_walk) = (next - scale * x[lane], next - walk[lane]);
                    change[lane] += from_moved * from_moved;
                    length[lane] += from_walk * from_walk;
                    walk[lane] = next;
                }
            });
            let (change, length) = (lanes::total(&change), lanes::total(&length));
            // A walk that stands still would stand still to the end.
            if change.sqrt() < 1e-5 || length.sqrt() < STILL {
                break;
            }
        }
        walk.truncate(size);
        walk
    }
}

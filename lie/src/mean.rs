use nalgebra::SVector;

use crate::{Error, LieGroup};

/// How [`frechet_mean`] ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Termination {
    /// The step fell below the tolerance.
    Converged,
    /// The iterations ran out; the pose is the best so far.
    MaxIterations,
}

/// When [`frechet_mean`] stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanParams {
    /// Largest number of steps. Default 50: clusters within a radian of their mean take fewer than ten.
    pub max_iterations: usize,
    /// Length of the step (metres and radians) that counts as converged, plus the rounding of the sum of
    /// residuals. Default 1e-14.
    pub tolerance: f64,
}

impl Default for MeanParams {
    fn default() -> Self {
        Self { max_iterations: 50, tolerance: 1e-14 }
    }
}

/// A mean pose and how it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean<G> {
    /// The mean.
    pub pose: G,
    /// Steps taken.
    pub iterations: usize,
    /// Length of the last step.
    pub last_step: f64,
    /// Why it ended.
    pub termination: Termination,
}

/// The weighted mean of poses: the pose `m` with `Σ wᵢ log(m⁻¹ Tᵢ) = 0`.
///
/// On rotations this is the Fréchet (Karcher) mean, which minimises the weighted sum of squared angles; on poses,
/// which have no bi-invariant metric, it is the bi-invariant exponential barycentre, which depends neither on the
/// choice of frame nor on a ratio of metres to radians. Unique for rotations within less than π/2 of each other;
/// started at the pose of the largest weight (the first of several).
///
/// * `poses` – at least one.
/// * `weights` – one a pose, not negative, not all zero; any scale. Empty means equal weights.
///
/// # Errors
/// [`Error::Empty`], [`Error::WeightCount`], [`Error::Weight`], [`Error::NotFinite`], [`Error::NotUnit`].
///
/// Cost: `O(n)` logarithms an iteration.
///
/// **Source** X. Pennec, V. Arsigny, *Exponential Barycenters of the Canonical Cartan Connection and Invariant
/// Means on Lie Groups*, 2013, algorithm 1.
///
/// ```
/// use draco_lie::{MeanParams, Termination, frechet_mean};
/// use nalgebra::{Isometry2, Vector2};
/// let headings = [3.1, -3.1].map(|theta| Isometry2::new(Vector2::zeros(), theta));
/// let mean = frechet_mean(&headings, &[], &MeanParams::default())?;
/// assert_eq!(mean.termination, Termination::Converged);
/// assert!((mean.pose.rotation.angle().abs() - std::f64::consts::PI).abs() < 1e-14);
/// # Ok::<(), draco_lie::Error>(())
/// ```
pub fn frechet_mean<const N: usize, G: LieGroup<N>>(
    poses: &[G],
    weights: &[f64],
    params: &MeanParams,
) -> Result<Mean<G>, Error> {
    let total = check_weights(poses.len(), weights)?;
    poses.iter().try_for_each(G::check)?;
    let weight = |index: usize| weights.get(index).copied().unwrap_or(1.0);
    let start = (0..poses.len()).reduce(|best, i| if weight(i) > weight(best) { i } else { best });
    let mut pose = *start.and_then(|index| poses.get(index)).ok_or(Error::Empty)?;
    // what rounding leaves of a sum of n residuals that cancel
    let rounding = f64::EPSILON * (4.0 + (poses.len() as f64).sqrt());
    let mut last_step = f64::INFINITY;
    for iterations in 0..params.max_iterations {
        let mut sum = SVector::<f64, N>::zeros();
        let mut largest = 0.0_f64;
        for (index, other) in poses.iter().enumerate() {
            let residual = other.minus(&pose);
            largest = largest.max(residual.amax());
            sum += residual * (weight(index) / total);
        }
        pose = pose.plus(&sum);
        last_step = sum.norm();
        if last_step <= params.tolerance + rounding * largest {
            return Ok(Mean {
                pose,
                iterations: iterations + 1,
                last_step,
                termination: Termination::Converged,
            });
        }
    }
    let iterations = params.max_iterations;
    Ok(Mean { pose, iterations, last_step, termination: Termination::MaxIterations })
}

/// The sum of the weights, all checked.
fn check_weights(poses: usize, weights: &[f64]) -> Result<f64, Error> {
    if poses == 0 {
        return Err(Error::Empty);
    }
    if weights.is_empty() {
        return Ok(poses as f64);
    }
    if weights.len() != poses {
        return Err(Error::WeightCount { poses, weights: weights.len() });
    }
    for (index, &value) in weights.iter().enumerate() {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::Weight { index, value });
        }
    }
    let total: f64 = weights.iter().sum();
    if total > 0.0 && total.is_finite() { Ok(total) } else { Err(Error::Weight { index: 0, value: total }) }
}

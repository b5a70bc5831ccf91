use nalgebra::{Isometry3, Matrix4, Similarity3};

use super::alignment::{align_in_space, to_space};
use super::pairs::{angle, pairs};
use super::{Alignment, Delta, Pairs, TrajectoryPose};
use crate::Error;

/// What of an error pose `E` counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum PoseRelation {
    /// Length of the translation, in metres.
    #[default]
    Translation,
    /// Angle of the rotation, in radians.
    RotationAngle,
    /// `|R - I|_F` with `R` the rotation matrix; no unit.
    RotationPart,
    /// `|E - I|_F` with `E` the homogeneous matrix: metres and sines mixed.
    FullTransformation,
    /// Difference of the distances between two poses, in metres. Of absolute errors the same as `Translation`.
    PointDistance,
}

/// Errors pose by pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseErrors {
    /// One error a pose or pair; metres or radians as [`PoseRelation`] says.
    pub errors: Vec<f64>,
    /// The positions each error is between; of an absolute error twice the same.
    pub pairs: Vec<(usize, usize)>,
    /// How the estimate was moved: `p ↦ s R p + t`.
    pub alignment: Similarity3<f64>,
}

/// Statistics of a list of errors, in its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// Root of the mean of squares.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median; of an even number the mean of the two in the middle.
    pub median: f64,
    /// Standard deviation, `1/n`.
    pub std: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Sum of squares.
    pub sse: f64,
}

impl PoseErrors {
    /// Statistics of the errors, of which there is always at least one.
    pub fn statistics(&self) -> Statistics {
        let n = self.errors.len() as f64;
        let mut sorted = self.errors.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = |i: usize| sorted.get(i).copied().unwrap_or(f64::NAN);
        let mean = self.errors.iter().sum::<f64>() / n;
        let sse = self.errors.iter().map(|e| e * e).sum::<f64>();
        let variance = self.errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n;
        let half = sorted.len() / 2;
        Statistics {
            rmse: (sse / n).sqrt(),
            mean,
            median: if sorted.len() % 2 == 1 {
                middle(half)
            } else {
                0.5 * (middle(half - 1) + middle(half))
            },
            std: variance.sqrt(),
            min: middle(0),
            max: sorted.last().copied().unwrap_or(f64::NAN),
            sse,
        }
    }
}

/// Parameters of [`rpe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RpeParams {
    /// What of an error counts. Default: the translation.
    pub relation: PoseRelation,
    /// How far apart the poses of a pair lie. Default: one frame.
    pub delta: Delta,
    /// Which pairs are taken. Default: one after the other.
    pub pairs: Pairs,
    /// How the estimate is moved first. Default: not at all; of these errors only scale and, by rounding, nothing
    /// else matters.
    pub alignment: Alignment,
}

impl Default for RpeParams {
    fn default() -> Self {
        Self {
            relation: PoseRelation::default(),
            delta: Delta::Frames(1),
            pairs: Pairs::default(),
            alignment: Alignment::None,
        }
    }
}

/// Absolute trajectory error (absolute pose error): `E_i = estimate_i⁻¹ reference_i` after alignment.
///
/// **Source**: Sturm, Engelhard, Endres, Burgard, Cremers, *A benchmark for the evaluation of RGB-D SLAM systems*,
/// 2012.
///
/// # Errors
/// [`Error::Lengths`], [`Error::EmptyGraph`] without poses, [`Error::Trajectory`], [`Error::Alignment`].
pub fn ate<const N: usize, G: TrajectoryPose<N>>(
    estimate: &[G],
    reference: &[G],
    relation: PoseRelation,
    alignment: Alignment,
) -> Result<PoseErrors, Error> {
    let (estimate, reference) = to_space(estimate, reference)?;
    let alignment = align_in_space(&estimate, &reference, alignment, G::PLANAR)?;
    let errors = estimate
        .iter()
        .zip(&reference)
        .map(|(x, to)| {
            let x = moved(&alignment, x);
            match relation {
                PoseRelation::Translation | PoseRelation::PointDistance => {
                    (x.translation.vector - to.translation.vector).norm()
                }
                _ => size(&x.inv_mul(to), relation),
            }
        })
        .collect();
    Ok(PoseErrors { errors, pairs: (0..estimate.len()).map(|i| (i, i)).collect(), alignment })
}

/// Relative pose error: `E_ij = (reference_i⁻¹ reference_j)⁻¹ (estimate_i⁻¹ estimate_j)` over pairs of poses that
/// the estimate says are `delta` apart.
///
/// # Errors
/// Those of [`ate`]; [`Error::Parameter`]; [`Error::NoPairs`].
pub fn rpe<const N: usize, G: TrajectoryPose<N>>(
    estimate: &[G],
    reference: &[G],
    params: &RpeParams,
) -> Result<PoseErrors, Error> {
    let (mut estimate, reference) = to_space(estimate, reference)?;
    let alignment = align_in_space(&estimate, &reference, params.alignment, G::PLANAR)?;
    estimate.iter_mut().for_each(|x| *x = moved(&alignment, x));
    let pairs = pairs(&estimate, params.delta, params.pairs)?;
    let errors = pairs
        .iter()
        .map(|(i, j)| {
            let (x, to) = (estimate[*i].inv_mul(&estimate[*j]), reference[*i].inv_mul(&reference[*j]));
            match params.relation {
                PoseRelation::PointDistance => {
                    (x.translation.vector.norm() - to.translation.vector.norm()).abs()
                }
                relation => size(&to.inv_mul(&x), relation),
            }
        })
        .collect();
    Ok(PoseErrors { errors, pairs, alignment })
}

/// A pose moved by a similarity: its position by all of it, its rotation by the rotation.
fn moved(by: &Similarity3<f64>, x: &Isometry3<f64>) -> Isometry3<f64> {
    let scaled = Isometry3::from_parts((x.translation.vector * by.scaling()).into(), x.rotation);
    by.isometry * scaled
}

fn size(error: &Isometry3<f64>, relation: PoseRelation) -> f64 {
    let matrix = || error.to_homogeneous() - Matrix4::identity();
    match relation {
        PoseRelation::Translation | PoseRelation::PointDistance => error.translation.vector.norm(),
        PoseRelation::RotationAngle => angle(&Isometry3::identity(), error),
        PoseRelation::RotationPart => matrix().fixed_view::<3, 3>(0, 0).norm(),
        PoseRelation::FullTransformation => matrix().norm(),
    }
}

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};

use super::se2::{SearchParams, branch_and_bound_2d};
use crate::Error;
use crate::cloud::Cloud;
use crate::icp::{IcpParams, Registration, Target};

/// Consecutive source points whose gains count as one draw: neighbours along a wall gain or lose together.
const BLOCK: usize = 10;

/// Standard deviations of the gain up to which two poses fit as well.
const SIGNIFICANT: f64 = 1.0;

/// A search about a start that is only roughly right, and the alignment that finishes it.
#[derive(Debug, Clone, PartialEq)]
pub struct NearStartParams {
    /// The search.
    pub search: SearchParams,
    /// The alignment from what the search found.
    pub icp: IcpParams,
}

impl NearStartParams {
    /// For 2-D laser scans whose start is good to `reach` metres and 30°.
    pub fn laser_2d(reach: f64) -> Self {
        let icp = IcpParams { max_distance: 0.5, ..IcpParams::laser_2d() };
        Self { search: SearchParams::near_start(reach), icp }
    }
}

/// Aligns from a start that may be off by more than ICP forgives: a search around it, then ICP.
///
/// The answer is then moved to the mean of what the scans and the start say, each by its information, the half widths of
/// the search being taken as two standard deviations of the start. Where the scans fix the pose this moves it by a
/// thousandth; along directions that they hardly show it goes where the start had it. It is left undone if that
/// fits worse by more than one standard deviation, which is that of the gain in `min(d, τ)²` (`τ` the truncation of the
/// search), summed over runs of ten consecutive points. Covariance, information and degenerate directions stay those
/// of the scans alone.
///
/// # Errors
/// Those of [`Target::align`] and [`branch_and_bound_2d`].
///
/// **Source** of the treatment of degenerate directions: Zhang, Kaess, Singh, "On degeneracy of optimization-based
/// state estimation problems", 2016; ours are found by probing (see [`crate::Covariance::Sandwich`]).
pub fn align_near_start(
    target: &Target<2>,
    source: &Cloud<2>,
    start: &Isometry2<f64>,
    params: &NearStartParams,
) -> Result<Registration<Isometry2<f64>, 3>, Error> {
    let searched = branch_and_bound_2d(target, source, start, &params.search)?;
    let mut found = target.align(source, &searched.best().target_from_source, &params.icp)?;
    let pose = with_start(&found, start, &params.search);
    let lost = gain(target, source, &pose, &found.target_from_source, params.search.truncation);
    if lost <= SIGNIFICANT {
        found.target_from_source = pose;
        found.overlap = target.overlap(source, &pose, params.icp.overlap_radius)?.source;
    }
    Ok(found)
}

/// By how many standard deviations the second pose fits better than the first.
fn gain(
    target: &Target<2>,
    source: &Cloud<2>,
    first: &Isometry2<f64>,
    second: &Isometry2<f64>,
    tau: f64,
) -> f64 {
    let cost = |pose: &Isometry2<f64>, p: &Vector2<f64>| {
        let place = pose.transform_point(&(*p).into()).coords - target.origin;
        target.tree.nearest_within(&place, tau).map_or(tau * tau, |n| n.distance_sq)
    };
    let (mut sum, mut squares) = (0.0, 0.0);
    for block in source.points().chunks(BLOCK) {
        let gained: f64 = block.iter().map(|p| cost(first, p) - cost(second, p)).sum();
        sum += gained;
        squares += gained * gained;
    }
    if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
}

/// The mean of the alignment and the start, weighted by what each knows.
fn with_start(
    found: &Registration<Isometry2<f64>, 3>,
    start: &Isometry2<f64>,
    search: &SearchParams,
) -> Isometry2<f64> {
    let pose = found.target_from_source;
    let back: Vector3<f64> = pose.between(start).log();
    let deviations = [search.translation, search.translation, search.rotation].map(|w| (0.5 * w).max(1e-9));
    let known = Matrix3::from_diagonal(&Vector3::from(deviations.map(|d| 1.0 / (d * d))));
    let step =
        (found.information + known).cholesky().map_or_else(Vector3::zeros, |c| c.solve(&(known * back)));
    pose.compose(&Isometry2::exp(&step))
}

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, SMatrix, Vector2, Vector3};

use super::se2::{SearchParams, branch_and_bound_2d};
use crate::cloud::Cloud;
use crate::icp::{IcpParams, Registration, Target};
use crate::linalg::pseudo_solve;
use crate::{Error, RigidMotion};

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
/// Along degenerate directions the answer is moved to where the start had it, unless that fits worse by more than one
/// standard deviation: the scans say nothing there, and the start may. The deviation is that of the gain in
/// `min(d, τ)²` (`τ` the truncation of the search), summed over runs of ten consecutive points.
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
    if found.is_degenerate() {
        let pose = keep_start(source.points(), &found, start);
        let lost = gain(target, source, &pose, &found.target_from_source, params.search.truncation);
        if lost <= SIGNIFICANT {
            found.target_from_source = pose;
            found.overlap = target.overlap(source, &pose, params.icp.overlap_radius)?.source;
        }
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

/// The pose moved along its degenerate directions to where it moves the points least from where `start` puts them.
fn keep_start(
    points: &[Vector2<f64>],
    found: &Registration<Isometry2<f64>, 3>,
    start: &Isometry2<f64>,
) -> Isometry2<f64> {
    let pose = found.target_from_source;
    let back: Vector3<f64> = pose.between(start).log();
    // mean square displacement of the points under a tangent
    let metric: Matrix3<f64> = points
        .iter()
        .map(|p| {
            let j = <Isometry2<f64> as RigidMotion<2, 3>>::point_jacobian(p);
            j.transpose() * j
        })
        .sum();
    let free = &found.degenerate_directions;
    let basis = Matrix3::from_fn(|i, k| free.get(k).map_or(0.0, |d| d[i]));
    let normal: SMatrix<f64, 3, 3> = basis.transpose() * metric * basis;
    let along = pseudo_solve(&normal, &(basis.transpose() * metric * back), 1e-12);
    pose.compose(&Isometry2::exp(&(basis * along)))
}

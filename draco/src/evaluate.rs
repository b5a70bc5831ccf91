//! Estimates against truth: ATE, precision, recall, consistency of covariances.
//!
//! Truth enters a mission only here. Start with [`absolute_trajectory_error`] and [`grade_closure`].

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, Translation2, UnitComplex, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Absolute trajectory error: distances left between estimated and true positions after one rigid alignment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryError {
    /// Root of the mean squared distance, metres.
    pub rmse_m: f64,
    /// Largest distance, metres.
    pub max_m: f64,
    /// Poses compared.
    pub count: usize,
    /// The alignment: where the estimate's frame lies in the frame of the truth.
    pub truth_from_estimate: Isometry2<f64>,
}

/// The rigid motion that brings `source` closest to `target` in the least-squares sense, pairs given as
/// `(source, target)`; `None` without pairs. A single pair, or coincident points, leave the rotation at identity.
pub fn rigid_alignment(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Isometry2<f64>> {
    if pairs.is_empty() {
        return None;
    }
    let n = pairs.len() as f64;
    let source_mean = pairs.iter().map(|(s, _)| s).sum::<Vector2<f64>>() / n;
    let target_mean = pairs.iter().map(|(_, t)| t).sum::<Vector2<f64>>() / n;
    let (mut dot, mut cross) = (0.0, 0.0);
    for (source, target) in pairs {
        let (s, t) = (source - source_mean, target - target_mean);
        dot += s.dot(&t);
        cross += s.perp(&t);
    }
    let rotation = UnitComplex::new(if dot == 0.0 && cross == 0.0 { 0.0 } else { f64::atan2(cross, dot) });
    Some(Isometry2::from_parts(Translation2::from(target_mean - rotation * source_mean), rotation))
}

/// The error of `estimate` against `truth` after the one rigid alignment that makes it smallest; `None` where
/// fewer than two poses have a truth.
///
/// Only positions are compared. To grade a team in one frame, chain the robots' trajectories.
///
/// ```
/// use draco::evaluate::absolute_trajectory_error;
/// use nalgebra::{Isometry2, Vector2};
///
/// let truth: Vec<_> = (0..4).map(|i| Some(Isometry2::translation(i as f64, (i % 2) as f64))).collect();
/// let moved = Isometry2::new(Vector2::new(7.0, -3.0), 1.0);
/// let estimate: Vec<_> = truth.iter().flatten().map(|pose| moved * pose).collect();
/// let error = absolute_trajectory_error(&estimate, &truth).ok_or("no truth")?;
/// assert!(error.rmse_m < 1e-12 && error.count == 4);
/// # Ok::<(), &str>(())
/// ```
pub fn absolute_trajectory_error<'a>(
    estimate: impl IntoIterator<Item = &'a Isometry2<f64>>,
    truth: impl IntoIterator<Item = &'a Option<Isometry2<f64>>>,
) -> Option<TrajectoryError> {
    let pairs = positions(estimate, truth);
    if pairs.len() < 2 {
        return None;
    }
    left_by(&rigid_alignment(&pairs)?, &pairs)
}

/// The same under an alignment that is known, as one robot's error in the frame of its team; `None` without a truth.
///
/// * `truth_from_estimate` – the alignment, as of the whole team.
pub fn aligned_trajectory_error<'a>(
    truth_from_estimate: &Isometry2<f64>,
    estimate: impl IntoIterator<Item = &'a Isometry2<f64>>,
    truth: impl IntoIterator<Item = &'a Option<Isometry2<f64>>>,
) -> Option<TrajectoryError> {
    left_by(truth_from_estimate, &positions(estimate, truth))
}

/// Estimated and true position of every pose that has a truth.
fn positions<'a>(
    estimate: impl IntoIterator<Item = &'a Isometry2<f64>>,
    truth: impl IntoIterator<Item = &'a Option<Isometry2<f64>>>,
) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let pairs = estimate.into_iter().zip(truth);
    pairs
        .filter_map(|(estimate, truth)| {
            Some((estimate.translation.vector, truth.as_ref()?.translation.vector))
        })
        .collect()
}

/// What the alignment leaves of the distances; `None` without pairs.
fn left_by(
    truth_from_estimate: &Isometry2<f64>,
    pairs: &[(Vector2<f64>, Vector2<f64>)],
) -> Option<TrajectoryError> {
    if pairs.is_empty() {
        return None;
    }
    let truth_from_estimate = *truth_from_estimate;
    let (mut sum_sq, mut max_sq) = (0.0, 0.0_f64);
    for (estimate, truth) in pairs {
        let aligned = truth_from_estimate.rotation * estimate + truth_from_estimate.translation.vector;
        let distance_sq = (aligned - truth).norm_squared();
        sum_sq += distance_sq;
        max_sq = max_sq.max(distance_sq);
    }
    let rmse_m = (sum_sq / pairs.len() as f64).sqrt();
    Some(TrajectoryError { rmse_m, max_m: max_sq.sqrt(), count: pairs.len(), truth_from_estimate })
}

/// How far a closure may be from the truth and still count as right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthLimits {
    /// Largest position error, metres.
    pub position_m: f64,
    /// Largest heading error, radians; not asked where the truth has no heading of its own.
    pub heading_rad: f64,
}

impl TruthLimits {
    /// 2.5 m and 2.5°, the limits of the published system, so that figures can be compared.
    pub const PUBLISHED: Self = Self { position_m: 2.5, heading_rad: 2.5_f64.to_radians() };
    /// 0.5 m and 2°: what a map of half-metre points should reach.
    pub const STRICT: Self = Self { position_m: 0.5, heading_rad: 2.0_f64.to_radians() };

    fn admit(&self, position_error_m: f64, heading_error_rad: Option<f64>) -> bool {
        position_error_m < self.position_m && heading_error_rad.is_none_or(|error| error < self.heading_rad)
    }
}

/// A closure measured against the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosureGrade {
    /// Distance of the measured from the true relative position, metres.
    pub position_error_m: f64,
    /// Size of the heading error, radians; `None` where the truth has no heading of its own.
    pub heading_error_rad: Option<f64>,
    /// Within [`TruthLimits::PUBLISHED`].
    pub correct: bool,
    /// Within [`TruthLimits::STRICT`].
    pub strict: bool,
}

/// Whether the truth can judge headings beside positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeadingTruth {
    /// Headings come from a source of their own and are judged.
    Independent,
    /// Headings share a source with the dead reckoning; only positions are judged.
    Shared,
}

impl HeadingTruth {
    /// From [`MissionData::truth_has_heading`](crate::keyframe::MissionData::truth_has_heading).
    pub fn of(truth_has_heading: bool) -> Self {
        if truth_has_heading { Self::Independent } else { Self::Shared }
    }
}

/// Grades the measurement `a_from_b`, the pose of keyframe b seen from keyframe a, by the true poses of both.
pub fn grade_closure(
    a_from_b: &Isometry2<f64>,
    truth: (&Isometry2<f64>, &Isometry2<f64>),
    heading: HeadingTruth,
) -> ClosureGrade {
    let error = truth.0.inv_mul(truth.1).inv_mul(a_from_b);
    let position_error_m = error.translation.vector.norm();
    let heading_error_rad = (heading == HeadingTruth::Independent).then(|| error.rotation.angle().abs());
    ClosureGrade {
        position_error_m,
        heading_error_rad,
        correct: TruthLimits::PUBLISHED.admit(position_error_m, heading_error_rad),
        strict: TruthLimits::STRICT.admit(position_error_m, heading_error_rad),
    }
}

/// Normalised estimation error squared of a closure, a degree of freedom: 1 on average when `covariance` (of
/// `a_from_b`, order x, y, θ, in the frame of b, as everywhere) tells the truth. Only the position counts where
/// the truth has no heading of its own. `None` when the covariance is not positive definite.
pub fn closure_nees(
    a_from_b: &Isometry2<f64>,
    covariance: &Matrix3<f64>,
    truth: (&Isometry2<f64>, &Isometry2<f64>),
    heading: HeadingTruth,
) -> Option<f64> {
    let error: Vector3<f64> = a_from_b.inv_mul(&truth.0.inv_mul(truth.1)).log();
    match heading {
        HeadingTruth::Independent => Some(error.dot(&covariance.cholesky()?.solve(&error)) / 3.0),
        HeadingTruth::Shared => {
            let position: Vector2<f64> = error.fixed_rows::<2>(0).into();
            let block = covariance.fixed_view::<2, 2>(0, 0).into_owned();
            Some(position.dot(&block.cholesky()?.solve(&position)) / 2.0)
        }
    }
}

/// Counts over a set of closures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ClosureCounts {
    /// Closures that reached a verdict or still wait for one.
    pub proposed: usize,
    /// Of those, the ones accepted.
    pub accepted: usize,
    /// Proposed closures whose truth is known.
    pub graded: usize,
    /// Accepted closures whose truth is known.
    pub graded_accepted: usize,
    /// Proposed closures that are right.
    pub true_proposed: usize,
    /// Accepted closures that are right.
    pub true_accepted: usize,
}

impl ClosureCounts {
    /// Adds one closure; `correct` is `None` where there is no truth.
    pub fn add(&mut self, accepted: Decision, correct: Option<bool>) {
        let accepted = usize::from(accepted == Decision::Accepted);
        let known = usize::from(correct.is_some());
        let right = usize::from(correct == Some(true));
        self.proposed += 1;
        self.accepted += accepted;
        self.graded += known;
        self.graded_accepted += known * accepted;
        self.true_proposed += right;
        self.true_accepted += right * accepted;
    }

    /// Share of the accepted closures that are right; `None` where none can be judged.
    pub fn precision(&self) -> Option<f64> {
        ratio(self.true_accepted, self.graded_accepted)
    }

    /// Share of the right closures that were accepted; `None` where none is right.
    pub fn recall(&self) -> Option<f64> {
        ratio(self.true_accepted, self.true_proposed)
    }
}

/// What became of a closure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Decision {
    /// It constrains the map.
    Accepted,
    /// It was turned down.
    Rejected,
    /// It waits for more evidence and constrains nothing.
    Undecided,
}

fn ratio(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

//! Closures that the estimate made with them contradicts.

use draco_lie::LieGroup;

use super::Robot;
use crate::closure::ClosureParams;
use crate::evaluate::Decision;
use crate::message::ClosureEntry;
use crate::two_step::TeamEstimate;

/// A closure nearer than this to the estimate is never taken back, metres and radians: half the spacing of a scan's
/// points, and what that is at the far end of a submap.
const LEAST_RESIDUAL: f64 = 0.25;
const LEAST_RESIDUAL_ANGLE: f64 = 0.0125;

impl Robot {
    /// Takes back accepted closures that are too far from the team's estimate, and doubts those that are far. Returns whether
    /// there were any.
    ///
    /// A consistency test asks whether closures agree within their covariances. One that is off by more than it is good
    /// for, but says so, passes it; seen against all others it shows. Most of those that are merely far are right, and the
    /// estimate is wrong there, so they stay in the graph, undecided, under the kernel of closures that may be wrong. Nothing
    /// is forgotten: the next estimate judges all again.
    pub(super) fn retract_contradicted(&mut self) -> bool {
        let verdicts = verdicts(&self.accepted, &self.team, &self.params.closure);
        let all = std::mem::take(&mut self.accepted);
        let before = all.len();
        for (closure, verdict) in all.into_iter().zip(verdicts) {
            let reason = match verdict {
                Decision::Accepted => {
                    self.accepted.push(closure);
                    continue;
                }
                Decision::Undecided => "far from the team's estimate",
                Decision::Rejected => "the team's estimate contradicts it",
            };
            if let Some(proposal) = self.proposals.get_mut(&(closure.source, closure.target)) {
                proposal.decision = verdict;
                proposal.reason = reason.into();
            }
            if verdict == Decision::Undecided {
                self.doubtful.push(closure);
            }
        }
        self.accepted.len() < before
    }
}

/// Which closures the estimate bears out, doubts and contradicts; it bears out those between poses it does not hold.
///
/// What is far is measured by what most closures are off: the estimate's own error and the registrations' both show in
/// that, and a single covariance tells neither whether its map is bent nor whether its match slid.
fn verdicts(closures: &[ClosureEntry], team: &TeamEstimate, params: &ClosureParams) -> Vec<Decision> {
    let residuals: Vec<Option<[f64; 2]>> = closures.iter().map(|c| residual(c, team)).collect();
    let limit = |of: usize, least: f64, most: f64| {
        let mut sizes: Vec<f64> = residuals.iter().flatten().map(|r| r[of]).collect();
        sizes.sort_by(f64::total_cmp);
        let median = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
        (params.max_residual_medians * median).clamp(least.min(most), most)
    };
    let position = limit(0, LEAST_RESIDUAL, params.max_residual);
    let angle = limit(1, LEAST_RESIDUAL_ANGLE, params.max_residual_angle);
    let verdict = |[p, a]: [f64; 2]| {
        if p <= position && a <= angle {
            Decision::Accepted
        } else if p <= params.max_residual && a <= params.max_residual_angle {
            Decision::Undecided
        } else {
            Decision::Rejected
        }
    };
    residuals.into_iter().map(|r| r.map_or(Decision::Accepted, verdict)).collect()
}

/// What a closure and the estimate differ by: metres, radians.
fn residual(closure: &ClosureEntry, team: &TeamEstimate) -> Option<[f64; 2]> {
    let estimated = team.pose(closure.target)?.between(team.pose(closure.source)?);
    let off = closure.measured.between(&estimated);
    Some([off.translation.vector.norm(), off.rotation.angle().abs()])
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry2, Matrix3, Vector3};

    use super::*;
    use crate::message::KeyframeId;

    fn closure(index: u32, off: [f64; 3]) -> ClosureEntry {
        let keyframe = |robot| KeyframeId { robot, index };
        let measured = Isometry2::new([off[0], off[1]].into(), off[2]);
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.04, 0.04, 0.0009));
        ClosureEntry { source: keyframe(2), target: keyframe(1), measured, covariance }
    }

    #[test]
    fn what_lies_far_from_the_estimate_is_doubted_and_what_contradicts_it_goes() {
        let off = [
            [0.3, 0.0, 0.0],
            [0.0, -0.3, 0.01],
            [2.6, 0.0, 0.0],
            [0.2, 0.2, 0.0],
            [0.1, 0.1, 0.05],
            [0.3, 0.1, 0.02],
            [1.8, 0.0, 0.01],
        ];
        let mut closures: Vec<_> = (0..).zip(off).map(|(k, off)| closure(k, off)).collect();
        // between poses that the estimate does not hold
        closures.push(closure(99, [9.0, 0.0, 0.0]));
        let poses = vec![Isometry2::identity(); 10];
        let team = TeamEstimate::from_trajectories([(1, poses.clone()), (2, poses)]);
        let verdicts = verdicts(&closures, &team, &ClosureParams::default());
        use Decision::{Accepted, Rejected, Undecided};
        assert_eq!(
            verdicts,
            [Accepted, Accepted, Rejected, Accepted, Rejected, Accepted, Undecided, Accepted]
        );
    }
}

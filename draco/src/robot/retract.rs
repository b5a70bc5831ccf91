//! Closures that the estimate made with them contradicts.

use draco_lie::LieGroup;
use nalgebra::Vector3;

use super::Robot;
use crate::closure::ClosureParams;
use crate::evaluate::Decision;
use crate::message::ClosureEntry;
use crate::two_step::TeamEstimate;

/// Median of chi² with three degrees of freedom.
const MEDIAN_CHI2: f64 = 2.366;

impl Robot {
    /// Takes back accepted closures that are too far from the team's estimate. Returns whether there were any.
    ///
    /// A consistency test asks whether closures agree within their covariances. One that is off by more than it is good
    /// for, but says so, passes it; seen against all others it shows. Taken back is not forgotten: the next estimate
    /// judges it again.
    pub(super) fn retract_contradicted(&mut self) -> bool {
        let kept = kept(&self.accepted, &self.team, &self.params.closure);
        let all = std::mem::take(&mut self.accepted);
        let before = all.len();
        for (closure, kept) in all.into_iter().zip(kept) {
            if kept {
                self.accepted.push(closure);
            } else if let Some(proposal) = self.proposals.get_mut(&(closure.source, closure.target)) {
                proposal.decision = Decision::Rejected;
                proposal.reason = "the team's estimate contradicts it".into();
            }
        }
        self.accepted.len() < before
    }
}

/// Which closures are near enough to the estimate; those between poses it does not hold are.
fn kept(closures: &[ClosureEntry], team: &TeamEstimate, params: &ClosureParams) -> Vec<bool> {
    let residuals: Vec<Option<(Vector3<f64>, f64)>> = closures.iter().map(|c| residual(c, team)).collect();
    let mut chi2: Vec<f64> = residuals.iter().flatten().map(|(_, chi2)| *chi2).collect();
    chi2.sort_by(f64::total_cmp);
    // the covariances' common misjudgement
    let scale = chi2.get(chi2.len() / 2).map_or(1.0, |median| median / MEDIAN_CHI2);
    let limit = scale * params.max_residual_sigmas.powi(2);
    let near = |(off, chi2): (Vector3<f64>, f64)| {
        off.xy().norm() <= params.max_residual && off.z.abs() <= params.max_residual_angle && chi2 <= limit
    };
    residuals.into_iter().map(|residual| residual.is_none_or(near)).collect()
}

/// What a closure and the estimate differ by, and its chi².
fn residual(closure: &ClosureEntry, team: &TeamEstimate) -> Option<(Vector3<f64>, f64)> {
    let estimated = team.pose(closure.target)?.between(team.pose(closure.source)?);
    let off = closure.measured.between(&estimated).log();
    Some((off, off.dot(&closure.covariance.cholesky()?.solve(&off))))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry2, Matrix3};

    use super::*;
    use crate::message::KeyframeId;

    fn closure(index: u32, off: [f64; 3]) -> ClosureEntry {
        let keyframe = |robot| KeyframeId { robot, index };
        let measured = Isometry2::new([off[0], off[1]].into(), off[2]);
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.04, 0.04, 0.0009));
        ClosureEntry { source: keyframe(2), target: keyframe(1), measured, covariance }
    }

    #[test]
    fn what_lies_far_from_the_estimate_goes_and_the_rest_stays() {
        let off = [
            [0.3, 0.0, 0.0],
            [0.0, -0.3, 0.01],
            [2.6, 0.0, 0.0],
            [0.2, 0.2, 0.0],
            [0.1, 0.1, 0.05],
            [0.3, 0.1, 0.02],
        ];
        let mut closures: Vec<_> = (0..).zip(off).map(|(k, off)| closure(k, off)).collect();
        // between poses that the estimate does not hold
        closures.push(closure(99, [9.0, 0.0, 0.0]));
        let poses = vec![Isometry2::identity(); 10];
        let team = TeamEstimate::from_trajectories([(1, poses.clone()), (2, poses)]);
        let kept = kept(&closures, &team, &ClosureParams::default());
        assert_eq!(kept, [true, true, false, true, false, true, true]);
    }
}

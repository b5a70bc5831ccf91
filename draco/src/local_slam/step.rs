use draco_lie::LieGroup;
use draco_registration::correlative::CorrelativeMatch;
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::matching::{turn_about, turn_covariance};

/// Least ratio of the scan's own information to that of odometry for a direction to count as seen.
const SEEN: f64 = 0.2;

/// What a scan alone says about a step, odometry taken out again: a Gaussian that may know nothing in some
/// directions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct ScanFactor {
    /// Pose of the new keyframe in the one before.
    pub(super) measured: Isometry2<f64>,
    /// Information in the new keyframe's frame, order x, y, heading; positive semidefinite.
    pub(super) information: Matrix3<f64>,
    /// Centroid of the scan's points in the new keyframe's frame, metres: what a wrong heading turns about.
    pub(super) centroid: Vector2<f64>,
}

impl ScanFactor {
    /// Divides the posterior of a match by the prior it was made with.
    ///
    /// Odometry enters the graph by its own factor, whose calibration may still change; were the posterior used as it
    /// is, odometry would count twice, and with the calibration of that day.
    pub(super) fn without_prior(
        found: &CorrelativeMatch,
        start: &Isometry2<f64>,
        prior: &Matrix3<f64>,
        centroid: Vector2<f64>,
    ) -> Option<Self> {
        let root = prior.cholesky()?.l();
        let whiten = root.try_inverse()?;
        let offset = whiten * found.target_from_source.minus(start);
        let posterior = (whiten * found.covariance * whiten.transpose()).try_inverse()?;
        let eigen = (posterior - Matrix3::identity()).symmetric_eigen();
        let (mut mean, mut information) = (Vector3::zeros(), Matrix3::zeros());
        for (k, direction) in eigen.eigenvectors.column_iter().enumerate() {
            let own = eigen.eigenvalues[k];
            if own > SEEN {
                mean += direction * (direction.dot(&offset) * (own + 1.0) / own);
                information += direction * own * direction.transpose();
            }
        }
        let information = whiten.transpose() * information * whiten;
        Some(Self {
            measured: start.plus(&(root * mean)),
            information: (information + information.transpose()) * 0.5,
            centroid,
        })
    }

    /// The factor with headings that are off by `sigma` radians more than the match knew.
    pub(super) fn turned(self, sigma: f64) -> Self {
        self.blurred(&turn_covariance(&self.centroid, sigma))
    }

    /// What the factor knows of a turn about the centroid of its points.
    pub(super) fn turning_information(&self) -> f64 {
        let about = turn_about(&self.centroid);
        about.dot(&(self.information * about)).max(0.0)
    }

    /// The factor with the information a Cauchy kernel of this scale leaves it at the estimate `relative`.
    pub(super) fn weighed(&self, relative: &Isometry2<f64>, scale: f64) -> Self {
        let error = self.measured.between(relative).log();
        let chi2 = error.dot(&(self.information * error));
        Self { information: self.information / (1.0 + chi2 / (scale * scale)), ..*self }
    }

    /// The factor with `extra` added to its covariance.
    pub(super) fn blurred(self, extra: &Matrix3<f64>) -> Self {
        let widened = (Matrix3::identity() + self.information * extra).try_inverse();
        let information = widened.map_or(self.information, |w| w * self.information);
        Self { information: (information + information.transpose()) * 0.5, ..self }
    }

    /// The product of this and odometry: pose and covariance. `None` when the sum of both informations has no inverse.
    pub(super) fn fused(
        &self,
        odometry: &Isometry2<f64>,
        prior: &Matrix3<f64>,
    ) -> Option<(Isometry2<f64>, Matrix3<f64>)> {
        let fused = (prior.try_inverse()? + self.information).try_inverse()?;
        let offset = fused * self.information * self.measured.minus(odometry);
        Some((odometry.plus(&offset), fused))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taking_the_prior_out_and_putting_it_back_changes_nothing() {
        let start = Isometry2::new([2.5, 0.1].into(), 0.2);
        let prior = Matrix3::from_diagonal(&Vector3::new(0.36, 0.36, 0.0002));
        let covariance = Matrix3::new(0.1, 0.05, 0.0, 0.05, 0.12, 0.0005, 0.0, 0.0005, 0.0001);
        let found = CorrelativeMatch {
            target_from_source: start.plus(&Vector3::new(0.4, -0.3, 0.01)),
            covariance,
            score: 0.5,
            far_ratio: 0.0,
            background: 0.1,
            at_border: false,
        };
        let scan = ScanFactor::without_prior(&found, &start, &prior, Vector2::zeros()).unwrap();
        let (pose, fused) = scan.fused(&start, &prior).unwrap();
        assert!(pose.minus(&found.target_from_source).norm() < 1e-3, "{pose}");
        assert!((fused - covariance).norm() < 1e-9, "{fused}");
    }

    #[test]
    fn a_direction_only_odometry_saw_stays_without_information() {
        let start = Isometry2::identity();
        let prior = Matrix3::from_diagonal(&Vector3::new(0.36, 0.36, 0.0002));
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.35, 0.04, 0.0001));
        let found = CorrelativeMatch {
            target_from_source: Isometry2::new([0.2, 0.3].into(), 0.0),
            covariance,
            score: 0.5,
            far_ratio: 0.0,
            background: 0.1,
            at_border: false,
        };
        let scan = ScanFactor::without_prior(&found, &start, &prior, Vector2::zeros()).unwrap();
        assert!(scan.information[(0, 0)].abs() < 1e-12, "{}", scan.information);
        assert!(scan.information[(1, 1)] > 10.0);
    }
}

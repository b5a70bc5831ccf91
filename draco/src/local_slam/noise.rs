//! How far odometry is off from step to step, from the scans that have been matched.

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, Vector3};

use super::LocalSlam;
use super::step::ScanFactor;

/// Degrees of freedom of the distribution of a match around odometry: few, since some matches are wrong.
const FREEDOM: f64 = 3.0;

/// Share of a match's own covariance that explains its difference from odometry. Small, because that covariance is made
/// for the worst place: almost all of the difference counts as odometry's, which errs to the safe side.
const MATCH_SHARE: f64 = 0.01;

/// Standard deviations tried: the largest, and each this much smaller than the one before.
const RATIO: f64 = 0.9;
const TRIED: i32 = 30;

/// Covariance of a pose known to `sigma` metres along both axes and `angle` radians.
pub(super) fn covariance(sigma: f64, angle: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(sigma * sigma, sigma * sigma, angle * angle))
}

impl LocalSlam {
    /// Sets the standard deviation of a step of odometry to the likeliest by the matches so far, at most the default.
    ///
    /// Student's t in place of the Gaussian keeps wrong matches from being taken for poor odometry.
    pub(super) fn calibrate_noise(&mut self) {
        let params = &self.params;
        let matched = self.steps.iter().filter_map(|step| Some((self.predicted(step), step.scan.as_ref()?)));
        let pairs: Vec<(Isometry2<f64>, &ScanFactor)> = matched.collect();
        let log_posterior = |sigma: f64| {
            let noise = covariance(sigma, params.odometry_sigma_angle);
            let likelihood: f64 =
                pairs.iter().map(|(odometry, scan)| log_likelihood(odometry, scan, &noise)).sum();
            let off = (sigma / params.odometry_sigma).ln() / params.odometry_spread;
            likelihood - 0.5 * off * off
        };
        let tried = (0..TRIED).rev().map(|k| params.odometry_sigma * RATIO.powi(k));
        let best = tried.map(|sigma| (log_posterior(sigma), sigma)).max_by(|a, b| a.0.total_cmp(&b.0));
        self.sigma = best.map_or(params.odometry_sigma, |(_, sigma)| sigma);
    }
}

/// Log likelihood, up to a constant, of what a scan says about a step when odometry has the covariance `noise`.
///
/// The information `L` of the scan may be singular, so `(L⁻¹ + P)⁻¹` is taken as `(1 + L P)⁻¹ L`.
fn log_likelihood(odometry: &Isometry2<f64>, scan: &ScanFactor, noise: &Matrix3<f64>) -> f64 {
    let information = scan.information / MATCH_SHARE;
    let spread = Matrix3::identity() + information * noise;
    let Some(inverse) = spread.try_inverse() else { return 0.0 };
    let off = scan.measured.minus(odometry);
    let chi2 = off.dot(&(inverse * information * off)).max(0.0);
    let dimension = 3.0;
    -0.5 * spread.determinant().max(f64::MIN_POSITIVE).ln()
        - 0.5 * (FREEDOM + dimension) * (chi2 / FREEDOM).ln_1p()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::super::{LocalSlamParams, Step};
    use super::*;

    /// A robot whose odometry is off by `sigma`, with a match every step, of which each tenth is wrong by 2 m.
    fn calibrated(sigma: f64, steps: usize) -> f64 {
        let mut slam = LocalSlam::new(LocalSlamParams::default());
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let noise = Normal::new(0.0, sigma).unwrap();
        let information = covariance(0.2, 0.01).try_inverse().unwrap();
        slam.steps = (0..steps)
            .map(|k| {
                let odometry = Isometry2::translation(3.0, 0.0);
                let wrong = if k % 10 == 9 { 2.0 } else { 0.0 };
                let off = Vector3::new(noise.sample(&mut rng) + wrong, noise.sample(&mut rng), 0.0);
                let scan = Some(ScanFactor { measured: odometry.plus(&off), information });
                Step { odometry, scan }
            })
            .collect();
        slam.calibrate_noise();
        slam.odometry_sigma()
    }

    #[test]
    fn the_spread_of_matches_around_odometry_is_found_in_spite_of_wrong_ones() {
        for sigma in [0.1, 0.2, 0.4] {
            let found = calibrated(sigma, 100);
            assert!((0.8 * sigma..1.4 * sigma).contains(&found), "{found} for {sigma}");
        }
    }

    #[test]
    fn without_matches_and_with_poor_odometry_the_default_stays() {
        assert_eq!(calibrated(0.1, 0), 0.6);
        assert_eq!(calibrated(2.0, 100), 0.6);
    }
}

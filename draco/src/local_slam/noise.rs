//! How far odometry is off from step to step, and the matches' headings beyond what they tell, from the scans that have
//! been matched.

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

/// Errors of the matches' headings tried: from none to this many times the noise of odometry's, in equal steps.
const LARGEST_TURN: f64 = 3.0;
const TURNS: i32 = 30;

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
        let pairs = self.matched();
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

    /// Sets what the matches' headings are off by beyond what they tell to the likeliest.
    ///
    /// The heading of odometry comes from an instrument whose noise is known, so what matches differ from it by more than
    /// both tell is the matches' own: streaks that lie across one another, a map that is bent. Odometry's noise is never
    /// taken down here, for where the two agree nobody can tell which is the better one.
    pub(super) fn calibrate_headings(&mut self) {
        let told = self.params.odometry_sigma_angle;
        // how far each match is turned from odometry, and the variance that both tell of that
        let turned: Vec<(f64, f64)> = self
            .matched()
            .into_iter()
            .filter_map(|(odometry, scan)| {
                let information = scan.turning_information();
                let off = scan.measured.minus(&odometry).z;
                (information > 0.0).then(|| (off, told * told + information.recip()))
            })
            .collect();
        let log_posterior = |turn: f64| {
            let likelihood = |(off, variance): &(f64, f64)| {
                let variance = variance + turn * turn;
                -0.5 * variance.ln() + log_student(off * off / variance, 1.0)
            };
            turned.iter().map(likelihood).sum::<f64>() - 0.5 * (turn / told).powi(2)
        };
        let tried = (0..=TURNS).map(|k| LARGEST_TURN * told * f64::from(k) / f64::from(TURNS));
        let best = tried
            .map(|turn| (log_posterior(turn), turn))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        self.turn = best.map_or(0.0, |(_, turn)| turn);
    }

    /// Every matched step: odometry as calibrated so far, and what the scan says.
    fn matched(&self) -> Vec<(Isometry2<f64>, &ScanFactor)> {
        self.steps.iter().filter_map(|step| Some((self.predicted(step), step.scan.as_ref()?))).collect()
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
    -0.5 * spread.determinant().max(f64::MIN_POSITIVE).ln() + log_student(chi2, 3.0)
}

/// What Student's t takes off the logarithm of its density at `chi2` from the centre.
fn log_student(chi2: f64, dimension: f64) -> f64 {
    -0.5 * (FREEDOM + dimension) * (chi2 / FREEDOM).ln_1p()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::super::{LocalSlamParams, Step};
    use super::*;

    /// A robot with a match every step, off from odometry by what `off` makes of the step's number and normal draws.
    fn matched(
        steps: usize,
        mut off: impl FnMut(usize, &mut dyn FnMut() -> f64) -> Vector3<f64>,
    ) -> LocalSlam {
        let mut slam = LocalSlam::new(LocalSlamParams::default());
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let noise = Normal::new(0.0, 1.0).unwrap();
        let information = covariance(0.2, 0.005).try_inverse().unwrap();
        slam.steps = (0..steps)
            .map(|k| {
                let odometry = Isometry2::translation(3.0, 0.0);
                let measured = odometry.plus(&off(k, &mut || noise.sample(&mut rng)));
                Step {
                    odometry,
                    scan: Some(ScanFactor { measured, information, centroid: Vector2::zeros() }),
                }
            })
            .collect();
        slam
    }

    /// A robot whose odometry is off by `sigma`, and of whose matches each tenth is wrong by 2 m.
    fn calibrated(sigma: f64, steps: usize) -> f64 {
        let mut slam = matched(steps, |k, draw| {
            let wrong = if k % 10 == 9 { 2.0 } else { 0.0 };
            Vector3::new(sigma * draw() + wrong, sigma * draw(), 0.0)
        });
        slam.calibrate_noise();
        slam.odometry_sigma()
    }

    #[test]
    fn headings_worse_than_told_are_found_and_honest_ones_left() {
        let turn = |sigma: f64| {
            let mut slam = matched(100, |k, draw| {
                let wrong = if k % 10 == 9 { 0.3 } else { 0.0 };
                Vector3::new(0.1 * draw(), 0.1 * draw(), sigma * draw() + wrong)
            });
            slam.calibrate_headings();
            slam.match_sigma_angle()
        };
        // odometry 0.015 and the matches 0.005 rad, as told
        assert!(turn(0.0158) < 0.012, "{}", turn(0.0158));
        for extra in [0.02f64, 0.03] {
            let found = turn(extra.hypot(0.0158));
            assert!((0.75 * extra..1.35 * extra).contains(&found), "{found} for {extra}");
        }
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

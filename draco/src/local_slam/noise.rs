//! How far odometry is off from step to step, and the matches' headings beyond what they tell, from the scans that have
//! been matched.

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, UnitComplex, Vector3};
use statrs::function::gamma::ln_gamma;

use super::LocalSlam;
use super::loops::OwnClosure;
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

/// Noises of odometry's headings tried: what it is told to be, and each this much larger than the one before.
const ANGLE_RATIO: f64 = 1.25;
const ANGLES: i32 = 9;

/// Share of a span's likelihood that counts: each step lies in as many.
const SPAN_SHARE: f64 = 0.1;

/// Degrees of freedom tried for the matches' distribution around odometry: from one in which most are doubtful to the
/// Gaussian, nearly.
const FREEDOMS: [f64; 11] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 32.0, 50.0];
/// Square of the kernel's scale over the degrees of freedom. A t distribution of ν degrees weighs what lies `r` off by
/// `1 / (1 + r²/ν)`; half of that, because a match's covariance is made for the worst place, so its `r` come out small.
const KERNEL_SHARE: f64 = 0.5;

/// A submap registered with one a few steps before.
struct Span {
    steps: f64,
    /// What the registration tells of its heading's variance.
    variance: f64,
    /// How far it is turned from what odometry tells, radians.
    off: f64,
}

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
            let noise = covariance(sigma, self.sigma_angle);
            let likelihood: f64 =
                pairs.iter().map(|(odometry, scan)| log_likelihood(odometry, scan, &noise)).sum();
            let off = (sigma / params.odometry_sigma).ln() / params.odometry_spread;
            likelihood - 0.5 * off * off
        };
        let tried = (0..TRIED).map(|k| params.odometry_sigma * RATIO.powi(k));
        self.sigma = likeliest(tried, log_posterior).unwrap_or(params.odometry_sigma);
    }

    /// Sets the scale of the kernel on what scans say to what the likeliest tails of the matches around odometry make it,
    /// at most the one told.
    ///
    /// Where scans slide along walls many matches are off by several times what they tell, and a wide kernel believes them;
    /// where none do, a narrow one throws away what they are good for.
    ///
    /// **Source**: the degrees of freedom of Student's t by maximum likelihood (K. Lange, R. Little, J. Taylor, *Robust
    /// statistical modeling using the t distribution*, 1989), here on a grid and for the kernel's scale alone.
    pub(super) fn calibrate_kernel(&mut self) {
        let noise = covariance(self.sigma, self.sigma_angle);
        let off: Vec<f64> =
            self.matched().iter().map(|(odometry, scan)| distance(odometry, scan, &noise).0).collect();
        let log_likelihood = |freedom: f64| {
            let size = ln_gamma(0.5 * (freedom + 3.0)) - ln_gamma(0.5 * freedom) - 1.5 * freedom.ln();
            off.iter().map(|chi2| size + log_student(*chi2, 3.0, freedom)).sum::<f64>()
        };
        let told = self.params.step_cauchy;
        let found = likeliest(FREEDOMS.into_iter().rev(), log_likelihood);
        self.kernel = found.map_or(told, |freedom| told.min((KERNEL_SHARE * freedom).sqrt()));
    }

    /// Sets the standard deviation of a step's heading by odometry to the likeliest by the registrations of submaps with those
    /// a few steps before, at least the default.
    ///
    /// A step tells only how far odometry and match differ, and [`LocalSlam::calibrate_turn`] takes that for the match's as far as
    /// the instrument is as good as told. Whether it is, submaps tell that are registered with each other over several steps:
    /// they owe nothing to the odometry between.
    pub(super) fn calibrate_odometry_heading(&mut self) {
        let told = self.params.odometry_sigma_angle;
        let spans = self.spans();
        let log_posterior = |sigma: f64| {
            let likelihood = |span: &Span| {
                let variance = span.variance + self.turn * self.turn + span.steps * sigma * sigma;
                -0.5 * variance.ln() + log_student(span.off * span.off / variance, 1.0, FREEDOM)
            };
            let off = (sigma / told).ln() / self.params.odometry_spread;
            SPAN_SHARE * spans.iter().map(likelihood).sum::<f64>() - 0.5 * off * off
        };
        let tried = (0..ANGLES).map(|k| told * ANGLE_RATIO.powi(k));
        self.sigma_angle = likeliest(tried, log_posterior).unwrap_or(told);
    }

    /// The closures over a few steps, against what lies between by odometry.
    fn spans(&self) -> Vec<Span> {
        let longest = self.params.loops.submaps_before * (2 * self.params.loops.source_half + 1);
        let span = |closure: &OwnClosure| {
            let between = self.steps.get(closure.target..closure.source)?;
            if between.len() > longest {
                return None;
            }
            let turned: f64 = between.iter().map(|step| self.predicted(step).rotation.angle()).sum();
            Some(Span {
                steps: between.len() as f64,
                variance: closure.covariance[(2, 2)],
                off: (closure.measured.rotation * UnitComplex::new(-turned)).angle(),
            })
        };
        self.closures.iter().filter_map(span).collect()
    }

    /// Sets what the matches' headings are off by beyond what they tell to the likeliest.
    ///
    /// The heading of odometry comes from an instrument whose noise is known, so what matches differ from it by more than
    /// both tell is the matches' own: streaks that lie across one another, a map that is bent. Odometry's noise is never
    /// taken down here, for where the two agree nobody can tell which is the better one.
    pub(super) fn calibrate_turn(&mut self) {
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
                -0.5 * variance.ln() + log_student(off * off / variance, 1.0, FREEDOM)
            };
            turned.iter().map(likelihood).sum::<f64>() - 0.5 * (turn / told).powi(2)
        };
        let tried = (0..=TURNS).map(|k| LARGEST_TURN * told * f64::from(k) / f64::from(TURNS));
        self.turn = likeliest(tried, log_posterior).unwrap_or(0.0);
    }

    /// Every matched step: odometry as calibrated so far, and what the scan says.
    fn matched(&self) -> Vec<(Isometry2<f64>, &ScanFactor)> {
        self.steps.iter().filter_map(|step| Some((self.predicted(step), step.scan.as_ref()?))).collect()
    }
}

/// The value tried that is likeliest, of equals the first.
fn likeliest(tried: impl Iterator<Item = f64>, log_posterior: impl Fn(f64) -> f64) -> Option<f64> {
    let best = tried
        .map(|value| (log_posterior(value), value))
        .reduce(|best, next| if next.0.total_cmp(&best.0).is_gt() { next } else { best });
    best.map(|(_, value)| value)
}

/// Log likelihood, up to a constant, of what a scan says about a step when odometry has the covariance `noise`.
fn log_likelihood(odometry: &Isometry2<f64>, scan: &ScanFactor, noise: &Matrix3<f64>) -> f64 {
    let (chi2, determinant) = distance(odometry, scan, noise);
    -0.5 * determinant.ln() + log_student(chi2, 3.0, FREEDOM)
}

/// Squared distance of what a scan says about a step from odometry with the covariance `noise`, in what both tell, and
/// the determinant of that over the scan's own.
///
/// The information `L` of the scan may be singular, so `(L⁻¹ + P)⁻¹` is taken as `(1 + L P)⁻¹ L`.
fn distance(odometry: &Isometry2<f64>, scan: &ScanFactor, noise: &Matrix3<f64>) -> (f64, f64) {
    let information = scan.information / MATCH_SHARE;
    let spread = Matrix3::identity() + information * noise;
    let Some(inverse) = spread.try_inverse() else { return (0.0, 1.0) };
    let off = scan.measured.minus(odometry);
    let chi2 = off.dot(&(inverse * information * off)).max(0.0);
    (chi2, spread.determinant().max(f64::MIN_POSITIVE))
}

/// What Student's t takes off the logarithm of its density at `chi2` from the centre.
fn log_student(chi2: f64, dimension: f64, freedom: f64) -> f64 {
    -0.5 * (freedom + dimension) * (chi2 / freedom).ln_1p()
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
            slam.calibrate_turn();
            slam.match_sigma_angle()
        };
        // odometry 0.015 and the matches 0.005 rad, as told
        assert!(turn(0.0158) < 0.012, "{}", turn(0.0158));
        for extra in [0.02f64, 0.03] {
            let found = turn(extra.hypot(0.0158));
            assert!((0.75 * extra..1.35 * extra).contains(&found), "{found} for {extra}");
        }
    }

    /// Closures of each keyframe with those 5 and 10 before, right to 0.005 rad, for odometry off by `sigma` radians.
    fn heading_found(sigma: f64) -> f64 {
        let mut slam = matched(0, |_, _| Vector3::zeros());
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let noise = Normal::new(0.0, 1.0).unwrap();
        let mut off = vec![0.0];
        for k in 0..300 {
            off.push(off[k] + sigma * noise.sample(&mut rng));
            slam.steps.push(Step { odometry: Isometry2::translation(3.0, 0.0), scan: None });
            for steps in [5, 10] {
                if let Some(target) = (k + 1).checked_sub(steps) {
                    // each tenth is wrong
                    let wrong = if k % 10 == 9 { 0.5 } else { 0.0 };
                    let turned = off[k + 1] - off[target] + 0.005 * noise.sample(&mut rng) + wrong;
                    slam.closures.push(OwnClosure {
                        source: k + 1,
                        target,
                        measured: Isometry2::new([3.0 * steps as f64, 0.0].into(), turned),
                        covariance: covariance(0.2, 0.005),
                        accepted: false,
                    });
                }
            }
        }
        slam.calibrate_odometry_heading();
        slam.odometry_sigma_angle()
    }

    #[test]
    fn odometry_whose_heading_is_worse_than_told_is_found_and_honest_odometry_left() {
        assert_eq!(heading_found(0.005), 0.015);
        assert!(heading_found(0.015) < 0.02, "{}", heading_found(0.015));
        for sigma in [0.03, 0.06] {
            let found = heading_found(sigma);
            assert!((0.6 * sigma..1.4 * sigma).contains(&found), "{found} for {sigma}");
        }
    }

    #[test]
    fn the_kernel_narrows_where_matches_slide_and_stays_wide_where_they_do_not() {
        let scale = |each: usize| {
            let mut slam = matched(100, |k, draw| {
                let slid = if k % each == 0 { 6.0 } else { 1.0 };
                Vector3::new(0.2 * slid * draw(), 0.2 * slid * draw(), 0.01 * draw())
            });
            slam.calibrate_noise();
            slam.calibrate_kernel();
            slam.step_kernel()
        };
        assert_eq!(scale(1000), 2.0);
        assert!((0.7..1.5).contains(&scale(4)), "{}", scale(4));
        let mut without = matched(0, |_, _| Vector3::zeros());
        without.calibrate_kernel();
        assert_eq!(without.step_kernel(), 2.0);
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

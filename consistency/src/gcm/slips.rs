use std::ops::Range;

use nalgebra::linalg::Cholesky;
use nalgebra::{SMatrix, SVector};

use super::params::GcmParams;
use crate::{Pose, isotropic_covariance};

/// Share and width over `S_T`'s of the normals that slips are made of: a scale known to within an octave.
const WIDTHS: [(f64, f64); 3] = [(0.25, 0.5), (0.5, 1.0), (0.25, 2.0)];

/// What is thought of a slip before any is seen: one of three widths, and none shorter than `least_slip`; of a yaw
/// slip, that none is smaller than `least_yaw`.
///
/// The beam searches with one normal as wide as all together in the mean square; afterwards each hypothesis gets the
/// evidence of the mixture.
#[derive(Clone, Copy)]
pub(crate) struct SlipPrior<const N: usize> {
    least: f64,
    searched: SMatrix<f64, N, N>,
    searched_information: SMatrix<f64, N, N>,
    widths: [Width<N>; 3],
    least_yaw: f64,
    /// `log P(|θ| > least_yaw | S_Y)`.
    log_turned: f64,
}

#[derive(Clone, Copy)]
struct Width<const N: usize> {
    information: SMatrix<f64, N, N>,
    /// `log(share / sqrt(det S) / P(|t| > least))`.
    log_weight: f64,
}

impl<const N: usize> SlipPrior<N> {
    pub(crate) fn new<G: Pose<N>>(params: &GcmParams) -> Self {
        let least = params.least_slip;
        let width = |(share, factor): (f64, f64)| {
            let metres = factor * params.slip.translation;
            let covariance = isotropic_covariance::<N, G>(metres, params.slip.rotation);
            let information = isotropic_covariance::<N, G>(metres.recip(), params.slip.rotation.recip());
            let longer = share_longer(&SVector::zeros(), &covariance, 0..G::TRANSLATION, least);
            Width { information, log_weight: (share / longer).ln() + half_log_determinant(&information) }
        };
        let mean_square: f64 = WIDTHS.iter().map(|(share, factor)| share * factor * factor).sum();
        let yaw = isotropic_covariance::<N, G>(params.yaw.translation, params.yaw.rotation);
        let (metres, radians) = (mean_square.sqrt() * params.slip.translation, params.slip.rotation);
        Self {
            least,
            searched: isotropic_covariance::<N, G>(metres, radians),
            searched_information: isotropic_covariance::<N, G>(metres.recip(), radians.recip()),
            widths: WIDTHS.map(width),
            least_yaw: params.least_yaw,
            log_turned: share_longer(&SVector::zeros(), &yaw, G::TRANSLATION..N, params.least_yaw).ln(),
        }
    }

    /// The covariance that the beam searches with.
    pub(crate) fn searched(&self) -> &SMatrix<f64, N, N> {
        &self.searched
    }

    /// log of the evidence with this prior over the evidence with the normal searched with, under which the slip came
    /// out as `mean` and `covariance`.
    ///
    /// ```text
    /// 1/C_k = 1/C - 1/S + 1/S_k        η = m/C
    /// ratio = Σ_k w_k sqrt(|S| |C_k| / (|S_k| |C|)) exp(½ η (C_k - C) η) P(|t| > least | η, C_k) / P(|t| > least | S_k)
    /// ```
    pub(crate) fn log_evidence<G: Pose<N>>(
        &self,
        mean: &SVector<f64, N>,
        covariance: &SMatrix<f64, N, N>,
    ) -> f64 {
        let Some(found) = Cholesky::new(*covariance) else { return 0.0 };
        let (eta, seen) = (found.solve(mean), found.inverse() - self.searched_information);
        let log_base = half_log_determinant(covariance)
            + half_log_determinant(&self.searched_information)
            + 0.5 * eta.dot(mean);
        let of_width = |width: &Width<N>| -> Option<f64> {
            let inverse = seen + width.information;
            let narrowed = Cholesky::new((inverse + inverse.transpose()) * 0.5)?.inverse();
            let centre = narrowed * eta;
            let log = width.log_weight + half_log_determinant(&narrowed) + 0.5 * eta.dot(&centre) - log_base;
            Some(log + share_longer(&centre, &narrowed, 0..G::TRANSLATION, self.least).ln())
        };
        let logs: Vec<f64> = self.widths.iter().filter_map(of_width).collect();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if most.is_finite() {
            most + logs.iter().map(|log| (log - most).exp()).sum::<f64>().ln()
        } else {
            0.0
        }
    }

    /// log of the evidence with yaw slips larger than `least_yaw` alone over that with all, under which one came out as
    /// `mean` and `covariance`: `P(|θ| > least_yaw | m, C) / P(|θ| > least_yaw | S_Y)`.
    pub(crate) fn log_turned<G: Pose<N>>(
        &self,
        mean: &SVector<f64, N>,
        covariance: &SMatrix<f64, N, N>,
    ) -> f64 {
        share_longer(mean, covariance, G::TRANSLATION..N, self.least_yaw).ln() - self.log_turned
    }
}

/// `log sqrt(det S)`.
fn half_log_determinant<const N: usize>(s: &SMatrix<f64, N, N>) -> f64 {
    Cholesky::new(*s).map_or(f64::NAN, |factor| {
        let l = factor.l();
        (0..N).map(|i| l[(i, i)].ln()).sum()
    })
}

/// `P(|t| > least)` of the part `t` of a normal tangent vector along `axes`, at least 1e-6.
///
/// Of one axis it is exact. Of several, `|t|²` is a weighted sum of noncentral χ²; its mean and variance give a scaled
/// χ² (Patnaik, 1949), and the cube root of that is nearly normal (Wilson and Hilferty, 1931). Does not depend on the
/// axes.
fn share_longer<const N: usize>(
    mean: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
    axes: Range<usize>,
    least: f64,
) -> f64 {
    const FLOOR: f64 = 1e-6;
    if least == 0.0 {
        return 1.0;
    }
    if axes.len() == 1 {
        let (centre, sigma) = (mean[axes.start].abs(), covariance[(axes.start, axes.start)].max(0.0).sqrt());
        let sides = [(centre - least) / sigma, (-centre - least) / sigma];
        return sides.map(normal_below).iter().sum::<f64>().max(FLOOR);
    }
    let (mut expected, mut variance) = (0.0, 0.0);
    for i in axes.clone() {
        expected += mean[i] * mean[i] + covariance[(i, i)].max(0.0);
        for j in axes.clone() {
            let c = covariance[(i, j)];
            variance += 2.0 * c * c + 4.0 * mean[i] * c * mean[j];
        }
    }
    if expected <= 0.0 || variance <= 0.0 {
        return if expected > least * least { 1.0 } else { FLOOR };
    }
    let freedom = 2.0 * expected * expected / variance;
    let spread = 2.0 / (9.0 * freedom);
    let z = (1.0 - spread - (least * least / expected).cbrt()) / spread.sqrt();
    normal_below(z).max(FLOOR)
}

/// The standard normal's distribution function, to 1e-7 (Abramowitz and Stegun 7.1.26).
fn normal_below(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let tail = 0.5 * series.iter().fold(0.0, |sum, c| (sum + c) * t) * (-x * x).exp();
    if z > 0.0 { 1.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::{Isometry2, Matrix3, Vector3};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// A slip `τ` of the mixture is seen once, `r ~ N(τ, C)`: the evidence is an integral over its translation.
    #[test]
    fn evidence_of_the_mixture_is_that_of_a_grid_of_slips() {
        const STEP: f64 = 0.02;
        let params = GcmParams::default();
        let prior = SlipPrior::<3>::new::<Isometry2<f64>>(&params);
        let noise = Matrix3::from_diagonal(&Vector3::new(0.25, 0.36, 1e-4));
        let normal = |x: f64, variance: f64| (-0.5 * x * x / variance).exp() / (TAU * variance).sqrt();
        for seen in
            [Vector3::new(0.3, -0.2, 0.01), Vector3::new(1.5, 0.4, 0.0), Vector3::new(-5.0, 3.0, -0.02)]
        {
            let mut mixture = 0.0;
            for (i, j) in (-1500..1500).flat_map(|i| (-1500..1500).map(move |j| (i, j))) {
                let (x, y) = ((f64::from(i) + 0.5) * STEP, (f64::from(j) + 0.5) * STEP);
                if x.hypot(y) <= params.least_slip {
                    continue;
                }
                let near = normal(seen[0] - x, 0.25) * normal(seen[1] - y, 0.36) * STEP * STEP;
                for (share, sigma) in [(0.25, 1.5), (0.5, 3.0), (0.25, 6.0)] {
                    // of a disc under a round normal
                    let longer = (-0.5 * (params.least_slip / sigma).powi(2)).exp();
                    mixture += share / longer * near * normal(x, sigma * sigma) * normal(y, sigma * sigma);
                }
            }
            let all = prior.searched();
            let searched = normal(seen[0], all[(0, 0)] + 0.25) * normal(seen[1], all[(1, 1)] + 0.36);
            let gain = all * (all + noise).try_inverse().unwrap();
            let (mean, covariance) = (gain * seen, all - gain * all);
            let ours = prior.log_evidence::<Isometry2<f64>>(&mean, &covariance);
            assert!(
                (ours - (mixture / searched).ln()).abs() < 0.05,
                "{seen}: {ours} {}",
                (mixture / searched).ln()
            );
        }
    }

    /// A yaw slip `θ` is seen once, `r ~ N(θ, 0.02²)`: the evidence is an integral over `θ`.
    #[test]
    fn evidence_of_yaw_slips_is_that_of_a_grid_of_angles() {
        const STEP: f64 = 1e-5;
        let params = GcmParams::default();
        let prior = SlipPrior::<3>::new::<Isometry2<f64>>(&params);
        let normal = |x: f64, sigma: f64| (-0.5 * (x / sigma).powi(2)).exp() / (TAU.sqrt() * sigma);
        let (own, noise) = (params.yaw.rotation, 0.02);
        let yaw = Matrix3::from_diagonal(&Vector3::new(0.09, 0.09, own * own));
        let gain = own * own / (own * own + noise * noise);
        for seen in [0.0, 0.02, -0.05, 0.15] {
            let (mut all, mut large, mut share) = (0.0, 0.0, 0.0);
            for theta in (-60_000..60_000).map(|i| (f64::from(i) + 0.5) * STEP) {
                let density = normal(theta, own) * STEP;
                all += density * normal(seen - theta, noise);
                if theta.abs() > params.least_yaw {
                    share += density;
                    large += density * normal(seen - theta, noise);
                }
            }
            let mean = Vector3::new(0.1, -0.2, gain * seen);
            let mut covariance = yaw;
            covariance[(2, 2)] = (1.0 - gain) * own * own;
            let ours = prior.log_turned::<Isometry2<f64>>(&mean, &covariance);
            let grid = (large / share / all).ln();
            assert!((ours - grid).abs() < 1e-3 * (1.0 + grid.abs()), "{seen}: {ours} {grid}");
        }
        let free = SlipPrior::<3>::new::<Isometry2<f64>>(&GcmParams { least_yaw: 0.0, ..params });
        assert_eq!(free.log_turned::<Isometry2<f64>>(&Vector3::zeros(), &yaw), 0.0);
    }

    #[test]
    fn share_of_long_translations_is_that_of_samples() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for (mean, sigma) in [
            ((0.0, 0.0), (3.0, 3.0)),
            ((1.0, 0.0), (0.3, 0.6)),
            ((0.3, 0.4), (0.2, 0.5)),
            ((2.0, 0.0), (0.3, 0.3)),
        ] {
            const SAMPLES: usize = 40_000;
            let longer = (0..SAMPLES)
                .filter(|_| {
                    let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
                    let (x, y) = (mean.0 + sigma.0 * draw(), mean.1 + sigma.1 * draw());
                    x.hypot(y) > 0.75
                })
                .count();
            let share = longer as f64 / SAMPLES as f64;
            let covariance = Matrix3::from_diagonal(&Vector3::new(sigma.0 * sigma.0, sigma.1 * sigma.1, 0.1));
            let ours = share_longer(&Vector3::new(mean.0, mean.1, 0.0), &covariance, 0..2, 0.75);
            assert!((ours - share).abs() < 0.02, "{mean:?} {sigma:?}: {ours} {share}");
            let all = share_longer(&Vector3::new(mean.0, mean.1, 0.0), &covariance, 0..2, 0.0);
            assert_eq!(all, 1.0);
        }
    }
}

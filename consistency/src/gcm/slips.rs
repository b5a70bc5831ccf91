use nalgebra::{SMatrix, SVector};

use crate::Pose;

/// `P(|t| > least)` of the translation `t` of a normal tangent vector, at least 1e-6.
///
/// `|t|²` is a weighted sum of noncentral χ²; its mean and variance give a scaled χ² (Patnaik, 1949), and the cube root
/// of that is nearly normal (Wilson and Hilferty, 1931). Does not depend on the axes.
pub(crate) fn share_longer<const N: usize, G: Pose<N>>(
    mean: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
    least: f64,
) -> f64 {
    const FLOOR: f64 = 1e-6;
    let axes = 0..G::TRANSLATION;
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
    use nalgebra::{Isometry2, Matrix3, Vector3};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

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
            let ours =
                share_longer::<3, Isometry2<f64>>(&Vector3::new(mean.0, mean.1, 0.0), &covariance, 0.75);
            assert!((ours - share).abs() < 0.02, "{mean:?} {sigma:?}: {ours} {share}");
        }
    }
}

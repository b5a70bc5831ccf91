//! Chi-square quantiles and gates: the largest squared Mahalanobis distance still believed.
//!
//! Start with [`gate`]; take [`quantile`] once and compare yourself in a hot loop.

use statrs::distribution::{ChiSquared, Continuous, ContinuousCDF};

use crate::Error;

/// Newton steps after the library's inverse, which stops at an absolute 1e-9; they converge quadratically.
const POLISH_STEPS: usize = 5;

/// Quantile of the chi-square distribution: the value below which a share `probability` of draws with
/// `degrees_of_freedom` lies.
///
/// * `probability` – in (0, 1); 0.99 believes 99 % of what is true.
/// * `degrees_of_freedom` – length of the residual: 3 in SE(2), 6 in SE(3).
///
/// Good to 1e-13 of its value from 1e-9 to 1 - 1e-12.
///
/// # Errors
/// [`Error::Probability`] unless 0 < `probability` < 1, [`Error::DegreesOfFreedom`] when it is zero.
///
/// ```
/// let limit = draco_lie::chi2::quantile(0.99, 3)?;
/// assert!((limit - 11.344_866_730_144_37).abs() < 1e-13);
/// # Ok::<(), draco_lie::Error>(())
/// ```
pub fn quantile(probability: f64, degrees_of_freedom: usize) -> Result<f64, Error> {
    if !(probability > 0.0 && probability < 1.0) {
        return Err(Error::Probability { value: probability });
    }
    let distribution = ChiSquared::new(degrees_of_freedom as f64).map_err(|_| Error::DegreesOfFreedom)?;
    let mut limit = distribution.inverse_cdf(probability);
    for _ in 0..POLISH_STEPS {
        // Newton on the logarithm of the smaller tail, nearly linear in ln x (lower) or x (upper); near 1 the
        // distribution function itself has no digits left to tell
        let density = distribution.pdf(limit);
        let next = if probability < 0.5 {
            let below = distribution.cdf(limit);
            limit * ((probability / below).ln() * below / (limit * density)).exp()
        } else {
            let above = distribution.sf(limit);
            limit + (above / (1.0 - probability)).ln() * above / density
        };
        if !(next > 0.0 && next.is_finite()) {
            break;
        }
        limit = next;
    }
    Ok(limit)
}

/// Whether a squared Mahalanobis distance is one that a true pair shows with the given probability:
/// `distance_sq <= quantile(probability, degrees_of_freedom)`.
///
/// * `distance_sq` – squared Mahalanobis distance (no unit), as from
///   [`GaussianPose::mahalanobis_sq`](crate::GaussianPose::mahalanobis_sq).
///
/// # Errors
/// Those of [`quantile`]; [`Error::NotFinite`] or [`Error::NegativeDistance`] for a distance that is none.
///
/// ```
/// assert!(draco_lie::chi2::gate(7.8, 0.95, 3)?);
/// assert!(!draco_lie::chi2::gate(7.9, 0.95, 3)?);
/// # Ok::<(), draco_lie::Error>(())
/// ```
pub fn gate(distance_sq: f64, probability: f64, degrees_of_freedom: usize) -> Result<bool, Error> {
    if !distance_sq.is_finite() {
        return Err(Error::NotFinite { what: "the squared distance", index: 0, value: distance_sq });
    }
    if distance_sq < 0.0 {
        return Err(Error::NegativeDistance { value: distance_sq });
    }
    Ok(distance_sq <= quantile(probability, degrees_of_freedom)?)
}

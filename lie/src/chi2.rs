//! Chi-square quantiles and gates: the largest squared Mahalanobis distance still believed.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::Error;

/// Quantile of the chi-square distribution: the value below which a share `probability` of draws with
/// `degrees_of_freedom` lies.
///
/// # Errors
/// [`Error::Probability`] unless 0 < `probability` < 1, [`Error::DegreesOfFreedom`] when it is zero.
///
/// ```
/// let limit = draco_lie::chi2::quantile(0.99, 3)?;
/// assert!((limit - 11.344_866_730_144_37).abs() < 1e-9);
/// # Ok::<(), draco_lie::Error>(())
/// ```
pub fn quantile(probability: f64, degrees_of_freedom: usize) -> Result<f64, Error> {
    if !(probability > 0.0 && probability < 1.0) {
        return Err(Error::Probability { value: probability });
    }
    let distribution = ChiSquared::new(degrees_of_freedom as f64).map_err(|_| Error::DegreesOfFreedom)?;
    Ok(distribution.inverse_cdf(probability))
}

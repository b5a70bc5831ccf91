use nalgebra::{Matrix2, Vector2};

use crate::Error;
use crate::error::check;

/// Noise of a sensor that measures range and bearing from its origin, such as an imaging sonar or a 2-D laser.
///
/// Far points of a sonar are uncertain across the beam by metres and along it by centimetres; with the covariances
/// from here and [`crate::Residual::Mahalanobis`] each counts as far as it can be trusted.
///
/// ```
/// use draco_registration::RangeBearingNoise;
/// use nalgebra::Vector2;
/// let noise = RangeBearingNoise { range_sigma: 0.1, bearing_sigma: 0.02 };
/// let [covariance] = noise.covariances(&[Vector2::new(0.0, 30.0)])?[..] else { unreachable!() };
/// assert!((covariance.m11.sqrt() - 0.6).abs() < 1e-12 && (covariance.m22.sqrt() - 0.1).abs() < 1e-12);
/// # Ok::<(), draco_registration::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeBearingNoise {
    /// Standard deviation of the range, metres, more than 0.
    pub range_sigma: f64,
    /// Standard deviation of the bearing, radians, 0 or more.
    pub bearing_sigma: f64,
}

impl RangeBearingNoise {
    /// Covariances of points given in the frame of the sensor, m²: `R diag(σ_r², (r σ_b)²) Rᵀ` with `R` the turn to
    /// the bearing and `r` the range.
    ///
    /// Across the beam the deviation is at least a thousandth of that along it, so that every covariance can be
    /// inverted.
    ///
    /// # Errors
    /// [`Error::Parameter`], [`Error::NonFinitePoint`].
    pub fn covariances(&self, points: &[Vector2<f64>]) -> Result<Vec<Matrix2<f64>>, Error> {
        let (range, bearing) = (self.range_sigma, self.bearing_sigma);
        check("range_sigma", range, range > 0.0 && range.is_finite(), "more than 0")?;
        check("bearing_sigma", bearing, bearing >= 0.0 && bearing.is_finite(), "0 or more")?;
        let one = |(index, point): (usize, &Vector2<f64>)| {
            if !point.iter().all(|v| v.is_finite()) {
                return Err(Error::NonFinitePoint { index });
            }
            let along = point.try_normalize(0.0).unwrap_or_else(Vector2::x);
            let across = Vector2::new(-along.y, along.x);
            let width = (point.norm() * bearing).max(1e-3 * range);
            Ok(along * along.transpose() * (range * range) + across * across.transpose() * (width * width))
        };
        points.iter().enumerate().map(one).collect()
    }
}

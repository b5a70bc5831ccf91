use nalgebra::{Isometry2, Point2, Vector2};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Normal};

use super::World;
use crate::Error;
use crate::sonar::{Fan, PolarImage};

/// How [`polar_image`] makes an image. Intensities are shares of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageParams {
    /// Ranges. Default 512.
    pub rows: usize,
    /// Beams. Default 512.
    pub columns: usize,
    /// Range and aperture. Default 30 m and 120°.
    pub fan: Fan,
    /// Opening angle of a beam in elevation, radians: smears an echo over `r (1 - cos(elevation / 2))`. Default 20°.
    pub elevation: f64,
    /// Scale of the Rayleigh noise added to every cell. Default 0.08.
    pub additive: f64,
    /// Standard deviation of the noise every echo is multiplied with. Default 0.2.
    pub multiplicative: f64,
    /// Standard deviation of the range of an echo, metres. Default 0.1.
    pub range_jitter: f64,
    /// Range at which an echo has full strength, metres; farther ones fall off with 1/r. Default 15: spreading loss,
    /// of which the sonar's own gain over time makes good a part.
    pub full_strength_range: f64,
}

impl Default for ImageParams {
    fn default() -> Self {
        Self {
            rows: 512,
            columns: 512,
            fan: Fan::default(),
            elevation: 20.0_f64.to_radians(),
            additive: 0.08,
            multiplicative: 0.2,
            range_jitter: 0.1,
            full_strength_range: 15.0,
        }
    }
}

/// The polar image a sonar at `world_from_sensor` takes.
///
/// The first surface on each beam echoes by Lambert's cosine and its reflectivity, the next one behind it at a third
/// of that, since some of the sound passes above or below.
///
/// # Errors
/// [`Error::Parameter`] when a noise is negative or not finite, or the image has no cell.
pub fn polar_image(
    world: &World,
    world_from_sensor: &Isometry2<f64>,
    params: &ImageParams,
    rng: &mut impl Rng,
) -> Result<PolarImage, Error> {
    let normal = |name, sigma: f64| {
        let reason = "must be finite and not negative";
        let valid = sigma >= 0.0 && sigma.is_finite();
        let refused = Error::Parameter { name, value: sigma, reason };
        Normal::new(0.0, if valid { sigma } else { 0.0 }).ok().filter(|_| valid).ok_or(refused)
    };
    let jitter = normal("range_jitter", params.range_jitter)?;
    let speckle = normal("multiplicative", params.multiplicative)?;
    normal("additive", params.additive)?;
    let mut strength = vec![0.0_f64; params.rows * params.columns];
    let near = world.near(world_from_sensor, params.fan.max_range);
    let origin = Point2::from(world_from_sensor.translation.vector);
    for column in 0..params.columns {
        let bearing = params.fan.aperture * ((column as f64 + 0.5) / params.columns as f64 - 0.5);
        let direction = world_from_sensor.rotation * Vector2::new(bearing.cos(), bearing.sin());
        let hits = near.cast(&origin, &direction, params.fan.max_range);
        for (hit, share) in hits.iter().flatten().zip([1.0, 1.0 / 3.0]) {
            let loss = (params.full_strength_range / hit.range).min(1.0);
            let echo =
                share * hit.reflectivity * hit.cos_incidence * loss * (1.0 + speckle.sample(rng)).max(0.0);
            let from = hit.range + jitter.sample(rng);
            let smear = hit.range * (1.0 - (0.5 * params.elevation).cos());
            let to_row = |range: f64| range / params.fan.max_range * params.rows as f64;
            let first = to_row(from).max(0.0) as usize;
            let last = to_row(from + smear).max(0.0) as usize;
            for row in first..=last.min(params.rows.saturating_sub(1)) {
                strength[row * params.columns + column] += echo;
            }
        }
    }
    let cells = strength.iter().map(|echo| {
        // Inverse of the Rayleigh distribution function.
        let noise = params.additive * (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        (255.0 * (echo + noise)).clamp(0.0, 255.0) as u8
    });
    PolarImage::new(params.columns, cells.collect())
}

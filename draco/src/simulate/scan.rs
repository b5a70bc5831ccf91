use nalgebra::{Isometry2, Point2, Vector2};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Exp, Poisson};

use super::World;
use crate::Error;

/// How [`direct_scan`] draws points without making an image.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanParams {
    /// Rays over the aperture. Default 512.
    pub beams: usize,
    /// Opening angle, radians. Default 120°.
    pub aperture: f64,
    /// Largest range, metres. Default 30.
    pub max_range: f64,
    /// Chance to see also the next surface, if it is at most [`Self::second_within`] behind. Default 0.3.
    pub second_probability: f64,
    /// How far behind the first surface a second is still seen, metres. Default 1.
    pub second_within: f64,
    /// Mean of the exponential range noise, metres. Default 0.1.
    pub range_noise: f64,
    /// Chance that a surface at range 0 gives no point. Default 0.1.
    pub drop_near: f64,
    /// What is added to that chance at the largest range, growing with its square. Default 0.3.
    pub drop_far: f64,
    /// Surfaces at a smaller cosine of incidence give no point. Default 0.2.
    pub grazing_cosine: f64,
    /// Mean number of points where nothing is. Default 3.
    pub false_returns: f64,
}

impl Default for ScanParams {
    fn default() -> Self {
        Self {
            beams: 512,
            aperture: 120.0_f64.to_radians(),
            max_range: 30.0,
            second_probability: 0.3,
            second_within: 1.0,
            range_noise: 0.1,
            drop_near: 0.1,
            drop_far: 0.3,
            grazing_cosine: 0.2,
            false_returns: 3.0,
        }
    }
}

/// Points a sonar at `world_from_sensor` sees, in the sensor frame, before any filter.
///
/// # Errors
/// [`Error::Parameter`] when a noise is negative, or not finite.
pub fn direct_scan(
    world: &World,
    world_from_sensor: &Isometry2<f64>,
    params: &ScanParams,
    rng: &mut impl Rng,
) -> Result<Vec<Point2<f64>>, Error> {
    let range_noise = Exp::new(1.0 / params.range_noise).map_err(|_| Error::Parameter {
        name: "range_noise",
        value: params.range_noise,
        reason: "must not be negative",
    })?;
    let near = world.near(world_from_sensor, params.max_range);
    let origin = Point2::from(world_from_sensor.translation.vector);
    let mut points = Vec::new();
    for beam in 0..params.beams {
        let bearing = params.aperture * ((beam as f64 + 0.5) / params.beams as f64 - 0.5);
        let direction = Vector2::new(bearing.cos(), bearing.sin());
        let [first, second] = near.cast(&origin, &(world_from_sensor.rotation * direction), params.max_range);
        let Some(first) = first else { continue };
        let second = second
            .filter(|second| second.range - first.range <= params.second_within)
            .filter(|_| rng.random_bool(params.second_probability.clamp(0.0, 1.0)));
        for hit in [Some(first), second].into_iter().flatten() {
            let far = hit.range / params.max_range;
            let seen = hit.reflectivity * (1.0 - params.drop_near - params.drop_far * far * far);
            if rng.random_bool(seen.clamp(0.0, 1.0)) && hit.cos_incidence >= params.grazing_cosine {
                points.push(Point2::from(direction * (hit.range + range_noise.sample(rng))));
            }
        }
    }
    add_false_returns(&mut points, params, rng)?;
    Ok(points)
}

/// Points spread evenly over the area of the fan.
fn add_false_returns(
    points: &mut Vec<Point2<f64>>,
    params: &ScanParams,
    rng: &mut impl Rng,
) -> Result<(), Error> {
    if params.false_returns == 0.0 {
        return Ok(());
    }
    let number = Poisson::new(params.false_returns).map_err(|_| Error::Parameter {
        name: "false_returns",
        value: params.false_returns,
        reason: "must not be negative",
    })?;
    for _ in 0..number.sample(rng) as usize {
        let range = params.max_range * rng.random::<f64>().sqrt();
        let bearing = params.aperture * (rng.random::<f64>() - 0.5);
        points.push(Point2::new(range * bearing.cos(), range * bearing.sin()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::{Shape, World};
    use super::*;

    fn wall_scan(params: &ScanParams) -> Vec<Point2<f64>> {
        let mut world = World::default();
        world.add(Shape::Segment([Point2::new(10.0, -50.0), Point2::new(10.0, 50.0)]), 1.0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        direct_scan(&world, &Isometry2::identity(), params, &mut rng).expect("valid")
    }

    #[test]
    fn a_wall_ahead_is_seen_behind_its_true_range_by_the_mean_noise() {
        let scan = wall_scan(&ScanParams { false_returns: 0.0, ..ScanParams::default() });
        let excess =
            scan.iter().map(|p| p.coords.norm() * (1.0 - 10.0 / p.x)).sum::<f64>() / scan.len() as f64;
        assert!((350..512).contains(&scan.len()), "{}", scan.len());
        assert!((excess - 0.1).abs() < 0.02, "mean noise {excess}");
    }

    #[test]
    fn nothing_is_seen_out_of_range_and_noise_must_be_positive() {
        assert!(
            wall_scan(&ScanParams { max_range: 9.0, false_returns: 0.0, ..ScanParams::default() }).is_empty()
        );
        let bad = ScanParams { range_noise: -1.0, ..ScanParams::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        assert!(direct_scan(&World::default(), &Isometry2::identity(), &bad, &mut rng).is_err());
    }
}

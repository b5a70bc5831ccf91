use draco_lie::LieGroup;
use nalgebra::{Isometry2, Point2, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::movers::Movers;
use super::{ImageParams, KeyframePolicy, ScanParams, Scenario, World, direct_scan, follow, polar_image};
use crate::Error;
use crate::keyframe::{Keyframe, MissionData, Recording, RobotId};
use crate::sonar::{Cfar, CfarParams, PointFilter};

/// Errors of the dead reckoning from one keyframe to the next, order x, y, θ in the vehicle's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryNoise {
    /// Standard deviation of the position on each axis, metres. Default 0.12.
    pub translation_m: f64,
    /// Standard deviation of the heading, radians. Default 0.0136.
    pub rotation_rad: f64,
    /// Standard deviation, over robots, of a bias of the heading that stays the same for a whole mission, radians a
    /// keyframe. Default 0.002.
    pub heading_bias_rad: f64,
}

impl Default for OdometryNoise {
    /// Such that after ten keyframes the marginal is about 0.6 m and 0.043 rad, as in the logs of the published
    /// system.
    fn default() -> Self {
        Self { translation_m: 0.12, rotation_rad: 0.0136, heading_bias_rad: 0.002 }
    }
}

/// How scans are made.
#[derive(Debug, Clone, PartialEq)]
pub enum ScanMode {
    /// Points straight from ray casts: cheap.
    Direct(ScanParams),
    /// A whole polar image a keyframe, and a CFAR detector over it.
    Image(ImageParams, CfarParams),
}

impl Default for ScanMode {
    fn default() -> Self {
        Self::Direct(ScanParams::default())
    }
}

/// What [`simulate`] makes.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationParams {
    /// The site and the paths.
    pub scenario: Scenario,
    /// Seed of everything random. Equal parameters give equal missions, to the bit.
    pub seed: u64,
    /// Number of robots. Default 3, each on a path of its own; robot `3 + k` follows the path of robot `k`, from another
    /// place on it.
    pub robots: usize,
    /// Keyframes a robot. Default `None`: as many as the scenario says.
    pub keyframes: Option<usize>,
    /// Vehicles that cross the site and are no robots. Default 0. Each is a disk of 1.5 m that runs to and fro on a line of
    /// its own; all robots see it where it is at that time.
    pub movers: usize,
    /// Errors of the dead reckoning.
    pub odometry: OdometryNoise,
    /// How scans are made. Default direct.
    pub scan: ScanMode,
    /// How points are thinned. Default one point in 0.3 m with two neighbours within 1 m, so that piles survive.
    pub filter: PointFilter,
    /// When keyframes are taken.
    pub keyframe_policy: KeyframePolicy,
    /// Speed of the vehicles, metres a second. Default 0.5.
    pub speed: f64,
}

impl Default for SimulationParams {
    fn default() -> Self {
        Self {
            scenario: Scenario::default(),
            seed: 0,
            robots: 3,
            keyframes: None,
            movers: 0,
            odometry: OdometryNoise::default(),
            scan: ScanMode::default(),
            filter: PointFilter { cell_m: 0.3, radius_m: 1.0, min_neighbors: 2 },
            keyframe_policy: KeyframePolicy::default(),
            speed: 0.5,
        }
    }
}

/// A whole mission: robots over one site, from one seed.
///
/// The dead reckoning of each robot starts at the identity of a frame of its own; nothing in a recording but its
/// truth tells where the robots are.
///
/// # Errors
/// [`Error::Parameter`] for a noise or a speed out of range.
///
/// ```
/// use draco::simulate::{SimulationParams, simulate};
///
/// let mission = simulate(&SimulationParams { keyframes: Some(4), ..SimulationParams::default() })?;
/// assert_eq!(mission.name, "harbor");
/// assert_eq!(mission.recordings.len(), 3);
/// assert_eq!(mission.recordings[0].keyframes.len(), 4);
/// # Ok::<(), draco::Error>(())
/// ```
pub fn simulate(params: &SimulationParams) -> Result<MissionData, Error> {
    if !(params.speed > 0.0 && params.speed.is_finite()) {
        return Err(Error::Parameter { name: "speed", value: params.speed, reason: "must be above 0" });
    }
    let world = params.scenario.world(params.seed);
    let paths = params.scenario.way_points();
    let fleet = (1..).zip(0..params.robots);
    let recordings = fleet.map(|(robot, index)| {
        let mut way_points = paths[index % paths.len()].clone();
        let places = way_points.len();
        // the golden ratio spreads any number of starts along a path
        way_points.rotate_left((0.618_034 * places as f64 * (index / paths.len()) as f64) as usize % places);
        record(robot, &way_points, &world, params)
    });
    Ok(MissionData {
        name: params.scenario.name().to_owned(),
        recordings: recordings.collect::<Result<_, _>>()?,
        truth_has_heading: true,
    })
}

fn record(
    robot: RobotId,
    way_points: &[Point2<f64>],
    world: &World,
    params: &SimulationParams,
) -> Result<Recording, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(params.seed);
    // Each robot draws from a stream of its own, so that one more robot changes nothing for the others.
    rng.set_stream(u64::from(robot));
    let mut truth = params.keyframe_policy.select(&follow(way_points, params.speed));
    truth.truncate(params.keyframes.unwrap_or_else(|| params.scenario.keyframes()));
    let odometry = dead_reckon(&truth, &params.odometry, &mut rng)?;
    let mut keyframes = Vec::new();
    let movers = Movers::new(params.movers, params.seed);
    for ((&(time, pose), odometry), index) in truth.iter().zip(odometry).zip(0..) {
        let here = movers.add_to(world, time);
        let points = params.filter.apply(&scan(&here, &pose, &params.scan, &mut rng)?)?;
        keyframes.push(Keyframe { index, time, odometry, points });
    }
    Ok(Recording { robot, keyframes, truth: truth.into_iter().map(|(_, pose)| Some(pose)).collect() })
}

fn scan(
    world: &World,
    pose: &Isometry2<f64>,
    mode: &ScanMode,
    rng: &mut impl Rng,
) -> Result<Vec<Point2<f64>>, Error> {
    match mode {
        ScanMode::Direct(params) => direct_scan(world, pose, params, rng),
        ScanMode::Image(params, cfar) => {
            let image = polar_image(world, pose, params, rng)?;
            params.fan.points(&image, &Cfar::new(*cfar)?.detect(&image))
        }
    }
}

fn dead_reckon(
    truth: &[(f64, Isometry2<f64>)],
    noise: &OdometryNoise,
    rng: &mut impl Rng,
) -> Result<Vec<Isometry2<f64>>, Error> {
    let normal = |name, sigma: f64| {
        let valid = sigma >= 0.0 && sigma.is_finite();
        let reason = "must be finite and not negative";
        Normal::new(0.0, sigma).ok().filter(|_| valid).ok_or(Error::Parameter { name, value: sigma, reason })
    };
    let translation = normal("translation_m", noise.translation_m)?;
    let rotation = normal("rotation_rad", noise.rotation_rad)?;
    let bias = normal("heading_bias_rad", noise.heading_bias_rad)?.sample(rng);
    let mut pose = Isometry2::identity();
    let mut poses = vec![pose];
    for pair in truth.windows(2) {
        let error =
            Vector3::new(translation.sample(rng), translation.sample(rng), bias + rotation.sample(rng));
        pose *= pair[0].1.inv_mul(&pair[1].1).plus(&error);
        poses.push(pose);
    }
    poses.truncate(truth.len());
    Ok(poses)
}

/// Edge of the cells by which [`visited_overlap`] measures areas, metres.
const AREA_CELL_M: f64 = 1.0;

/// Share of the ground that two robots have both seen in the ground that at least one has seen, by the truth:
/// ground counts as seen when it lay in the fan of some keyframe, `range` metres far and `aperture` radians wide.
pub fn visited_overlap(a: &Recording, b: &Recording, range: f64, aperture: f64) -> f64 {
    let truth = || a.truth.iter().chain(&b.truth).flatten();
    let corner = |pick: fn(f64, f64) -> f64, start: f64, margin: f64| {
        let coordinate =
            |axis: usize| truth().map(|pose| pose.translation.vector[axis] + margin).fold(start, pick);
        Vector2::new(coordinate(0), coordinate(1))
    };
    let low = corner(f64::min, f64::INFINITY, -range);
    let high = corner(f64::max, f64::NEG_INFINITY, range);
    let saw = |recording: &Recording, cell: &Point2<f64>| {
        recording.truth.iter().flatten().any(|pose| {
            let seen = pose.inverse_transform_point(cell);
            seen.coords.norm() <= range && seen.y.atan2(seen.x).abs() <= 0.5 * aperture
        })
    };
    let (mut both, mut either) = (0_usize, 0_usize);
    let mut cell = Point2::from(low);
    while cell.y <= high.y {
        cell.x = low.x;
        while cell.x <= high.x {
            let (by_a, by_b) = (saw(a, &cell), saw(b, &cell));
            both += usize::from(by_a && by_b);
            either += usize::from(by_a || by_b);
            cell.x += AREA_CELL_M;
        }
        cell.y += AREA_CELL_M;
    }
    if either == 0 { 0.0 } else { both as f64 / either as f64 }
}

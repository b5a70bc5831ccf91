use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::link::{Faults, ModemParams, Outage};
use crate::robot::RobotParams;
use crate::simulate::{OdometryNoise, Scenario, SimulationParams};

/// What happens to a robot's process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Restart {
    /// Place of the robot in the team.
    pub(super) robot: usize,
    /// Step before which it is killed.
    pub(super) step: usize,
    /// Steps until it is started again.
    pub(super) down: usize,
    /// What has become of its state file.
    pub(super) file: StateFile,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum StateFile {
    /// As it was written.
    Whole,
    /// Cut off at this share of its length.
    Cut(f64),
    /// One bit flipped at this share of its length.
    Flipped(f64),
}

/// Everything about one mission.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) seed: u64,
    pub(super) simulation: SimulationParams,
    /// Keyframes a robot.
    pub(super) keyframes: usize,
    /// Where on its path the first robot begins, as a share.
    pub(super) begin: f64,
    /// Whether the others begin near to it.
    pub(super) near: bool,
    pub(super) robot: RobotParams,
    pub(super) modem: ModemParams,
    pub(super) restarts: Vec<Restart>,
    pub(super) intruder: bool,
    /// What each robot's clock is off by, seconds, and by how much it is fast, as a share.
    pub(super) clocks: Vec<(f64, f64)>,
}

impl Plan {
    /// The plan of a seed. Three in four are such that robots can meet: they are near to each other, and compare their
    /// maps earlier and more often than by default.
    pub(super) fn draw(seed: u64) -> Self {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let near = rng.random_bool(0.75);
        let robots = if near { rng.random_range(2..=3) } else { rng.random_range(2..=4) };
        let keyframes = if near { rng.random_range(11..=16) } else { rng.random_range(3..=12) };
        let begin = rng.random();
        let robot = if near { eager(rng) } else { RobotParams::default() };
        let odometry = OdometryNoise {
            translation_m: rng.random_range(0.02..0.4),
            rotation_rad: rng.random_range(0.001..0.04),
            heading_bias_rad: rng.random_range(0.0..0.01),
        };
        let simulation = SimulationParams {
            scenario: if rng.random_bool(0.5) { Scenario::Harbor } else { Scenario::Wreck },
            seed: rng.random_range(0..1000),
            robots,
            odometry,
            movers: if rng.random_bool(0.3) { rng.random_range(1..6) } else { 0 },
            ..SimulationParams::default()
        };
        let modem = ModemParams { faults: faults(rng, robots, keyframes), ..ModemParams::default() };
        let restarts = (0..if rng.random_bool(0.5) { rng.random_range(1..3) } else { 0 })
            .map(|_| Restart {
                robot: rng.random_range(0..robots),
                step: rng.random_range(1..keyframes),
                down: rng.random_range(0..4),
                file: match rng.random_range(0..4) {
                    0 => StateFile::Cut(rng.random()),
                    1 => StateFile::Flipped(rng.random()),
                    _ => StateFile::Whole,
                },
            })
            .collect();
        let clock = |rng: &mut ChaCha8Rng| (rng.random_range(-30.0..30.0), rng.random_range(-1e-3..1e-3));
        Plan {
            seed,
            simulation,
            keyframes,
            begin,
            near,
            robot,
            modem,
            restarts,
            intruder: rng.random_bool(0.6),
            clocks: (0..robots).map(|_| if rng.random_bool(0.5) { clock(rng) } else { (0.0, 0.0) }).collect(),
        }
    }
}

/// Settings with which robots meet after a few keyframes. They believe less evidence than they should outside of a test.
fn eager(rng: &mut impl Rng) -> RobotParams {
    let mut params = RobotParams::default();
    params.exchange.map_interval = rng.random_range(1..=3);
    params.cells.min_keyframes = rng.random_range(2..=3);
    params.alignment.min_cells = rng.random_range(20..=40);
    params.alignment.min_streak = rng.random_range(2..=3);
    params.alignment.min_tested = rng.random_range(5..=10);
    params
}

fn faults(rng: &mut impl Rng, robots: usize, keyframes: usize) -> Faults {
    let mut sometimes =
        |share: f64, most: f64| if rng.random_bool(share) { rng.random_range(0.0..most) } else { 0.0 };
    let (loss, duplication, reordering) = (sometimes(0.6, 0.7), sometimes(0.5, 0.6), sometimes(0.5, 1.0));
    let end = 6.0 * keyframes as f64;
    let outages = (0..if rng.random_bool(0.3) { rng.random_range(1..3) } else { 0 })
        .map(|_| {
            let from_s = rng.random_range(0.0..end);
            let robot = rng.random_bool(0.7).then(|| rng.random_range(1..=robots as u32));
            Outage { robot, from_s, to_s: from_s + rng.random_range(0.0..0.7 * end) }
        })
        .collect();
    Faults { seed: rng.random(), loss, duplication, reordering, outages }
}

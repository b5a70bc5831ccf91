use std::str::FromStr;

use nalgebra::{Isometry2, Point2, Vector2};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::{Shape, World};

/// A simulated site with the paths of three robots over it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scenario {
    /// A quay with three rows of eight piling groups and a few hulls and docks, 61 keyframes a robot. The rows repeat
    /// every six metres, so wrong closures come in families that agree with one another.
    #[default]
    Harbor,
    /// Parts of an airplane on free ground, 81 keyframes a robot. Shapes are distinct, views are one-sided.
    Wreck,
}

impl Scenario {
    /// All scenarios.
    pub const ALL: [Self; 2] = [Self::Harbor, Self::Wreck];

    /// The name a user types.
    pub fn name(self) -> &'static str {
        match self {
            Self::Harbor => "harbor",
            Self::Wreck => "wreck",
        }
    }

    /// Keyframes each robot records.
    pub fn keyframes(self) -> usize {
        match self {
            Self::Harbor => 61,
            Self::Wreck => 81,
        }
    }

    /// What stands in the water. The layout is fixed; `seed` moves piles by centimetres and debris by metres.
    pub fn world(self, seed: u64) -> World {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        match self {
            Self::Harbor => harbor(&mut rng),
            Self::Wreck => wreck(&mut rng),
        }
    }

    /// Way-points of the robots 1, 2 and 3.
    pub fn way_points(self) -> [Vec<Point2<f64>>; 3] {
        let points = |list: &[(f64, f64)]| list.iter().map(|&(x, y)| Point2::new(x, y)).collect();
        match self {
            Self::Harbor => HARBOR_PATHS.map(points),
            Self::Wreck => WRECK_PATHS.map(points),
        }
    }
}

impl FromStr for Scenario {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = Self::ALL.map(Self::name).join(", ");
        Self::ALL
            .into_iter()
            .find(|scenario| scenario.name() == name)
            .ok_or_else(|| format!("there is no scenario `{name}`; there are {known}"))
    }
}

/// Robot 1 loops the east half, robot 2 the west half, robot 3 crosses both between quay and pilings.
#[rustfmt::skip]
const HARBOR_PATHS: [&[(f64, f64)]; 3] = [
    &[
        (22.0, -18.0), (25.5, -10.0), (25.0, 0.0), (19.0, 4.0), (10.0, 4.0), (0.0, 4.0), (-5.5, 1.0),
        (-6.0, -4.0), (-6.0, -8.0), (-4.0, -13.0), (4.0, -17.5), (18.0, -19.0), (25.5, -14.0), (26.0, 0.0),
        (25.0, 9.0), (19.5, 14.0), (9.5, 13.5), (6.0, 8.0), (6.0, -4.0), (7.5, -13.0), (16.0, -16.0),
        (27.0, -17.0),
    ],
    &[
        (-16.0, -20.0), (-8.0, -18.0), (2.0, -16.5), (6.0, -12.0), (6.0, 0.0), (6.0, 9.0), (3.5, 14.5),
        (-4.0, 17.0), (-14.0, 17.0), (-22.0, 15.5), (-26.0, 8.0), (-26.0, -8.0), (-22.0, -16.5),
        (-13.0, -17.0), (-7.0, -13.5), (-6.0, -8.0), (-6.0, 5.0), (-8.5, 13.0), (-16.0, 16.0),
        (-25.0, 12.0), (-28.0, 0.0), (-27.0, -12.0),
    ],
    &[
        (-18.0, 18.0), (-8.0, 17.0), (4.0, 16.5), (16.0, 17.0), (26.0, 13.5), (25.5, 7.0), (19.0, 4.0),
        (6.0, 4.0), (-6.0, 4.0), (-18.0, 4.0), (-25.0, 7.0), (-25.5, 14.0), (-18.0, 17.0), (-6.0, 15.0),
        (6.0, 15.0), (18.0, 15.5), (27.5, 12.0), (27.0, 0.0), (20.0, -4.0), (6.0, -4.0), (-8.0, -4.0),
    ],
];

/// Robot 1 goes round the north side, robot 2 round the south side, robot 3 loops through the gap in the fuselage.
#[rustfmt::skip]
const WRECK_PATHS: [&[(f64, f64)]; 3] = [
    &[
        (-34.0, -10.0), (-33.0, 4.0), (-26.0, 18.0), (-14.0, 24.0), (0.0, 25.5), (14.0, 25.0), (26.0, 19.0),
        (34.0, 8.0), (34.0, -8.0), (28.0, -19.0), (21.0, -9.0), (20.0, 0.0), (20.0, 8.0), (13.0, 10.0),
        (4.0, 7.5), (-8.0, 6.5), (-18.0, 8.5), (-27.0, 12.0), (-29.0, 20.0), (-20.0, 26.0), (-6.0, 28.0),
        (8.0, 28.0), (20.0, 26.0), (32.0, 18.0),
    ],
    &[
        (34.0, 10.0), (33.0, -4.0), (26.0, -18.0), (14.0, -24.0), (0.0, -25.5), (-14.0, -24.0),
        (-26.0, -18.0), (-34.0, -8.0), (-34.0, 6.0), (-29.0, 9.0), (-23.0, 2.0), (-20.5, -5.0),
        (-14.0, -8.0), (-4.0, -6.5), (6.0, -7.0), (15.0, -6.5), (22.0, -9.0), (30.0, -12.0), (29.0, -21.0),
        (18.0, -27.0), (4.0, -28.0), (-10.0, -27.0), (-22.0, -23.0), (-32.0, -15.0),
    ],
    &[
        (-2.0, -27.0), (0.5, -16.0), (0.5, -7.0), (0.4, 0.0), (0.0, 8.0), (-3.0, 15.0), (-9.0, 19.0),
        (-17.0, 18.5), (-23.0, 10.0), (-26.0, -2.0), (-21.0, -9.0), (-10.0, -8.0), (-2.5, -5.5), (0.4, 0.0),
        (3.0, 7.0), (11.0, 9.5), (19.0, 8.0), (21.5, 0.0), (20.0, -7.0), (13.0, -6.5), (4.0, -7.0),
        (-5.0, -6.5), (-14.0, -8.0), (-22.0, -4.0), (-24.0, 4.0), (-17.0, 8.5), (-7.0, 7.0), (3.0, 8.0),
        (12.0, 10.0), (19.0, 8.0),
    ],
];

/// Distance between piling groups along a row, metres.
const PILING_SPACING: f64 = 6.0;
/// Distance between rows of pilings, metres.
const ROW_SPACING: f64 = 8.0;

fn harbor(rng: &mut impl Rng) -> World {
    let mut world = World::default();
    let quay = world.add(Shape::Segment([Point2::new(-30.0, 25.0), Point2::new(30.0, 25.0)]), 0.9);
    for x in [-28.5, 28.5] {
        world.add_part(Shape::rectangle(&Isometry2::translation(x, 22.0), 3.0, 6.0), 0.9, quay);
    }
    for row in [-1.0, 0.0, 1.0] {
        for column in 0..8 {
            let center = Vector2::new((f64::from(column) - 3.5) * PILING_SPACING, row * ROW_SPACING);
            add_piling(&mut world, center, rng);
        }
    }
    world.add(Shape::rectangle(&pose(-12.0, -28.5, 8.0), 12.0, 4.0), 0.8);
    let dock = world.add(Shape::rectangle(&pose(34.0, 4.0, 90.0), 10.0, 2.5), 0.8);
    world.add_part(Shape::rectangle(&pose(36.5, 8.0, 0.0), 5.0, 2.5), 0.8, dock);
    world.add(Shape::rectangle(&pose(13.0, -25.5, -20.0), 7.0, 3.0), 0.8);
    world.add(Shape::rectangle(&pose(-34.0, -3.0, 70.0), 6.0, 4.5), 0.8);
    world.add(polygon(&[(31.0, -12.0), (35.0, -10.5), (36.0, -15.0), (33.0, -16.5)]), 0.8);
    world
}

/// Four piles on a square of 1.6 m, each within centimetres of its place.
fn add_piling(world: &mut World, center: Vector2<f64>, rng: &mut impl Rng) {
    let Ok(jitter) = Normal::new(0.0, 0.05) else { return };
    let mut object = None;
    for (x, y) in [(-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8)] {
        let offset = Vector2::new(x + jitter.sample(rng), y + jitter.sample(rng));
        let pile = Shape::Disk { center: Point2::from(center + offset), radius: 0.4 };
        match object {
            None => object = Some(world.add(pile, 0.9)),
            Some(object) => world.add_part(pile, 0.9, object),
        }
    }
}

fn wreck(rng: &mut impl Rng) -> World {
    let mut world = World::default();
    // The fuselage, 25 m by 4 m, is broken: six metres of free water between its nose and its tail section.
    world.add(
        polygon(&[(-2.6, -2.0), (-2.6, 2.0), (-11.0, 2.0), (-15.0, 0.8), (-15.5, -0.6), (-11.0, -2.0)]),
        0.9,
    );
    world.add(polygon(&[(3.4, -1.8), (15.0, -1.2), (16.0, 0.4), (15.0, 1.2), (3.4, 2.0)]), 0.9);
    world.add(Shape::rectangle(&pose(9.0, 16.0, 25.0), 15.0, 4.0), 0.85);
    world.add(Shape::rectangle(&pose(-12.0, -15.0, -12.0), 10.0, 4.0), 0.85);
    world.add(Shape::rectangle(&pose(26.5, 2.5, 70.0), 6.0, 3.0), 0.85);
    for (x, y) in [(-14.0, 15.5), (7.5, -14.0), (19.0, -14.5)] {
        world.add(Shape::Disk { center: Point2::new(x, y), radius: 1.5 }, 0.9);
    }
    let debris = [(-29.5, -27.0), (30.0, 27.0), (-27.0, 29.5), (24.0, -30.0), (-41.0, 12.0), (41.0, -14.0)];
    for (x, y) in debris {
        let turned = pose(
            x + rng.random_range(-1.5..1.5),
            y + rng.random_range(-1.5..1.5),
            rng.random_range(0.0..180.0),
        );
        world.add(Shape::rectangle(&turned, rng.random_range(3.0..4.0), rng.random_range(1.0..2.5)), 0.8);
    }
    world
}

fn pose(x: f64, y: f64, degrees: f64) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(x, y), degrees.to_radians())
}

fn polygon(corners: &[(f64, f64)]) -> Shape {
    Shape::Polygon(corners.iter().map(|&(x, y)| Point2::new(x, y)).collect())
}

use std::borrow::Cow;

use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Shape, World};

/// Vehicles on straight lines, to and fro.
pub(super) struct Movers(Vec<Mover>);

struct Mover {
    start: Point2<f64>,
    along: Vector2<f64>,
    length: f64,
    speed: f64,
}

/// Radius of a vehicle, metres.
const RADIUS: f64 = 1.5;

impl Movers {
    pub(super) fn new(count: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // a stream of their own, so that they move nothing else
        rng.set_stream(u64::MAX);
        let mover = |_| {
            let angle = rng.random_range(0.0..std::f64::consts::TAU);
            Mover {
                start: Point2::new(rng.random_range(-35.0..35.0), rng.random_range(-28.0..28.0)),
                along: Vector2::new(f64::cos(angle), f64::sin(angle)),
                length: rng.random_range(10.0..40.0),
                speed: rng.random_range(0.2..1.0),
            }
        };
        Movers((0..count).map(mover).collect())
    }

    /// The world with everybody where they are at `time`.
    pub(super) fn add_to<'a>(&self, world: &'a World, time: f64) -> Cow<'a, World> {
        let mut here = Cow::Borrowed(world);
        for mover in &self.0 {
            let gone = (mover.speed * time).rem_euclid(2.0 * mover.length);
            let center = mover.start + mover.along * (mover.length - (gone - mover.length).abs());
            here.to_mut().add(Shape::Disk { center, radius: RADIUS }, 0.8);
        }
        here
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn movers_move_and_come_back() {
        let movers = Movers::new(3, 1);
        let at = |time| movers.add_to(&World::default(), time).into_owned();
        assert_ne!(at(0.0), at(5.0));
        assert_eq!(movers.add_to(&World::default(), 0.0).solids.len(), 3);
        assert!(matches!(Movers::new(0, 1).add_to(&World::default(), 9.0), Cow::Borrowed(_)));
    }
}

use nalgebra::{SMatrix, SVector};

use crate::kd_tree::{KdTree, TwoNearest};
use crate::parallel::for_chunks;

/// A source point and its nearest target point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    /// Index of the source point.
    pub(crate) source: u32,
    /// Position of the target point in tree order.
    pub(crate) target: u32,
    pub(crate) distance_sq: f64,
}

/// The nearest target point of every source point, remembered between iterations.
///
/// A point that has moved by δ since its query still has the same neighbour `n` if `|x - n| < d₂ - δ`, with `d₂`
/// the distance of the runner-up at the query: no other point can have come closer. Late iterations move
/// little, so most queries are saved, and the answer is the exact one.
pub(crate) struct Association<const D: usize> {
    cache: Vec<Cached<D>>,
    max_distance: f64,
    /// Search radius: somewhat more than `max_distance`, so that points without a partner can be skipped, too.
    reach: f64,
}

#[derive(Clone, Copy)]
struct Cached<const D: usize> {
    query: SVector<f64, D>,
    position: u32,
    second: f64,
    /// Squared distance of the neighbour from where the point is now.
    distance_sq: f64,
}

/// Raises an upper bound of a distance above its rounding.
const ROUNDING: f64 = 1.0 + 1e-9;

const NONE: u32 = u32::MAX;

impl<const D: usize> Association<D> {
    pub(crate) fn new(points: usize, max_distance: f64) -> Self {
        let never = Cached {
            query: SVector::repeat(f64::INFINITY),
            position: NONE,
            second: 0.0,
            distance_sq: f64::INFINITY,
        };
        Self { cache: vec![never; points], max_distance, reach: 1.25 * max_distance }
    }

    /// Pairs of all source points that have a target point within `max_distance`, in the order of the source.
    pub(crate) fn update(
        &mut self,
        tree: &KdTree<D>,
        source: &[SVector<f64, D>],
        rotation: &SMatrix<f64, D, D>,
        translation: &SVector<f64, D>,
        pairs: &mut Vec<Pair>,
    ) {
        let max_distance = self.max_distance;
        let reach = self.reach;
        for_chunks(&mut self.cache, source, |cache, points| {
            let mut previous = (SVector::repeat(f64::INFINITY), 0.0);
            for (cached, point) in cache.iter_mut().zip(points) {
                let x = rotation * point + translation;
                let moved = (x - cached.query).norm();
                let bound = cached.second - moved;
                let known = if cached.position == NONE {
                    bound > max_distance
                } else {
                    cached.distance_sq = (tree.point_at(cached.position as usize) - x).norm_squared();
                    bound > 0.0 && cached.distance_sq < bound * bound
                };
                if known {
                    continue;
                }
                // both points found here before, or found for the point before, lie within their distance then plus
                // the way moved since; a runner-up at `reach` stands for none, and stays there
                let other: f64 = (x - previous.0).norm() + previous.1;
                let limit = (ROUNDING * other.min(moved + cached.second)).min(reach);
                let mut found = TwoNearest::within(limit * limit);
                tree.search(&x, &mut found);
                let second = found.second_sq.sqrt();
                *cached =
                    Cached { query: x, position: found.position, second, distance_sq: found.distance_sq };
                previous = (x, second);
            }
        });
        let max_sq = max_distance * max_distance;
        pairs.clear();
        for (cached, index) in self.cache.iter().zip(0u32..) {
            if cached.distance_sq <= max_sq {
                pairs.push(Pair { source: index, target: cached.position, distance_sq: cached.distance_sq });
            }
        }
    }
}

use nalgebra::{SMatrix, SVector};
use pulp::{Arch, NullaryFnOnce};

use crate::kd_tree::{KdTree, NearestFew, Visitor};
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

/// Target points remembered for a source point.
const CANDIDATES: usize = 2;

/// The nearest target point of every source point, remembered between iterations.
///
/// A query keeps the nearest few and the distance `d` of the next after them. While the point has moved by δ since, no
/// other can be nearer than `d - δ`, so if one of the few is, the nearest of them is the nearest of all. Most
/// queries are saved, and the answer is the exact one.
pub(crate) struct Association<const D: usize> {
    cache: Vec<Cached<D>>,
    max_distance: f64,
    /// Search radius: somewhat more than `max_distance`, so that points without a partner can be skipped, too.
    reach: f64,
}

#[derive(Clone, Copy)]
struct Cached<const D: usize> {
    query: SVector<f64, D>,
    /// Tree positions by distance at the query, then `NONE`.
    candidates: [u32; CANDIDATES],
    /// All others were at least this far at the query.
    guard: f64,
    /// The nearest where the point is now, and its squared distance.
    position: u32,
    distance_sq: f64,
}

impl<const D: usize> Cached<D> {
    /// Takes the nearest of the candidates to where the point is now.
    #[inline(always)]
    fn choose(&mut self, tree: &KdTree<D>, x: &SVector<f64, D>) {
        (self.position, self.distance_sq) = (NONE, f64::INFINITY);
        for candidate in self.candidates {
            if candidate == NONE {
                break;
            }
            let distance_sq = (tree.point_at(candidate as usize) - x).norm_squared();
            let order = tree.order();
            let tie = || order[candidate as usize] < order[self.position as usize];
            if distance_sq < self.distance_sq || (distance_sq == self.distance_sq && tie()) {
                (self.position, self.distance_sq) = (candidate, distance_sq);
            }
        }
    }
}

/// Raises an upper bound of a distance above its rounding.
const ROUNDING: f64 = 1.0 + 1e-9;

const NONE: u32 = u32::MAX;

/// The queries of a run of points, as one piece of work that is compiled for the processor's vectors.
struct Queries<'a, const D: usize> {
    tree: &'a KdTree<D>,
    rotation: &'a SMatrix<f64, D, D>,
    translation: &'a SVector<f64, D>,
    max_distance: f64,
    reach: f64,
    cache: &'a mut [Cached<D>],
    points: &'a [SVector<f64, D>],
}

impl<const D: usize> NullaryFnOnce for Queries<'_, D> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut previous = (SVector::repeat(f64::INFINITY), 0.0, NONE);
        for (cached, point) in self.cache.iter_mut().zip(self.points) {
            let x = self.rotation * point + self.translation;
            let moved = (x - cached.query).norm();
            let bound = cached.guard - moved;
            cached.choose(self.tree, &x);
            let known = bound > self.max_distance || (bound > 0.0 && cached.distance_sq < bound * bound);
            if known {
                continue;
            }
            // as many points as are kept here were found before, or for the point before, within their guard then plus
            // the way moved since; a guard at `reach` may stand for fewer points, and stays there
            let other: f64 = (x - previous.0).norm() + previous.1;
            let limit = (ROUNDING * other.min(moved + cached.guard)).min(self.reach);
            let mut found = NearestFew::<{ CANDIDATES + 1 }>::within(limit * limit);
            let near = if cached.position == NONE { previous.2 } else { cached.position };
            if near == NONE {
                self.tree.search(&x, &mut found);
            } else {
                self.tree.search_from(&x, near, &mut found);
            }
            cached.query = x;
            cached.candidates = std::array::from_fn(|i| found.positions[i]);
            cached.guard = found.limit_sq().sqrt();
            (cached.position, cached.distance_sq) = (found.positions[0], found.squares[0]);
            previous = (x, cached.guard, cached.position);
        }
    }
}

impl<const D: usize> Association<D> {
    pub(crate) fn new(points: usize, max_distance: f64) -> Self {
        let never = Cached {
            query: SVector::repeat(f64::INFINITY),
            candidates: [NONE; CANDIDATES],
            guard: 0.0,
            position: NONE,
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
        let (max_distance, reach) = (self.max_distance, self.reach);
        for_chunks(&mut self.cache, source, |cache, points| {
            Arch::new().dispatch(Queries { tree, rotation, translation, max_distance, reach, cache, points });
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

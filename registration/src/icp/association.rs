use nalgebra::{SMatrix, SVector};
use pulp::{Arch, Simd, WithSimd};

use super::space_order::space_order;
use crate::kd_tree::{Group, KdTree, NearestFew, Ranks, Visitor};
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
    /// Indices of the source points, neighbours together, and the points and what is known of them in this order.
    order: Vec<u32>,
    points: Vec<SVector<f64, D>>,
    cache: Vec<Cached<D>>,
    /// Nearest target point and its squared distance in the order of the source.
    nearest: Vec<(u32, f64)>,
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

impl<const D: usize> Cached<D> {
    /// The nearest within the query's limit, the walk begun at the leaf of `near` if that is a point; within `reach` if
    /// rounding made the limit too small.
    #[inline(always)]
    fn search(tree: &KdTree<D>, x: &SVector<f64, D>, limit: f64, reach: f64, near: u32) -> Self {
        let mut found = NearestFew::<{ CANDIDATES + 1 }>::within(limit * limit);
        if near == NONE {
            tree.search(x, &mut found);
        } else {
            tree.search_from(x, near, &mut found);
        }
        if found.positions[0] == NONE && limit < reach {
            found = NearestFew::within(reach * reach);
            tree.search(x, &mut found);
        }
        Self {
            query: *x,
            candidates: std::array::from_fn(|i| found.positions[i]),
            guard: found.limit_sq().sqrt(),
            position: found.positions[0],
            distance_sq: found.squares[0],
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

impl<const D: usize> WithSimd for Queries<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = Found::<S, D>::LANES.min(MOST_TOGETHER);
        let mut last = Last { place: SVector::repeat(f64::INFINITY), guard: 0.0, position: NONE };
        let mut open = Open::new(self.reach);
        for (cache, points) in self.cache.chunks_mut(lanes).zip(self.points.chunks(lanes)) {
            open.count = 0;
            for (lane, (cached, point)) in cache.iter_mut().zip(points).enumerate() {
                let x = self.rotation * point + self.translation;
                let moved = (x - cached.query).norm();
                let bound = cached.guard - moved;
                cached.choose(self.tree, &x);
                if bound > self.max_distance || (bound > 0.0 && cached.distance_sq < bound * bound) {
                    continue;
                }
                // as many points as are kept here were found before, or for the last query, within their guard then plus
                // the way since; a guard at `reach` may stand for fewer points, and stays there
                let other: f64 = (x - last.place).norm() + last.guard;
                let limit = (ROUNDING * other.min(moved + cached.guard)).min(self.reach);
                open.add(lane, x, limit);
            }
            if open.is_group() {
                open.search_together(simd, self.tree, cache, &mut last);
            } else {
                open.search_singly(self.tree, cache, &mut last);
            }
        }
    }
}

/// What is found for a group: the candidates and the next after them.
type Found<S, const D: usize> = Group<S, D, { CANDIDATES + 1 }>;

/// The last query that was searched, where the next may begin.
struct Last<const D: usize> {
    place: SVector<f64, D>,
    guard: f64,
    position: u32,
}

/// Queries of a run of points that their cache cannot answer.
struct Open<const D: usize> {
    count: usize,
    lanes: [usize; MOST_TOGETHER],
    places: [SVector<f64, D>; MOST_TOGETHER],
    /// As many points as are kept lie within, or all that count.
    limits: [f64; MOST_TOGETHER],
    /// Nothing farther is wanted.
    reach: f64,
}

/// Queries that are searched at once.
const MOST_TOGETHER: usize = 8;

/// Fewer queries are searched one by one.
const FEWEST_TOGETHER: usize = 4;

/// Queries that spread wider than so many of their limits are searched one by one.
const WIDEST_TOGETHER: f64 = 16.0;

impl<const D: usize> Open<D> {
    fn new(reach: f64) -> Self {
        let places = [SVector::zeros(); MOST_TOGETHER];
        Self { count: 0, lanes: [0; MOST_TOGETHER], places, limits: [0.0; MOST_TOGETHER], reach }
    }

    #[inline(always)]
    fn add(&mut self, lane: usize, place: SVector<f64, D>, limit: f64) {
        (self.lanes[self.count], self.places[self.count], self.limits[self.count]) = (lane, place, limit);
        self.count += 1;
    }

    #[inline(always)]
    fn is_group(&self) -> bool {
        let places = &self.places[..self.count];
        let least = self.limits[..self.count].iter().fold(f64::INFINITY, |least, limit| least.min(*limit));
        let widest = WIDEST_TOGETHER * least;
        self.count >= FEWEST_TOGETHER
            && places.iter().all(|p| (p - places[0]).norm_squared() <= widest * widest)
    }

    #[inline(always)]
    fn search_singly(&self, tree: &KdTree<D>, cache: &mut [Cached<D>], last: &mut Last<D>) {
        for k in 0..self.count {
            let (x, limit) = (self.places[k], self.limits[k]);
            let cached = &mut cache[self.lanes[k]];
            let near = if cached.position == NONE { last.position } else { cached.position };
            *cached = Cached::search(tree, &x, limit, self.reach, near);
            *last = Last { place: x, guard: cached.guard, position: cached.position };
        }
    }

    #[inline(always)]
    fn search_together<S: Simd>(
        &self,
        simd: S,
        tree: &KdTree<D>,
        cache: &mut [Cached<D>],
        last: &mut Last<D>,
    ) {
        let mut group = Found::new(simd, &self.places[..self.count], &self.limits[..self.count]);
        let near = cache[self.lanes[self.count / 2]].position;
        tree.search_group(&mut group, (near != NONE).then_some(near));
        for k in 0..self.count {
            let cached = &mut cache[self.lanes[k]];
            let Ranks { squares, positions } = group.ranks(k);
            let tie = positions[1] != NONE && squares[0] == squares[1];
            *cached = if tie || (positions[0] == NONE && self.limits[k] < self.reach) {
                // of equally near points the one of the lowest index is wanted
                Cached::search(tree, &self.places[k], self.limits[k], self.reach, positions[0])
            } else {
                Cached {
                    query: self.places[k],
                    candidates: std::array::from_fn(|i| positions[i]),
                    guard: squares[CANDIDATES].sqrt(),
                    position: positions[0],
                    distance_sq: if positions[0] == NONE { f64::INFINITY } else { squares[0] },
                }
            };
            *last = Last { place: cached.query, guard: cached.guard, position: cached.position };
        }
    }
}

impl<const D: usize> Association<D> {
    pub(crate) fn new(points: &[SVector<f64, D>], max_distance: f64) -> Self {
        let never = Cached {
            query: SVector::repeat(f64::INFINITY),
            candidates: [NONE; CANDIDATES],
            guard: 0.0,
            position: NONE,
            distance_sq: f64::INFINITY,
        };
        let order = space_order(points);
        Self {
            points: order.iter().map(|index| points[*index as usize]).collect(),
            cache: vec![never; points.len()],
            nearest: vec![(NONE, f64::INFINITY); points.len()],
            order,
            max_distance,
            reach: 1.25 * max_distance,
        }
    }

    /// Pairs of all source points that have a target point within `max_distance`, in the order of the source.
    pub(crate) fn update(
        &mut self,
        tree: &KdTree<D>,
        rotation: &SMatrix<f64, D, D>,
        translation: &SVector<f64, D>,
        pairs: &mut Vec<Pair>,
    ) {
        let (max_distance, reach) = (self.max_distance, self.reach);
        for_chunks(&mut self.cache, &self.points, |cache, points| {
            Arch::new().dispatch(Queries { tree, rotation, translation, max_distance, reach, cache, points });
        });
        for (cached, index) in self.cache.iter().zip(&self.order) {
            self.nearest[*index as usize] = (cached.position, cached.distance_sq);
        }
        let max_sq = max_distance * max_distance;
        pairs.clear();
        for ((target, distance_sq), source) in self.nearest.iter().copied().zip(0u32..) {
            if distance_sq <= max_sq {
                pairs.push(Pair { source, target, distance_sq });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};
    use proptest::prelude::*;

    use super::*;

    /// Few values a coordinate, so that many points are equal or equally near; in no order.
    fn places(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        let value = prop_oneof![(-2..3i32).prop_map(f64::from), -2.0..2.0f64];
        prop::collection::vec([value.clone(), value.clone(), value].prop_map(Vector3::from), count)
    }

    proptest! {
        /// Over a run of motions that grow smaller, as ICP's do, with none among them.
        #[test]
        fn pairs_are_those_of_brute_force(
            target in places(1..120),
            source in places(1..80),
            repeated in 1..4usize,
            motions in prop::collection::vec([-1.0..1.0f64, -1.0..1.0, -1.0..1.0].prop_map(Vector3::from), 1..5),
            reach in prop_oneof![Just(0.3), Just(1.0), Just(100.0)],
        ) {
            let target: Vec<_> = target.iter().flat_map(|p| std::iter::repeat_n(*p, repeated)).collect();
            let tree = KdTree::new(&target).unwrap();
            let mut association = Association::new(&source, reach);
            let mut pairs = Vec::new();
            for (k, motion) in motions.iter().enumerate() {
                let size = [0.0, 0.5, 0.1, 0.01, 0.0][k];
                let rotation = Rotation3::new(motion * size).into_inner();
                association.update(&tree, &rotation, &(motion * size), &mut pairs);
                let mut expected = Vec::new();
                for (index, p) in source.iter().enumerate() {
                    let x = rotation * p + motion * size;
                    let distance_to = |q: &Vector3<f64>| (q - x).norm_squared();
                    let least = target.iter().map(distance_to).fold(f64::INFINITY, f64::min);
                    let first = target.iter().position(|q| distance_to(q) == least).unwrap();
                    if least <= reach * reach {
                        expected.push((index as u32, first as u32, least));
                    }
                }
                let found: Vec<_> =
                    pairs.iter().map(|p| (p.source, tree.order()[p.target as usize], p.distance_sq)).collect();
                prop_assert_eq!(found, expected);
            }
        }
    }
}

use nalgebra::SVector;
use pulp::{Simd, bytemuck};

use super::bounds::Bounds;
use super::leaf::{LEAF, Leaf};
use super::probe::Probe;

/// Vectors of the processor that hold a group's queries.
const VECTORS: usize = 2;

/// The nearest `K` points of several queries that lie close together, found in one walk: what is near one is near the
/// others, and the queries are served side by side.
pub(crate) struct Group<S: Simd, const D: usize, const K: usize> {
    simd: S,
    guide: SVector<f64, D>,
    queries: [[S::f64s; VECTORS]; D],
    /// By rank, ascending; the square of about the limit where there are fewer points.
    squares: [[S::f64s; VECTORS]; K],
    /// Tree positions as numbers of the lanes' type; `NONE` where there are fewer.
    positions: [[S::f64s; VECTORS]; K],
}

const NONE: f64 = u32::MAX as f64;

/// The points found for one query of a group: squared distances, ascending, and tree positions.
///
/// Where there are fewer points the square is about that of the limit and the position `u32::MAX`. Of equally near points
/// any may come first.
pub(crate) struct Ranks<const K: usize> {
    pub(crate) squares: [f64; K],
    pub(crate) positions: [u32; K],
}

impl<S: Simd, const D: usize, const K: usize> Group<S, D, K> {
    /// Queries a group can hold.
    pub(crate) const LANES: usize = VECTORS * S::F64_LANES;

    /// * `places`, `limits` – queries, at least one, and the distances up to which points count, metres.
    #[inline(always)]
    pub(crate) fn new(simd: S, places: &[SVector<f64, D>], limits: &[f64]) -> Self {
        let zero = simd.splat_f64s(0.0);
        let mut group = Self {
            simd,
            guide: places.iter().sum::<SVector<f64, D>>() / places.len() as f64,
            queries: [[zero; VECTORS]; D],
            squares: [[zero; VECTORS]; K],
            positions: [[simd.splat_f64s(NONE); VECTORS]; K],
        };
        // lanes that are left over look for the same as the first
        for (axis, lanes) in group.queries.iter_mut().enumerate() {
            for (lane, query) in bytemuck::cast_slice_mut(lanes).iter_mut().enumerate() {
                *query = places.get(lane).unwrap_or(&places[0])[axis];
            }
        }
        for (lane, square) in bytemuck::cast_slice_mut(&mut group.squares[0]).iter_mut().enumerate() {
            // points at the limit count, those of a limit of zero, too
            *square =
                limits.get(lane).unwrap_or(&limits[0]).powi(2) * (1.0 + f64::EPSILON) + f64::MIN_POSITIVE;
        }
        group.squares = [group.squares[0]; K];
        group
    }

    #[inline(always)]
    pub(crate) fn ranks(&self, lane: usize) -> Ranks<K> {
        let of = |lanes: &[S::f64s; VECTORS]| bytemuck::cast_slice::<_, f64>(lanes)[lane];
        Ranks {
            squares: std::array::from_fn(|k| of(&self.squares[k])),
            positions: std::array::from_fn(|k| of(&self.positions[k]) as u32),
        }
    }

    /// Whether a value is below the limit of its query.
    #[inline(always)]
    fn any_below_limit(&self, values: &[S::f64s; VECTORS]) -> bool {
        let below = std::array::from_fn::<_, VECTORS, _>(|v| {
            self.simd.less_than_f64s(values[v], self.squares[K - 1][v])
        });
        self.simd
            .first_true_m64s(below.into_iter().reduce(|a, b| self.simd.or_m64s(a, b)).unwrap_or(below[0]))
            < S::F64_LANES
    }

    /// Puts a point into its rank for every query, without branches; what is pushed out goes to the next rank.
    #[inline(always)]
    fn insert(&mut self, squares: [S::f64s; VECTORS], position: f64) {
        let simd = self.simd;
        for (v, mut square) in squares.into_iter().enumerate() {
            let mut position = simd.splat_f64s(position);
            for k in 0..K {
                let (old, old_position) = (self.squares[k][v], self.positions[k][v]);
                let closer = simd.less_than_f64s(square, old);
                self.squares[k][v] = simd.min_f64s(square, old);
                square = simd.max_f64s(square, old);
                self.positions[k][v] = simd.select_f64s(closer, position, old_position);
                position = simd.select_f64s(closer, old_position, position);
            }
        }
    }
}

impl<S: Simd, const D: usize, const K: usize> Probe<D> for Group<S, D, K> {
    #[inline(always)]
    fn guide(&self) -> &SVector<f64, D> {
        &self.guide
    }

    #[inline(always)]
    fn may_want(&self, bounds: &Bounds<D>) -> bool {
        let simd = self.simd;
        let zero = simd.splat_f64s(0.0);
        let mut sums = [zero; VECTORS];
        for axis in 0..D {
            let (low, high) = (simd.splat_f64s(bounds.low[axis]), simd.splat_f64s(bounds.high[axis]));
            for (sum, query) in sums.iter_mut().zip(self.queries[axis]) {
                let out = simd.max_f64s(simd.sub_f64s(low, query), simd.sub_f64s(query, high));
                let out = simd.max_f64s(out, zero);
                *sum = simd.add_f64s(*sum, simd.mul_f64s(out, out));
            }
        }
        self.any_below_limit(&sums)
    }

    #[inline(always)]
    fn is_settled_in(&self, cell: &Bounds<D>) -> bool {
        let simd = self.simd;
        let mut margins = [simd.splat_f64s(f64::INFINITY); VECTORS];
        for axis in 0..D {
            let (low, high) = (simd.splat_f64s(cell.low[axis]), simd.splat_f64s(cell.high[axis]));
            for (margin, query) in margins.iter_mut().zip(self.queries[axis]) {
                let least = simd.min_f64s(simd.sub_f64s(query, low), simd.sub_f64s(high, query));
                *margin = simd.min_f64s(*margin, least);
            }
        }
        // a place outside has margin 0, which is below any limit
        let squares = margins.map(|m| {
            let inside = simd.max_f64s(m, simd.splat_f64s(0.0));
            simd.mul_f64s(inside, inside)
        });
        !self.any_below_limit(&squares)
    }

    #[inline(always)]
    fn scan(&mut self, leaf: &Leaf<D>, _: &[u32]) {
        let simd = self.simd;
        for slot in 0..LEAF {
            let mut squares = [simd.splat_f64s(0.0); VECTORS];
            for axis in 0..D {
                let value = simd.splat_f64s(leaf.coordinates[axis][slot]);
                for (square, query) in squares.iter_mut().zip(self.queries[axis]) {
                    let d = simd.sub_f64s(value, query);
                    *square = simd.add_f64s(*square, simd.mul_f64s(d, d));
                }
            }
            if self.any_below_limit(&squares) {
                self.insert(squares, f64::from(leaf.begin) + slot as f64);
            }
        }
    }
}

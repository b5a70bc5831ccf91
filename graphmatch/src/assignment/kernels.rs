//! The inner loops of dense assignment, on whatever vectors the machine has. Ties go to the smallest column, so that the
//! answer does not depend on their width.
use pulp::{Simd, bytemuck};

use super::row_reduction::Bid;

/// Vectors between two looks whether the search may end.
const STRETCH: usize = 32;

/// Running minimum of numbered values, lane by lane; numbers are kept as values of the lanes' type.
#[derive(Clone, Copy)]
struct Least<S: Simd> {
    value: S::f64s,
    column: S::f64s,
}

impl<S: Simd> Least<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        Self { value: simd.splat_f64s(f64::INFINITY), column: simd.splat_f64s(0.0) }
    }

    /// * `vector` – number of the vector that `value` is.
    #[inline(always)]
    fn take(&mut self, simd: S, value: S::f64s, vector: S::f64s) {
        let better = simd.less_than_f64s(value, self.value);
        self.column = simd.select_f64s(better, vector, self.column);
        self.value = simd.min_f64s(value, self.value);
    }

    /// Least value and the first column that has it.
    #[inline(always)]
    fn finish(&self) -> (f64, usize) {
        let values: &[f64] = bytemuck::cast_slice(std::slice::from_ref(&self.value));
        let vectors: &[f64] = bytemuck::cast_slice(std::slice::from_ref(&self.column));
        let mut best = (f64::INFINITY, 0);
        for (lane, (value, vector)) in values.iter().zip(vectors).enumerate() {
            let column = *vector as usize * values.len() + lane;
            if *value < best.0 || (*value == best.0 && column < best.1) {
                best = (*value, column);
            }
        }
        best
    }
}

/// The least two of `c − v`; `None` if no column is allowed.
#[inline(always)]
pub(super) fn two_least<S: Simd>(simd: S, costs: &[f64], v: &[f64]) -> Option<Bid> {
    let (cs, c_tail) = S::as_simd_f64s(costs);
    let (vs, v_tail) = S::as_simd_f64s(v);
    let mut first = Least::new(simd);
    let mut second = first.value;
    let (one, mut number) = (simd.splat_f64s(1.0), simd.splat_f64s(0.0));
    for (&c, &v) in cs.iter().zip(vs) {
        let r = simd.sub_f64s(c, v);
        second = simd.min_f64s(second, simd.max_f64s(first.value, r));
        first.take(simd, r, number);
        number = simd.add_f64s(number, one);
    }
    let (value, best) = first.finish();
    let mut bid = Bid { best, value, next: simd.reduce_min_f64s(second) };
    // The least of every other lane is a second choice too.
    let firsts: &[f64] = bytemuck::cast_slice(std::slice::from_ref(&first.value));
    for (lane, r) in firsts.iter().enumerate() {
        if lane != best % firsts.len() {
            bid.next = bid.next.min(*r);
        }
    }
    let from = costs.len() - c_tail.len();
    for (k, (c, v)) in c_tail.iter().zip(v_tail).enumerate() {
        let r = c - v;
        if r < bid.value {
            bid = Bid { best: from + k, value: r, next: bid.value };
        } else {
            bid.next = bid.next.min(r);
        }
    }
    (bid.value < f64::INFINITY).then_some(bid)
}

/// What the shortest-path search knows of every column.
pub(super) struct Columns {
    /// Dual of columns still open, -∞ of those done, which makes their reduced costs infinite.
    pub(super) open_v: Vec<f64>,
    /// Length of the shortest path so far of open columns, +∞ of those done.
    pub(super) key: Vec<f64>,
    /// Row before each column on its shortest path, as a number of the lanes' type.
    pub(super) row_before: Vec<f64>,
    /// 0 for idle columns, +∞ for assigned ones.
    pub(super) busy: Vec<f64>,
}

/// What a relaxed row leads to: the open column of the shortest path, and the shortest path to an idle column.
pub(super) struct Nearest {
    pub(super) column: usize,
    pub(super) length: f64,
    pub(super) idle: f64,
}

impl Columns {
    /// Shortens paths through `row`, whose paths are `c − v − offset` long.
    ///
    /// * `level` – length of the path to `row`: at an idle column no farther the work stops, as none can be nearer.
    #[inline(always)]
    pub(super) fn relax<S: Simd>(
        &mut self,
        simd: S,
        costs: &[f64],
        row: usize,
        [offset, level]: [f64; 2],
    ) -> Nearest {
        let (cs, c_tail) = S::as_simd_f64s(costs);
        let (vs, v_tail) = S::as_simd_f64s(&self.open_v);
        let (bs, b_tail) = S::as_simd_f64s(&self.busy);
        let (keys, key_tail) = S::as_mut_simd_f64s(&mut self.key);
        let (rows, row_tail) = S::as_mut_simd_f64s(&mut self.row_before);
        let (offsets, own) = (simd.splat_f64s(offset), simd.splat_f64s(row as f64));
        let (one, mut number) = (simd.splat_f64s(1.0), simd.splat_f64s(0.0));
        let mut least = Least::new(simd);
        let mut idle = least.value;
        let stretches = cs.chunks(STRETCH).zip(vs.chunks(STRETCH)).zip(bs.chunks(STRETCH));
        let buffers = keys.chunks_mut(STRETCH).zip(rows.chunks_mut(STRETCH));
        for (((cs, vs), bs), (keys, rows)) in stretches.zip(buffers) {
            for ((((&c, &v), &b), key), before) in cs.iter().zip(vs).zip(bs).zip(keys).zip(rows) {
                let r = simd.sub_f64s(simd.sub_f64s(c, v), offsets);
                let better = simd.less_than_f64s(r, *key);
                *before = simd.select_f64s(better, own, *before);
                *key = simd.min_f64s(r, *key);
                least.take(simd, *key, number);
                idle = simd.min_f64s(idle, simd.add_f64s(*key, b));
                number = simd.add_f64s(number, one);
            }
            if simd.reduce_min_f64s(idle) <= level {
                break;
            }
        }
        let (length, column) = least.finish();
        let mut nearest = Nearest { column, length, idle: simd.reduce_min_f64s(idle) };
        let from = costs.len() - c_tail.len();
        for (k, ((c, v), b)) in c_tail.iter().zip(v_tail).zip(b_tail).enumerate() {
            let r = c - v - offset;
            if r < key_tail[k] {
                (key_tail[k], row_tail[k]) = (r, row as f64);
            }
            if key_tail[k] < nearest.length {
                (nearest.column, nearest.length) = (from + k, key_tail[k]);
            }
            nearest.idle = nearest.idle.min(key_tail[k] + b);
        }
        nearest
    }
}

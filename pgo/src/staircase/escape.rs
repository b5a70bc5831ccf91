use nalgebra::{SMatrix, SVector};

use super::lifted::{Lifted, Point};
use crate::certify::Dual;
use crate::sparse::BlockMatrix;

/// Rounds of inverse iteration, at most.
const ROUNDS: usize = 200;
/// Bisections of the shift that makes the matrix definite.
const BISECTIONS: usize = 6;

/// A direction along which the certificate matrix curves downwards, by inverse iteration around a shift just
/// beyond its least eigenvalue; `None` when the matrix shows no negative eigenvalue.
pub(super) fn descent_direction<const D: usize, const M: usize>(
    dual: &mut Dual<D, M>,
    matrix: &BlockMatrix<M>,
) -> Option<Vec<SVector<f64, M>>> {
    let (mut low, mut high) = bracket(dual, matrix)?;
    for _ in 0..BISECTIONS {
        let middle = (low * high).sqrt();
        if dual.is_positive(matrix, middle) { high = middle } else { low = middle }
    }
    if !dual.is_positive(matrix, high) {
        return None;
    }
    let mut v = start::<M>(matrix.diagonal.len());
    let mut last = f64::INFINITY;
    for _ in 0..ROUNDS {
        // only rotations weigh: translations follow them at their best
        v.iter_mut().for_each(|x| x[D] = 0.0);
        let norm = v.iter().map(SVector::norm_squared).sum::<f64>().sqrt();
        v.iter_mut().for_each(|x| *x /= norm);
        dual.solve(&mut v);
        let weight: f64 = v.iter().map(|x| x.fixed_rows::<D>(0).norm_squared()).sum();
        let curvature = matrix.quadratic(&dual.pairs, &v) / weight;
        if curvature < 0.0 && (curvature - last).abs() <= 1e-3 * curvature.abs() {
            return Some(v);
        }
        last = curvature;
    }
    (last < 0.0).then_some(v)
}

/// A shift that leaves the matrix indefinite and one, a power of ten larger, that does not.
fn bracket<const D: usize, const M: usize>(
    dual: &mut Dual<D, M>,
    matrix: &BlockMatrix<M>,
) -> Option<(f64, f64)> {
    let scale = matrix.diagonal.iter().map(SMatrix::amax).fold(0.0, f64::max);
    let mut low = 1e-12 * scale;
    while low <= 10.0 * scale {
        if dual.is_positive(matrix, 10.0 * low) {
            return Some((low, 10.0 * low));
        }
        low *= 10.0;
    }
    None
}

/// A vector in general position, the same in every run (SplitMix64).
fn start<const M: usize>(nodes: usize) -> Vec<SVector<f64, M>> {
    let mut state: u64 = 0;
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..nodes).map(|_| SVector::from_fn(|_, _| next())).collect()
}

/// The point one rank higher, moved along the direction in the new column to where the objective is least among
/// steps that halve; `None` when no step lowers it.
pub(super) fn escape<const D: usize, const M: usize>(
    problem: &Lifted<D, M>,
    point: &Point,
    direction: &[SVector<f64, M>],
) -> Option<Point> {
    let lifted = Lifted::<D, M>::lift(point);
    let r = lifted.rank;
    let mut v = vec![0.0; lifted.x.len()];
    for (node, d) in v.chunks_exact_mut(M * r).zip(direction) {
        for row in 0..M {
            node[row * r + r - 1] = d[row];
        }
    }
    let largest = direction.iter().map(|d| d.fixed_rows::<D>(0).amax()).fold(0.0, f64::max);
    let (mut best, mut cost) = (None, problem.cost(&lifted));
    let mut scale = 2.0 / largest;
    for _ in 0..40 {
        let trial = problem.retract(&lifted, &v, scale);
        let next = problem.cost(&trial);
        if next < cost {
            (best, cost) = (Some(trial), next);
        } else if best.is_some() {
            break;
        }
        scale *= 0.5;
    }
    best
}

use nalgebra::{SMatrix, SVector};

use crate::certify::Parts;
use crate::chordal::Edge;

/// The chordal objective over lifted poses: node `i` is the `M × r` block `[A_i; p_iᵀ]` with `A_i A_iᵀ = I` of size
/// `D × r`, the transposed rotation, and `p_i` the translation; `M = D + 1`. With `r = D` these are poses.
///
/// Values are stored node by node, row by row: entry `(row, c)` of node `i` at `(i · M + row) · r + c`.
pub(crate) struct Lifted<'a, const D: usize, const M: usize> {
    pub(crate) edges: &'a [Edge<D>],
    pub(crate) nodes: usize,
}

/// One value a node, and the rank.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) x: Vec<f64>,
    pub(crate) rank: usize,
}

impl<const D: usize, const M: usize> Lifted<'_, D, M> {
    /// Poses as a point of rank `D`.
    pub(crate) fn point(poses: &[Parts<D>]) -> Point {
        let mut x = Vec::with_capacity(poses.len() * M * D);
        for (rotation, translation) in poses {
            // row `k` of the transposed rotation is column `k` of the rotation
            x.extend(rotation.iter());
            x.extend(translation.iter());
        }
        Point { x, rank: D }
    }

    /// The point with one more, zero, column.
    pub(crate) fn lift(point: &Point) -> Point {
        let r = point.rank;
        let mut x = Vec::with_capacity(point.x.len() / r * (r + 1));
        for row in point.x.chunks_exact(r) {
            x.extend_from_slice(row);
            x.push(0.0);
        }
        Point { x, rank: r + 1 }
    }

    /// The objective, summed edge by edge so that nothing cancels.
    pub(crate) fn cost(&self, point: &Point) -> f64 {
        let r = point.rank;
        let mut sum = 0.0;
        for edge in self.edges {
            let (a, b) = self.ends(edge, &point.x, r);
            let (mut turn, mut shift) = (0.0, 0.0);
            for c in 0..r {
                let (e, s) = residual::<D, M>(edge, a, b, r, c);
                turn += e.norm_squared();
                shift += s * s;
            }
            sum += edge.kappa * turn + edge.tau * shift;
        }
        sum
    }

    /// `Q x`, half the Euclidean gradient of the objective.
    pub(crate) fn times(&self, x: &[f64], r: usize, product: &mut [f64]) {
        product.fill(0.0);
        for edge in self.edges {
            let (a, b) = self.ends(edge, x, r);
            let [i, j] = edge.slots.map(|s| s as usize * M * r);
            for c in 0..r {
                let (e, s) = residual::<D, M>(edge, a, b, r, c);
                let (e, s) = (e * edge.kappa, s * edge.tau);
                let back = edge.rotation * e + edge.translation * s;
                for k in 0..D {
                    product[j + k * r + c] += e[k];
                    product[i + k * r + c] -= back[k];
                }
                product[j + D * r + c] += s;
                product[i + D * r + c] -= s;
            }
        }
    }

    fn ends<'x>(&self, edge: &Edge<D>, x: &'x [f64], r: usize) -> (&'x [f64], &'x [f64]) {
        let [i, j] = edge.slots.map(|s| s as usize * M * r);
        (&x[i..i + M * r], &x[j..j + M * r])
    }

    /// The multipliers `Λ_i = sym((Q x)_i A_iᵀ)` at which the certificate matrix is `Q - Λ`.
    pub(crate) fn multipliers(&self, point: &Point, product: &[f64]) -> Vec<SMatrix<f64, D, D>> {
        let r = point.rank;
        let blocks = point.x.chunks_exact(M * r).zip(product.chunks_exact(M * r));
        blocks
            .map(|(x, q)| {
                let raw = SMatrix::<f64, D, D>::from_fn(|a, b| dot(&q[a * r..][..r], &x[b * r..][..r]));
                (raw + raw.transpose()) * 0.5
            })
            .collect()
    }

    /// Projects onto the tangent space at `point`: `V_i - sym(V_i A_iᵀ) A_i`.
    pub(crate) fn project(&self, point: &Point, v: &mut [f64]) {
        let r = point.rank;
        for (x, v) in point.x.chunks_exact(M * r).zip(v.chunks_exact_mut(M * r)) {
            let raw = SMatrix::<f64, D, D>::from_fn(|a, b| dot(&v[a * r..][..r], &x[b * r..][..r]));
            subtract::<D>(&((raw + raw.transpose()) * 0.5), x, v, r);
        }
    }

    /// The Riemannian Hessian times a tangent vector, halved: the projection of `Q v - Λ v`.
    pub(crate) fn hessian(
        &self,
        point: &Point,
        multipliers: &[SMatrix<f64, D, D>],
        v: &[f64],
        product: &mut [f64],
    ) {
        let r = point.rank;
        self.times(v, r, product);
        let blocks = v.chunks_exact(M * r).zip(product.chunks_exact_mut(M * r));
        for ((v, out), multiplier) in blocks.zip(multipliers) {
            subtract::<D>(multiplier, v, out, r);
        }
        self.project(point, product);
    }

    /// Moves along a tangent vector and back onto the manifold: rows of `A` are made orthonormal one by one.
    pub(crate) fn retract(&self, point: &Point, v: &[f64], scale: f64) -> Point {
        let r = point.rank;
        let mut x: Vec<f64> = point.x.iter().zip(v).map(|(x, v)| x + scale * v).collect();
        for node in x.chunks_exact_mut(M * r) {
            for k in 0..D {
                let (before, rest) = node.split_at_mut(k * r);
                let row = &mut rest[..r];
                for other in before.chunks_exact(r) {
                    let along = dot(row, other);
                    row.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
                }
                let norm = dot(row, row).sqrt();
                row.iter_mut().for_each(|x| *x /= norm);
            }
        }
        Point { x, rank: r }
    }
}

/// Column `c` of the residuals of an edge: `A_j - R_ijᵀ A_i` and `p_j - p_i - t_ijᵀ A_i`.
#[inline(always)]
fn residual<const D: usize, const M: usize>(
    edge: &Edge<D>,
    a: &[f64],
    b: &[f64],
    r: usize,
    c: usize,
) -> (SVector<f64, D>, f64) {
    let from = SVector::<f64, D>::from_fn(|k, _| a[k * r + c]);
    let to = SVector::<f64, D>::from_fn(|k, _| b[k * r + c]);
    (to - edge.rotation.tr_mul(&from), b[D * r + c] - a[D * r + c] - edge.translation.dot(&from))
}

/// `v -= m · x` on the first `D` rows.
#[inline(always)]
fn subtract<const D: usize>(m: &SMatrix<f64, D, D>, x: &[f64], v: &mut [f64], r: usize) {
    for a in 0..D {
        for b in 0..D {
            let factor = m[(a, b)];
            for c in 0..r {
                v[a * r + c] -= factor * x[b * r + c];
            }
        }
    }
}

#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

use draco_lie::LieGroup;
use nalgebra::{DMatrix, DVector};

use crate::{CustomFactor, Key};

/// What is left of a diagonal entry, relative to it, that counts as nothing: a direction the cost does not depend on,
/// such as where relative measurements lie together.
const NOTHING: f64 = 1e-10;

/// A quadratic cost `½ δᵀ H δ + gᵀ δ` of the right perturbations `δ` of a few poses from where they were, as a
/// factor: `½ |W δ + c|²` with `WᵀW = H` and `Wᵀc = g`.
#[derive(Debug, Clone)]
pub(crate) struct Quadratic<G> {
    keys: Vec<Key>,
    reference: Vec<G>,
    /// As many rows as `H` has rank.
    whitening: DMatrix<f64>,
    offset: DVector<f64>,
}

impl<G> Quadratic<G> {
    /// The factor of `poses`; `None` when the cost depends on none of them.
    ///
    /// `information` is positive semidefinite up to rounding; what `gradient` says about directions it knows
    /// nothing of is left out.
    pub(crate) fn new(poses: &[(Key, G)], information: &DMatrix<f64>, gradient: &DVector<f64>) -> Option<Self>
    where
        G: Copy,
    {
        let (whitening, pivots) = root(information);
        let mut offset = DVector::zeros(pivots.len());
        for (k, pivot) in pivots.iter().enumerate() {
            let known: f64 = (0..k).map(|j| whitening[(j, *pivot)] * offset[j]).sum();
            offset[k] = (gradient[*pivot] - known) / whitening[(k, *pivot)];
        }
        let (keys, reference) = poses.iter().copied().unzip();
        (!pivots.is_empty()).then_some(Self { keys, reference, whitening, offset })
    }
}

/// `W` with `WᵀW` the matrix, by Cholesky with diagonal pivots that stops at its rank, and the pivots: row `k` of
/// `W` is zero at the pivots before the `k`-th.
fn root(matrix: &DMatrix<f64>) -> (DMatrix<f64>, Vec<usize>) {
    let n = matrix.nrows();
    let mut rest = matrix.clone();
    let mut whitening = DMatrix::zeros(n, n);
    let mut open: Vec<usize> = (0..n).collect();
    let mut pivots = Vec::with_capacity(n);
    let left = |rest: &DMatrix<f64>, i: usize| {
        if matrix[(i, i)] > 0.0 { rest[(i, i)] / matrix[(i, i)] } else { 0.0 }
    };
    while let Some((at, share)) = open
        .iter()
        .map(|i| left(&rest, *i))
        .enumerate()
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
    {
        if share <= NOTHING {
            break;
        }
        let pivot = open.remove(at);
        let k = pivots.len();
        let scale = rest[(pivot, pivot)].sqrt();
        whitening[(k, pivot)] = scale;
        for i in &open {
            whitening[(k, *i)] = rest[(*i, pivot)] / scale;
        }
        for c in &open {
            for r in &open {
                rest[(*r, *c)] -= whitening[(k, *r)] * whitening[(k, *c)];
            }
        }
        pivots.push(pivot);
    }
    (whitening.rows(0, pivots.len()).into_owned(), pivots)
}

impl<const N: usize, G: LieGroup<N>> CustomFactor<G, N> for Quadratic<G> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        self.offset.len()
    }

    fn anchors(&self) -> bool {
        self.whitening.nrows() == self.whitening.ncols()
    }

    fn residual(&self, poses: &[G], residual: &mut [f64]) {
        residual.copy_from_slice(self.offset.as_slice());
        for (i, (reference, pose)) in self.reference.iter().zip(poses).enumerate() {
            let moved = reference.between(pose).log();
            for (row, sum) in residual.iter_mut().enumerate() {
                *sum += (0..N).map(|c| self.whitening[(row, i * N + c)] * moved[c]).sum::<f64>();
            }
        }
    }

    fn jacobian(&self, poses: &[G], which: usize, jacobian: &mut [f64]) {
        let by_pose = G::right_jacobian_inverse(&self.reference[which].between(&poses[which]).log());
        for (row, entries) in jacobian.chunks_exact_mut(N).enumerate() {
            for (c, entry) in entries.iter_mut().enumerate() {
                *entry = (0..N).map(|k| self.whitening[(row, which * N + k)] * by_pose[(k, c)]).sum();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry2, Vector2, Vector3};

    #[test]
    fn the_cost_is_the_quadratic_up_to_a_constant() {
        // depends on the difference of the two poses only, so half of the directions are free
        let block = nalgebra::Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 1e6);
        let mut information = DMatrix::zeros(6, 6);
        for (r, c, sign) in [(0, 0, 1.0), (0, 3, -1.0), (3, 0, -1.0), (3, 3, 1.0)] {
            information.view_mut((r, c), (3, 3)).copy_from(&(block * sign));
        }
        let half = block * Vector3::new(0.3, -0.1, 0.2);
        let gradient = DVector::from_iterator(6, half.iter().chain((-half).iter()).copied());
        let at = |x: f64| Isometry2::new(Vector2::new(x, 2.0 * x), 0.3 * x);
        let poses = [(Key::new(0, 0), at(1.0)), (Key::new(0, 1), at(2.0))];
        let factor = Quadratic::new(&poses, &information, &gradient).unwrap();
        let cost = |delta: &DVector<f64>| {
            let step = |i: usize| Vector3::new(delta[i], delta[i + 1], delta[i + 2]);
            let moved = [poses[0].1.plus(&step(0)), poses[1].1.plus(&step(3))];
            let mut residual = vec![0.0; CustomFactor::<Isometry2<f64>, 3>::dimension(&factor)];
            factor.residual(&moved, &mut residual);
            0.5 * residual.iter().map(|r| r * r).sum::<f64>()
        };
        assert_eq!(factor.offset.len(), 3);
        assert!(!CustomFactor::<Isometry2<f64>, 3>::anchors(&factor));
        let still = cost(&DVector::zeros(6));
        for k in 0..8 {
            let delta = DVector::from_fn(6, |i, _| 1e-2 * ((7 * i + 3 * k) as f64).sin());
            let expected = 0.5 * delta.dot(&(&information * &delta)) + gradient.dot(&delta);
            assert!((cost(&delta) - still - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{k}");
        }
    }

    #[test]
    fn a_cost_of_nothing_is_no_factor() {
        let poses = [(Key::new(0, 0), Isometry2::<f64>::identity())];
        assert!(Quadratic::new(&poses, &DMatrix::zeros(3, 3), &DVector::zeros(3)).is_none());
    }
}

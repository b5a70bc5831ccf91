use draco_lie::LieGroup;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::{CustomFactor, Error, FactorModel, Gauge, Key, Marginals, PoseGraph};

/// What a graph knows about a few of its poses relative to each other, with all other poses integrated out.
///
/// It holds nothing about where the poses lie together, so it does not depend on the gauge of its graph, and a
/// receiver that adds it to a graph once counts nothing twice.
#[derive(Debug, Clone, PartialEq)]
pub struct Condensed<G> {
    /// The poses, each in the frame of the sender's map; the first is the one the others are relative to.
    pub poses: Vec<(Key, G)>,
    /// Information of the stacked `log(z_i⁻¹ x_0⁻¹ x_i)`, `i = 1..`, order translation then rotation within each.
    pub information: DMatrix<f64>,
}

impl<G> Condensed<G> {
    /// Condenses `graph`, at its present poses, onto `keys`; the first of them becomes the reference.
    ///
    /// # Errors
    /// [`Error::EmptyGraph`] without keys, [`Error::UnknownKey`], [`Error::Indefinite`].
    pub fn new<const N: usize>(graph: &PoseGraph<G, N>, keys: &[Key]) -> Result<Self, Error>
    where
        G: LieGroup<N>,
    {
        let reference = *keys.first().ok_or(Error::EmptyGraph)?;
        let joint = Marginals::new(graph, Gauge::HoldFirst)?.joint_of(keys)?;
        let poses = keys
            .iter()
            .map(|key| graph.pose(*key).map(|pose| (*key, *pose)).ok_or(Error::UnknownKey { key: *key }))
            .collect::<Result<Vec<_>, _>>()?;
        // δ(x_0⁻¹ x_i) = δ_i - Ad(x_i⁻¹ x_0) δ_0
        let others = keys.len() - 1;
        let mut map = DMatrix::zeros(others * N, keys.len() * N);
        for i in 0..others {
            let adjoint = poses[i + 1].1.between(&poses[0].1).adjoint();
            map.view_mut((i * N, 0), (N, N)).copy_from(&-adjoint);
            map.view_mut((i * N, (i + 1) * N), (N, N)).fill_with_identity();
        }
        let covariance = &map * joint * map.transpose();
        let inverse = (&covariance + covariance.transpose()).scale(0.5).cholesky().map(|c| c.inverse());
        let information = inverse.ok_or(Error::Indefinite { key: reference })?;
        Ok(Self { poses, information })
    }

    /// Size on the wire in bytes: 8 a key and 8 a number, poses as tangent vectors, the information's upper
    /// triangle.
    pub fn bytes<const N: usize>(&self) -> usize
    where
        G: LieGroup<N>,
    {
        let side = self.information.nrows();
        self.poses.len() * 8 * (1 + N) + side * (side + 1) / 2 * 8
    }
}

/// A [`Condensed`] as a factor.
#[derive(Debug, Clone)]
pub struct CondensedFactor<G> {
    keys: Vec<Key>,
    /// `z_i = x_0⁻¹ x_i`, `i = 1..`.
    relative: Vec<G>,
    /// `W` with `WᵀW` the information.
    whitening: DMatrix<f64>,
    information: DMatrix<f64>,
}

impl<G> CondensedFactor<G> {
    /// The factor of a condensed graph.
    ///
    /// # Errors
    /// [`Error::Information`] when the information is not positive definite or of the wrong size,
    /// [`Error::EmptyGraph`] with fewer than two poses.
    pub fn new<const N: usize>(condensed: &Condensed<G>) -> Result<Self, Error>
    where
        G: LieGroup<N>,
    {
        let [(key, reference), others @ ..] = condensed.poses.as_slice() else {
            return Err(Error::EmptyGraph);
        };
        if others.is_empty() {
            return Err(Error::EmptyGraph);
        }
        let side = others.len() * N;
        let mut information = condensed.information.clone();
        if information.is_square() {
            information.fill_upper_triangle_with_lower_triangle();
        }
        let whitening = (condensed.information.shape() == (side, side))
            .then(|| condensed.information.clone().cholesky())
            .flatten()
            .map(|c| c.l().transpose())
            .ok_or(Error::Information { key: *key })?;
        Ok(Self {
            keys: condensed.poses.iter().map(|(key, _)| *key).collect(),
            relative: others.iter().map(|(_, pose)| reference.between(pose)).collect(),
            whitening,
            information,
        })
    }
}

impl<const N: usize, G: LieGroup<N>> CustomFactor<G, N> for CondensedFactor<G> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        self.relative.len() * N
    }

    fn residual(&self, poses: &[G], residual: &mut [f64]) {
        residual.fill(0.0);
        for (i, z) in self.relative.iter().enumerate() {
            let e = z.between(&poses[0].between(&poses[i + 1])).log();
            self.add_whitened(i, &e, |row, value| residual[row] += value);
        }
    }

    fn jacobian(&self, poses: &[G], which: usize, jacobian: &mut [f64]) {
        jacobian.fill(0.0);
        for (i, z) in self.relative.iter().enumerate() {
            if which != 0 && which != i + 1 {
                continue;
            }
            let e = z.between(&poses[0].between(&poses[i + 1])).log();
            let by_other = G::right_jacobian_inverse(&e);
            let block: SMatrix<f64, N, N> =
                if which == 0 { -by_other * poses[i + 1].between(&poses[0]).adjoint() } else { by_other };
            for c in 0..N {
                let column: SVector<f64, N> = block.column(c).into_owned();
                self.add_whitened(i, &column, |row, value| jacobian[row * N + c] += value);
            }
        }
    }

    /// By blocks: entry `i` of the stacked errors depends on the reference and on one other pose alone, so that the
    /// information has to be gone through once and not once a column.
    fn add_model(&self, poses: &[G], model: &mut FactorModel<N>) -> bool {
        let others = self.relative.len();
        let mut errors = DVector::zeros(others * N);
        let mut by_other: Vec<SMatrix<f64, N, N>> = Vec::with_capacity(others);
        let mut by_reference: Vec<SMatrix<f64, N, N>> = Vec::with_capacity(others);
        for (i, z) in self.relative.iter().enumerate() {
            let e = z.between(&poses[0].between(&poses[i + 1])).log();
            let j = G::right_jacobian_inverse(&e);
            errors.fixed_rows_mut::<N>(i * N).copy_from(&e);
            by_reference.push(-j * poses[i + 1].between(&poses[0]).adjoint());
            by_other.push(j);
        }
        let weighed = &self.information * &errors;
        for j in 0..others {
            let (dj, aj) = (&by_other[j], &by_reference[j]);
            let gradient: SVector<f64, N> = weighed.fixed_rows::<N>(j * N).into_owned();
            *model.gradient_mut(0) += aj.tr_mul(&gradient);
            *model.gradient_mut(j + 1) += dj.tr_mul(&gradient);
            // Σ_i A_iᵀ Λ_ij
            let mut joint: SMatrix<f64, N, N> = SMatrix::zeros();
            for i in 0..others {
                let information = self.information.fixed_view::<N, N>(i * N, j * N);
                joint += by_reference[i].tr_mul(&information);
                if i <= j {
                    *model.hessian_mut(i + 1, j + 1) += by_other[i].tr_mul(&information) * dj;
                }
            }
            *model.hessian_mut(0, j + 1) += joint * dj;
            *model.hessian_mut(0, 0) += joint * aj;
        }
        true
    }
}

impl<G> CondensedFactor<G> {
    /// Adds `W · x` for an `x` that is zero outside block `i`.
    fn add_whitened<const N: usize>(&self, i: usize, x: &SVector<f64, N>, mut add: impl FnMut(usize, f64)) {
        for row in 0..self.whitening.nrows() {
            add(row, (0..N).map(|c| self.whitening[(row, i * N + c)] * x[c]).sum());
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry2, Vector2};

    use super::*;

    #[test]
    fn the_model_by_blocks_is_that_of_the_jacobians() {
        let pose = |k: usize, bend: f64| {
            let k = k as f64;
            Isometry2::new(Vector2::new(3.0 * k, bend * k * k), 0.1 * k - bend * k)
        };
        let (count, side) = (5, 12);
        let root = DMatrix::from_fn(side, side, |r, c| ((7 * r + 3 * c) % 11) as f64 / 11.0);
        let information = &root * root.transpose() + DMatrix::identity(side, side);
        let key = |k: usize| Key::new(1, k as u64);
        let poses: Vec<_> = (0..count).map(|k| (key(k), pose(k, 0.0))).collect();
        let factor = CondensedFactor::new::<3>(&Condensed { poses, information }).expect("positive definite");
        let at: Vec<Isometry2<f64>> = (0..count).map(|k| pose(k, 0.05)).collect();
        let mut model = FactorModel::<3>::zeros(count);
        assert!(factor.add_model(&at, &mut model));

        let mut residual = DVector::zeros(side);
        factor.residual(&at, residual.as_mut_slice());
        let jacobians: Vec<DMatrix<f64>> = (0..count)
            .map(|which| {
                let mut rows = vec![0.0; side * 3];
                CustomFactor::<_, 3>::jacobian(&factor, &at, which, &mut rows);
                DMatrix::from_row_slice(side, 3, &rows)
            })
            .collect();
        for i in 0..count {
            let gradient = jacobians[i].tr_mul(&residual);
            assert!((gradient - *model.gradient_mut(i)).norm() < 1e-9);
            for j in i..count {
                let block = jacobians[i].tr_mul(&jacobians[j]);
                assert!((block - *model.hessian_mut(i, j)).norm() < 1e-9, "{i}, {j}");
            }
        }
    }
}

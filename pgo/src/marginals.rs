use draco_lie::LieGroup;
use nalgebra::{DMatrix, SMatrix, SVector};

use crate::problem::{HELD, Problem};
use crate::sparse::{Cholesky, SelectedInverse};
use crate::{Error, Gauge, Key, PoseGraph};

/// Covariance of two poses together, each in its own body frame, order translation then rotation.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCovariance<const N: usize> {
    /// Covariance of the first pose.
    pub first: SMatrix<f64, N, N>,
    /// Covariance of the second pose.
    pub second: SMatrix<f64, N, N>,
    /// Cross-covariance `E[δ_first δ_secondᵀ]`.
    pub cross: SMatrix<f64, N, N>,
}

/// Covariances of the poses of a graph at their present values.
///
/// They are blocks of the inverse Gauss-Newton Hessian: of the right perturbation of each pose, in its own body
/// frame, order translation then rotation, metres and radians. Poses that do not move have zero covariance.
#[derive(Debug, Clone)]
pub struct Marginals<G, const N: usize> {
    slots: std::collections::BTreeMap<Key, u32>,
    poses: Vec<G>,
    columns: Vec<u32>,
    cholesky: Cholesky<N>,
}

impl<const N: usize, G: LieGroup<N>> Marginals<G, N> {
    /// Factors the Hessian of `graph` at its present poses: call it on the optimised graph.
    ///
    /// # Errors
    /// [`Error::EmptyGraph`], [`Error::NoGauge`] (with [`Gauge::Require`]), [`Error::Indefinite`].
    pub fn new(graph: &PoseGraph<G, N>, gauge: Gauge) -> Result<Self, Error> {
        let held = graph.gauge_keys(gauge)?;
        let mut problem = Problem::new(graph, &held)?;
        problem.linearise(&graph.poses);
        let mut cholesky = problem.cholesky();
        cholesky
            .factor(&problem.hessian, None)
            .map_err(|c| Error::Indefinite { key: graph.keys[problem.slots[c] as usize] })?;
        Ok(Self {
            slots: graph.slots.clone(),
            poses: graph.poses.clone(),
            columns: problem.columns,
            cholesky,
        })
    }

    /// Covariance of one pose.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn covariance(&self, key: Key) -> Result<SMatrix<f64, N, N>, Error> {
        let column = self.column(key)?;
        Ok(self.block(&self.inverse_columns(column), column))
    }

    /// Covariance of every pose, ascending by key, by selective inversion: about the cost of two factorisations
    /// however many poses there are.
    pub fn all(&self) -> Vec<(Key, SMatrix<f64, N, N>)> {
        let inverse = SelectedInverse::new(&self.cholesky);
        let block = |slot: u32| match self.columns[slot as usize] {
            HELD => SMatrix::zeros(),
            c => inverse.block(self.cholesky.symbolic(), c, c).unwrap_or_else(SMatrix::zeros),
        };
        self.slots.iter().map(|(key, slot)| (*key, block(*slot))).collect()
    }

    /// Covariance of two poses together.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn joint(&self, first: Key, second: Key) -> Result<JointCovariance<N>, Error> {
        let (a, b) = (self.column(first)?, self.column(second)?);
        let (of_a, of_b) = (self.inverse_columns(a), self.inverse_columns(b));
        Ok(JointCovariance {
            first: self.block(&of_a, a),
            second: self.block(&of_b, b),
            cross: self.block(&of_b, a),
        })
    }

    /// Joint covariance of several poses, `N × N` blocks in the order of `keys`.
    ///
    /// Costs `N` solves a pose, however many pairs there are.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn joint_of(&self, keys: &[Key]) -> Result<DMatrix<f64>, Error> {
        let columns = keys.iter().map(|key| self.column(*key)).collect::<Result<Vec<u32>, _>>()?;
        let mut joint = DMatrix::zeros(keys.len() * N, keys.len() * N);
        for (c, column) in columns.iter().enumerate() {
            let inverse = self.inverse_columns(*column);
            for (r, row) in columns.iter().enumerate() {
                joint.view_mut((r * N, c * N), (N, N)).copy_from(&self.block(&inverse, *row));
            }
        }
        Ok(joint)
    }

    /// Covariance of the relative pose `first⁻¹ second`, in the body frame of `second`.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn relative(&self, first: Key, second: Key) -> Result<SMatrix<f64, N, N>, Error> {
        let joint = self.joint(first, second)?;
        let [a, b] = [first, second].map(|key| self.slots.get(&key).map(|slot| &self.poses[*slot as usize]));
        let adjoint = a.zip(b).map_or_else(SMatrix::identity, |(a, b)| b.between(a).adjoint());
        let mixed = adjoint * joint.cross;
        Ok(adjoint * joint.first * adjoint.transpose() + joint.second - mixed - mixed.transpose())
    }

    fn column(&self, key: Key) -> Result<u32, Error> {
        self.slots.get(&key).map(|slot| self.columns[*slot as usize]).ok_or(Error::UnknownKey { key })
    }

    /// The `N` columns of the inverse Hessian that belong to one block column.
    fn inverse_columns(&self, column: u32) -> Vec<Vec<SVector<f64, N>>> {
        if column == HELD {
            return Vec::new();
        }
        let mut work = vec![0.0; self.cholesky.work_length()];
        (0..N)
            .map(|c| {
                let mut x = vec![SVector::zeros(); self.cholesky.symbolic().columns()];
                x[column as usize][c] = 1.0;
                self.cholesky.solve_with(&mut work, &mut x);
                x
            })
            .collect()
    }

    fn block(&self, columns: &[Vec<SVector<f64, N>>], row: u32) -> SMatrix<f64, N, N> {
        let mut block = SMatrix::<f64, N, N>::zeros();
        if row != HELD {
            for (c, column) in columns.iter().enumerate() {
                block.set_column(c, &column[row as usize]);
            }
        }
        block
    }
}

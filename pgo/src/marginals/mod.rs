use draco_lie::LieGroup;
use nalgebra::{DMatrix, SMatrix};

use crate::pattern::HELD;
use crate::problem::Problem;
use crate::sparse::{Cholesky, SelectedInverse};
use crate::{Error, Gauge, Key, PoseGraph};

mod path;

pub(crate) use path::{PathColumns, PathWork};

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
        let mut cholesky = problem.cholesky(&graph.elimination);
        cholesky
            .factor(&problem.hessian, None)
            .map_err(|c| Error::Indefinite { key: graph.keys[problem.pattern.slots[c] as usize] })?;
        Ok(Self {
            slots: graph.slots.clone(),
            poses: graph.poses.clone(),
            columns: problem.pattern.columns,
            cholesky,
        })
    }

    /// Covariance of one pose.
    ///
    /// Costs a forward substitution along one path of the elimination tree.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn covariance(&self, key: Key) -> Result<SMatrix<f64, N, N>, Error> {
        let column = self.columns_of(&[key])?;
        Ok(block(&column[0], &column[0]))
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
        let columns = self.columns_of(&[first, second])?;
        Ok(JointCovariance {
            first: block(&columns[0], &columns[0]),
            second: block(&columns[1], &columns[1]),
            cross: block(&columns[0], &columns[1]),
        })
    }

    /// Joint covariance of several poses, `N × N` blocks in the order of `keys`.
    ///
    /// Costs a forward substitution along one path of the elimination tree for each pose, and a product over the
    /// common part of two paths for each pair.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn joint_of(&self, keys: &[Key]) -> Result<DMatrix<f64>, Error> {
        let columns = self.columns_of(keys)?;
        let mut joint = DMatrix::zeros(keys.len() * N, keys.len() * N);
        for (c, column) in columns.iter().enumerate() {
            for (r, row) in columns[..=c].iter().enumerate() {
                let covariance = block(row, column);
                joint.view_mut((r * N, c * N), (N, N)).copy_from(&covariance);
                joint.view_mut((c * N, r * N), (N, N)).copy_from(&covariance.transpose());
            }
        }
        Ok(joint)
    }

    /// Covariance of the relative pose `first⁻¹ second`, in the body frame of `second`.
    ///
    /// Computed as a Gram matrix, so it is positive semidefinite also where the two poses share almost all of a
    /// large uncertainty.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn relative(&self, first: Key, second: Key) -> Result<SMatrix<f64, N, N>, Error> {
        let columns = self.columns_of(&[first, second])?;
        let [a, b] = [first, second].map(|key| self.slots.get(&key).map(|slot| &self.poses[*slot as usize]));
        // δ(a⁻¹ b) = δ_b - Ad(b⁻¹ a) δ_a
        let adjoint = a.zip(b).map_or_else(SMatrix::identity, |(a, b)| b.between(a).adjoint());
        Ok(match (&columns[0], &columns[1]) {
            (Some(a), Some(b)) => {
                let difference = b.minus(a, &adjoint);
                difference.product(&difference)
            }
            (Some(a), None) => adjoint * a.product(a) * adjoint.transpose(),
            (None, b) => block(b, b),
        })
    }

    /// The columns `L⁻¹ E` of each pose; `None` for those that do not move.
    fn columns_of(&self, keys: &[Key]) -> Result<Vec<Option<PathColumns<N>>>, Error> {
        let mut work = PathWork::new(&self.cholesky);
        keys.iter()
            .map(|key| {
                let slot = self.slots.get(key).ok_or(Error::UnknownKey { key: *key })?;
                Ok(match self.columns[*slot as usize] {
                    HELD => None,
                    column => Some(PathColumns::new(&self.cholesky, &mut work, column)),
                })
            })
            .collect()
    }
}

/// A block of the covariance; zero where either pose does not move.
fn block<const N: usize>(
    row: &Option<PathColumns<N>>,
    column: &Option<PathColumns<N>>,
) -> SMatrix<f64, N, N> {
    row.as_ref().zip(column.as_ref()).map_or_else(SMatrix::zeros, |(a, b)| a.product(b))
}

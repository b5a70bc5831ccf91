use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use crate::{Kernel, Key};

/// The name of a factor within its graph: stable until the factor is removed, never used again after.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FactorId(pub usize);

/// A user-defined factor over any number of poses.
///
/// Its cost is `½ ρ(|r|²)`: the residual is whitened already. `N` is the tangent dimension of `G`.
pub trait CustomFactor<G, const N: usize>: Debug + Send + Sync {
    /// The poses the residual depends on, in the order in which the other methods take them.
    fn keys(&self) -> &[Key];

    /// Length of the residual.
    fn dimension(&self) -> usize;

    /// Writes the whitened residual at `poses` into `residual`.
    fn residual(&self, poses: &[G], residual: &mut [f64]);

    /// Writes the derivative of the residual by the right perturbation of pose `which` (tangent order
    /// translation, then rotation), row-major, `dimension × N`.
    fn jacobian(&self, poses: &[G], which: usize, jacobian: &mut [f64]);

    /// Adds the Gauss-Newton model of `½|r|²` at `poses`, if the factor knows a shorter way to it than through its
    /// Jacobians, and returns whether it does; if not, it leaves `model` as it is. The cost is still that of
    /// [`CustomFactor::residual`]. Default: no.
    fn add_model(&self, poses: &[G], model: &mut FactorModel<N>) -> bool {
        let _ = (poses, model);
        false
    }

    /// Whether the factor holds its poses in place by itself, as a prior does, so that their part of the graph needs
    /// no other gauge. Default: no.
    fn anchors(&self) -> bool {
        false
    }
}

/// Gradient and Hessian of a factor in the poses it depends on.
#[derive(Debug, Clone)]
pub struct FactorModel<const N: usize> {
    /// By pose, tangent order translation then rotation.
    pub(crate) gradient: Vec<SVector<f64, N>>,
    /// Blocks `(i, j)`, `i <= j`, in lexicographic order.
    pub(crate) hessian: Vec<SMatrix<f64, N, N>>,
}

impl<const N: usize> FactorModel<N> {
    /// The model that is zero, of a factor on `poses` poses.
    pub fn zeros(poses: usize) -> Self {
        FactorModel {
            gradient: vec![SVector::zeros(); poses],
            hessian: vec![SMatrix::zeros(); poses * (poses + 1) / 2],
        }
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        self.gradient.len()
    }

    /// The gradient by pose `i`.
    ///
    /// # Panics
    /// When there is no such pose.
    pub fn gradient_mut(&mut self, i: usize) -> &mut SVector<f64, N> {
        &mut self.gradient[i]
    }

    /// The block of the Hessian by poses `i` (rows) and `j` (columns), `i <= j`.
    ///
    /// # Panics
    /// When there are no such poses, or `i > j`.
    pub fn hessian_mut(&mut self, i: usize, j: usize) -> &mut SMatrix<f64, N, N> {
        assert!(i <= j && j < self.poses(), "block ({i}, {j}) of {} poses", self.poses());
        &mut self.hessian[i * (2 * self.gradient.len() - i + 1) / 2 + (j - i)]
    }

    pub(crate) fn clear(&mut self) {
        self.gradient.fill(SVector::zeros());
        self.hessian.fill(SMatrix::zeros());
    }
}

/// What a factor measures.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Measurement<G, const N: usize> {
    /// The pose itself, with residual `log(z⁻¹ x)`.
    Prior {
        /// The measured pose.
        key: Key,
        /// The measured value `z`.
        measured: G,
    },
    /// A relative pose, with residual `log(z⁻¹ · from⁻¹ · to)`.
    Between {
        /// The pose measured from.
        from: Key,
        /// The pose measured.
        to: Key,
        /// `z = from_from_to`, the pose of `to` seen from `from`.
        measured: G,
    },
    /// Anything else.
    Custom(Arc<dyn CustomFactor<G, N>>),
}

/// One term of the cost of a graph.
#[derive(Debug, Clone)]
pub struct Factor<G, const N: usize> {
    /// What is measured.
    pub measurement: Measurement<G, N>,
    /// Information matrix of the residual, order translation then rotation; not used by custom factors, whose
    /// residual is whitened.
    pub information: SMatrix<f64, N, N>,
    /// Robust kernel.
    pub kernel: Kernel,
}

impl<G, const N: usize> Factor<G, N> {
    /// The poses the factor joins.
    pub fn keys(&self) -> Vec<Key> {
        match &self.measurement {
            Measurement::Prior { key, .. } => vec![*key],
            Measurement::Between { from, to, .. } => vec![*from, *to],
            Measurement::Custom(custom) => custom.keys().to_vec(),
        }
    }

    /// Whether the factor alone holds its poses in place.
    pub(crate) fn anchors(&self) -> bool {
        match &self.measurement {
            Measurement::Prior { .. } => true,
            Measurement::Between { .. } => false,
            Measurement::Custom(custom) => custom.anchors(),
        }
    }
}

use std::fmt::Debug;

use nalgebra::{SMatrix, SVector};

use crate::Error;

/// A matrix Lie group of dimension `N` whose elements are poses or rotations.
///
/// Tangent vectors have order **translation, rotation** (`[ρ, θ]` in SE(2), `[ρ, φ]` in SE(3)), metres and
/// radians; perturbations act on the **right**.
pub trait LieGroup<const N: usize>: Copy + PartialEq + Debug + Send + Sync + 'static {
    /// The matrices that represent the elements: rotation matrices of SO, homogeneous ones of SE.
    type Matrix;

    /// The neutral element.
    fn identity() -> Self;

    /// The product `self · other`.
    fn compose(&self, other: &Self) -> Self;

    /// The inverse element.
    fn inverse(&self) -> Self;

    /// The exponential map from the tangent space at the identity.
    fn exp(xi: &SVector<f64, N>) -> Self;

    /// The logarithm, with a rotation angle in [-π, π] (SE(2)) or [0, π] (SE(3)).
    fn log(&self) -> SVector<f64, N>;

    /// The matrix of a tangent vector: `hat(ξ)` with `exp(ξ).to_matrix()` its matrix exponential.
    fn hat(xi: &SVector<f64, N>) -> Self::Matrix;

    /// The tangent vector of such a matrix, the inverse of [`LieGroup::hat`].
    ///
    /// # Errors
    /// [`Error::NotFinite`]; [`Error::NotHat`] when the matrix is not the hat of any tangent (to 1e-6 of its
    /// largest entry).
    fn vee(matrix: &Self::Matrix) -> Result<SVector<f64, N>, Error>;

    /// The rotation matrix (SO) or homogeneous matrix (SE) of the element.
    fn to_matrix(&self) -> Self::Matrix;

    /// The element of a rotation matrix (SO) or homogeneous matrix (SE); its rotation is the nearest one in the
    /// Frobenius norm, so rounded entries are averaged, also at a half turn.
    ///
    /// # Errors
    /// [`Error::NotFinite`]; [`Error::NotRotation`] when it is off by more than 1e-6 in any entry.
    fn try_from_matrix(matrix: &Self::Matrix) -> Result<Self, Error>;

    /// The adjoint `Ad` with `T exp(ξ) T⁻¹ = exp(Ad ξ)`.
    fn adjoint(&self) -> SMatrix<f64, N, N>;

    /// The small adjoint `ad(ξ)`, the matrix of the Lie bracket `[ξ, ·]`.
    fn small_adjoint(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The left Jacobian: `exp(ξ + δ) ≈ exp(J_l δ) exp(ξ)`.
    fn left_jacobian(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The inverse of [`LieGroup::left_jacobian`].
    fn left_jacobian_inverse(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The right Jacobian: `exp(ξ + δ) ≈ exp(ξ) exp(J_r δ)`.
    fn right_jacobian(xi: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        Self::left_jacobian(&-xi)
    }

    /// The inverse of [`LieGroup::right_jacobian`].
    fn right_jacobian_inverse(xi: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        Self::left_jacobian_inverse(&-xi)
    }

    /// The same element with its rotation brought back to unit norm.
    fn renormalize(&self) -> Self;

    /// `Ok` iff the element is finite and its rotation has unit norm (to 1e-9).
    ///
    /// # Errors
    /// [`Error::NotFinite`] or [`Error::NotUnit`].
    fn check(&self) -> Result<(), Error>;

    /// The relative element `self⁻¹ · other`.
    fn between(&self, other: &Self) -> Self {
        self.inverse().compose(other)
    }

    /// `self · exp(ξ)`.
    fn plus(&self, xi: &SVector<f64, N>) -> Self {
        self.compose(&Self::exp(xi))
    }

    /// `log(other⁻¹ · self)`, so that `other.plus(&self.minus(&other)) = self`.
    fn minus(&self, other: &Self) -> SVector<f64, N> {
        other.between(self).log()
    }
}

use std::fmt::Debug;

use nalgebra::{SMatrix, SVector};

use crate::Error;
use crate::check::check_finite;

/// A value and its Jacobian by the one argument.
///
/// The Jacobian is by the perturbation of the argument: a pose is perturbed on the right, `T · exp(δ)`, a
/// tangent vector by addition; a pose as value moves by its own right perturbation. `N × N`, order translation
/// then rotation in rows and columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearized<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its Jacobian.
    pub jacobian: SMatrix<f64, N, N>,
}

/// A value and its Jacobians by both arguments, in the sense of [`Linearized`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearizedPair<T, const N: usize> {
    /// The value.
    pub value: T,
    /// The Jacobian by the first argument (`self` of a method).
    pub first: SMatrix<f64, N, N>,
    /// The Jacobian by the second argument.
    pub second: SMatrix<f64, N, N>,
}

/// A matrix Lie group of dimension `N` whose elements are poses or rotations.
///
/// | element | `N` | tangent order | [`LieGroup::Matrix`] |
/// |---|---|---|---|
/// | `UnitComplex<f64>`, SO(2) | 1 | `[θ]` | 2 × 2 rotation |
/// | `Isometry2<f64>`, SE(2) | 3 | `[x, y, θ]` | 3 × 3 homogeneous |
/// | `UnitQuaternion<f64>`, SO(3) | 3 | `[φx, φy, φz]` | 3 × 3 rotation |
/// | `Isometry3<f64>`, SE(3) | 6 | `[ρx, ρy, ρz, φx, φy, φz]` | 4 × 4 homogeneous |
///
/// Tangent vectors have order **translation, rotation**, metres and radians; perturbations act on the **right**,
/// `T ⊞ ξ = T · exp(ξ)`, so they are in the frame of the pose's own body. `Jr`, `Jl` are the right and left
/// Jacobians, `Ad` the adjoint.
///
/// The plain maps are for numbers already checked: NaN in gives NaN out. Input from outside goes through
/// [`LieGroup::try_exp`], [`LieGroup::try_log`] or [`LieGroup::check`]. All maps and Jacobians are good to 1e-15
/// of their largest entry at every angle, also at zero, at π and near 2π, for `|θ| < 1e150`.
///
/// Where nalgebra has an inherent method of the same name (`inverse`), both do the same.
///
/// **Source** J. Solà, J. Deray, D. Atchuthan, *A micro Lie theory for state estimation in robotics*, 2018, for
/// definitions and signs; T. Barfoot, *State Estimation for Robotics*, 2017, ch. 7. The stable forms are our own:
/// SE(3) as SO(3) over the dual numbers, and the partial fractions of the cotangent.
pub trait LieGroup<const N: usize>: Copy + PartialEq + Debug + Send + Sync + 'static {
    /// The matrices that represent the elements: rotation matrices of SO, homogeneous ones of SE.
    type Matrix;

    /// The neutral element.
    fn identity() -> Self;

    /// The product `self · other`, for `a_from_b · b_from_c = a_from_c`.
    ///
    /// The rotation is brought back to unit norm when it starts to drift, so long chains need no care.
    fn compose(&self, other: &Self) -> Self;

    /// The inverse element, `b_from_a` of `a_from_b`.
    fn inverse(&self) -> Self;

    /// The exponential map from the tangent space at the identity.
    fn exp(xi: &SVector<f64, N>) -> Self;

    /// The logarithm, with a rotation angle in [-π, π] (2-D) or [0, π] (3-D).
    ///
    /// At a half turn in 3-D both axes are right; the one of the stored quaternion is taken.
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

    /// The adjoint `Ad` with `T exp(ξ) T⁻¹ = exp(Ad ξ)`: takes a twist in the body frame to the world frame.
    ///
    /// SE(2): `[[R, (y, -x)ᵀ], [0, 1]]`; SE(3): `[[R, [t]× R], [0, R]]`; SO: `R` or 1.
    fn adjoint(&self) -> SMatrix<f64, N, N>;

    /// The small adjoint `ad(ξ)`, the matrix of the Lie bracket `[ξ, ·]`; `Ad(exp ξ)` is its matrix exponential.
    fn small_adjoint(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The left Jacobian `Σ ad(ξ)ᵏ / (k+1)!`: `exp(ξ + δ) ≈ exp(Jl δ) exp(ξ)`.
    ///
    /// SE(3): `[[J, Q], [0, J]]` with `J` of SO(3).
    fn left_jacobian(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The inverse of [`LieGroup::left_jacobian`]; it grows without bound towards `|θ| = 2π`, where the Jacobian
    /// is singular.
    fn left_jacobian_inverse(xi: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// The right Jacobian: `exp(ξ + δ) ≈ exp(ξ) exp(Jr δ)`. It is `Jl(-ξ)`.
    #[inline]
    fn right_jacobian(xi: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        Self::left_jacobian(&-xi)
    }

    /// The inverse of [`LieGroup::right_jacobian`].
    #[inline]
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

    /// [`LieGroup::exp`] of a tangent vector from outside.
    ///
    /// # Errors
    /// [`Error::NotFinite`] with the first entry of the tangent that is NaN or infinite, or for a result that
    /// overflows.
    fn try_exp(xi: &SVector<f64, N>) -> Result<Self, Error> {
        check_finite(xi, "the tangent vector")?;
        let pose = Self::exp(xi);
        pose.check()?;
        Ok(pose)
    }

    /// [`LieGroup::log`] of an element from outside.
    ///
    /// # Errors
    /// As [`LieGroup::check`].
    fn try_log(&self) -> Result<SVector<f64, N>, Error> {
        self.check()?;
        Ok(self.log())
    }

    /// The relative element `self⁻¹ · other`, `a_from_b` of `world_from_a` and `world_from_b`.
    #[inline]
    fn between(&self, other: &Self) -> Self {
        self.inverse().compose(other)
    }

    /// `self · exp(ξ)`.
    #[inline]
    fn plus(&self, xi: &SVector<f64, N>) -> Self {
        self.compose(&Self::exp(xi))
    }

    /// `log(other⁻¹ · self)`, so that `other.plus(&self.minus(&other)) = self`; in the body frame of `other`.
    #[inline]
    fn minus(&self, other: &Self) -> SVector<f64, N> {
        other.between(self).log()
    }

    /// The point at `fraction` of the way from `self` (0) to `other` (1) along the group's geodesic,
    /// `self · exp(fraction · log(self⁻¹ other))`: constant body velocity, a screw motion in SE(3).
    ///
    /// Fractions outside [0, 1] extrapolate.
    fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        self.plus(&(other.minus(self) * fraction))
    }

    /// The residual of a relative pose measurement, `log(z⁻¹ · a⁻¹ · b)`.
    ///
    /// * `measured` – `z = a_from_b`.
    /// * `a`, `b` – `world_from_a`, `world_from_b`.
    ///
    /// Zero iff the estimate agrees with `z`; in the frame of the measured `b`.
    #[inline]
    fn between_error(measured: &Self, a: &Self, b: &Self) -> SVector<f64, N> {
        measured.between(&a.between(b)).log()
    }

    /// [`LieGroup::between_error`] with its Jacobians by `a` and by `b`:
    /// `-Jr⁻¹(e) Ad((a⁻¹ b)⁻¹)` and `Jr⁻¹(e)`.
    fn between_error_with_jacobians(
        measured: &Self,
        a: &Self,
        b: &Self,
    ) -> LinearizedPair<SVector<f64, N>, N> {
        let relative = a.between(b);
        let value = measured.between(&relative).log();
        let second = Self::right_jacobian_inverse(&value);
        LinearizedPair { value, first: -(second * relative.inverse().adjoint()), second }
    }

    /// [`LieGroup::compose`] with its Jacobians: `Ad(other⁻¹)` by `self`, identity by `other`.
    fn compose_with_jacobians(&self, other: &Self) -> LinearizedPair<Self, N> {
        LinearizedPair {
            value: self.compose(other),
            first: other.inverse().adjoint(),
            second: SMatrix::identity(),
        }
    }

    /// [`LieGroup::inverse`] with its Jacobian `-Ad(self)`.
    fn inverse_with_jacobian(&self) -> Linearized<Self, N> {
        Linearized { value: self.inverse(), jacobian: -self.adjoint() }
    }

    /// [`LieGroup::between`] with its Jacobians: `-Ad(between⁻¹)` by `self`, identity by `other`.
    fn between_with_jacobians(&self, other: &Self) -> LinearizedPair<Self, N> {
        let value = self.between(other);
        LinearizedPair { value, first: -value.inverse().adjoint(), second: SMatrix::identity() }
    }

    /// [`LieGroup::exp`] with its Jacobian `Jr(ξ)`.
    fn exp_with_jacobian(xi: &SVector<f64, N>) -> Linearized<Self, N> {
        Linearized { value: Self::exp(xi), jacobian: Self::right_jacobian(xi) }
    }

    /// [`LieGroup::log`] with its Jacobian `Jr⁻¹(log)`.
    fn log_with_jacobian(&self) -> Linearized<SVector<f64, N>, N> {
        let value = self.log();
        Linearized { value, jacobian: Self::right_jacobian_inverse(&value) }
    }

    /// [`LieGroup::plus`] with its Jacobians: `Ad(exp(ξ)⁻¹)` by `self`, `Jr(ξ)` by `ξ`.
    fn plus_with_jacobians(&self, xi: &SVector<f64, N>) -> LinearizedPair<Self, N> {
        let step = Self::exp(xi);
        LinearizedPair {
            value: self.compose(&step),
            first: step.inverse().adjoint(),
            second: Self::right_jacobian(xi),
        }
    }

    /// [`LieGroup::minus`] with its Jacobians: `Jr⁻¹(e)` by `self`, `-Jl⁻¹(e)` by `other`.
    fn minus_with_jacobians(&self, other: &Self) -> LinearizedPair<SVector<f64, N>, N> {
        let value = self.minus(other);
        LinearizedPair {
            value,
            first: Self::right_jacobian_inverse(&value),
            second: -Self::left_jacobian_inverse(&value),
        }
    }
}

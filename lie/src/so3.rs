use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};

use crate::check::{check_finite, check_hat, check_rotation, check_unit};
use crate::coefficients::{Angle, Forward, Inverse, TINY};
use crate::{Error, LieGroup};

/// The skew-symmetric matrix of `v`: `hat3(v) · w = v × w`.
#[inline]
pub fn hat3(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The vector of a skew-symmetric matrix, the inverse of [`hat3`] (its symmetric part is ignored).
#[inline]
pub fn vee3(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]) * 0.5
}

/// `x I + y hat(φ) + z φφᵀ`, the form all Jacobians of SO(3) have.
#[inline]
pub(crate) fn spin_matrix(x: f64, y: f64, z: f64, phi: &Vector3<f64>) -> Matrix3<f64> {
    let (yv, zv) = (phi * y, phi * z);
    let (xy, xz, yz) = (zv.x * phi.y, zv.x * phi.z, zv.y * phi.z);
    Matrix3::new(
        x + zv.x * phi.x,
        xy - yv.z,
        xz + yv.y,
        xy + yv.z,
        x + zv.y * phi.y,
        yz - yv.x,
        xz - yv.y,
        yz + yv.x,
        x + zv.z * phi.z,
    )
}

/// `exp` for a caller who has the angle and its half's sine and cosine already.
#[inline]
pub(crate) fn exp_with_half(
    phi: &Vector3<f64>,
    angle: &Angle,
    (sin, cos): (f64, f64),
) -> UnitQuaternion<f64> {
    let k = if angle.theta < TINY { 0.5 } else { sin / angle.theta };
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cos, phi * k))
}

/// The quaternion of a matrix that is a rotation up to small errors: that of the nearest rotation.
///
/// `M = 4 q qᵀ` is linear in the entries of the rotation (I. Bar-Itzhack, *New Method for Extracting the
/// Quaternion from a Rotation Matrix*, 2000), so its dominant eigenvector averages the errors of all entries.
/// The column of the largest diagonal entry is close, and each step of the power iteration squares the distance.
/// Small components stay relatively exact, unlike after a general eigenvalue solver.
fn nearest_quaternion(r: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let (xx, yy, zz) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
    let v = vee3(r) * 2.0;
    let (xy, xz, yz) = (r[(0, 1)] + r[(1, 0)], r[(0, 2)] + r[(2, 0)], r[(1, 2)] + r[(2, 1)]);
    let diagonal = [1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz];
    #[rustfmt::skip]
    let m = Matrix4::new(
        diagonal[0], xy, xz, v.x,
        xy, diagonal[1], yz, v.y,
        xz, yz, diagonal[2], v.z,
        v.x, v.y, v.z, diagonal[3],
    );
    let mut q: Vector4<f64> = m.column(Vector4::from(diagonal).imax()).normalize();
    for _ in 0..3 {
        q = (m * q).normalize();
    }
    UnitQuaternion::new_unchecked(Quaternion::from(q))
}

/// SO(3). Tangent `[φx, φy, φz]` in radians.
impl LieGroup<3> for UnitQuaternion<f64> {
    type Matrix = Matrix3<f64>;

    fn identity() -> Self {
        UnitQuaternion::identity()
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let product = self.into_inner() * other.into_inner();
        let norm_sq = product.norm_squared();
        // one Newton step towards unit norm keeps 10⁵ products from drifting; within rounding leave it alone
        let off = (norm_sq - 1.0).abs() > 4.0 * f64::EPSILON;
        UnitQuaternion::new_unchecked(if off { product * (1.5 - 0.5 * norm_sq) } else { product })
    }
    #[inline]
    fn inverse(&self) -> Self {
        self.conjugate()
    }
    fn exp(phi: &Vector3<f64>) -> Self {
        let angle = Angle::of(phi);
        exp_with_half(phi, &angle, angle.half_sin_cos())
    }
    #[inline]
    fn log(&self) -> Vector3<f64> {
        let (v, w) = (Vector3::new(self.i, self.j, self.k), self.w);
        let n = v.norm();
        if n < TINY {
            return v * (2.0 / w);
        }
        // q and -q are one rotation: take the one with w >= 0, so the angle stays within [0, π]
        let angle = if w < 0.0 { -2.0 * n.atan2(-w) } else { 2.0 * n.atan2(w) };
        v * (angle / n)
    }
    fn hat(phi: &Vector3<f64>) -> Matrix3<f64> {
        hat3(phi)
    }
    fn vee(matrix: &Matrix3<f64>) -> Result<Vector3<f64>, Error> {
        let phi = vee3(matrix);
        check_hat(matrix, &hat3(&phi))?;
        Ok(phi)
    }
    fn to_matrix(&self) -> Matrix3<f64> {
        self.to_rotation_matrix().into_inner()
    }
    fn try_from_matrix(matrix: &Matrix3<f64>) -> Result<Self, Error> {
        check_rotation(matrix, matrix.determinant())?;
        Ok(nearest_quaternion(matrix))
    }
    #[inline]
    fn adjoint(&self) -> Matrix3<f64> {
        self.to_rotation_matrix().into_inner()
    }
    fn small_adjoint(phi: &Vector3<f64>) -> Matrix3<f64> {
        hat3(phi)
    }
    #[inline]
    fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
        let f = Forward::of(&Angle::of(phi));
        spin_matrix(f.a, f.b, f.c, phi)
    }
    #[inline]
    fn left_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
        let f = Inverse::of(&Angle::of(phi));
        spin_matrix(f.a, -0.5, f.d, phi)
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.coords, "the rotation")?;
        check_unit(self.norm())
    }
    fn renormalize(&self) -> Self {
        UnitQuaternion::new_normalize(self.into_inner())
    }
}

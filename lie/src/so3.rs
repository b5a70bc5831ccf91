use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::cholesky::{check_finite, check_unit};
use crate::{Error, LieGroup};

/// The skew-symmetric matrix of `v`: `hat3(v) · w = v × w`.
pub fn hat3(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The vector of a skew-symmetric matrix, the inverse of [`hat3`] (its symmetric part is ignored).
pub fn vee3(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]) * 0.5
}

/// `(1 - cos θ) / θ²` and `(θ - sin θ) / θ³` of `θ = |φ|`.
pub(crate) fn jacobian_coefficients(theta: f64) -> (f64, f64) {
    let t2 = theta * theta;
    if theta < 0.3 {
        let b =
            0.5 - t2 / 24.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0 * (1.0 - t2 / 90.0 * (1.0 - t2 / 132.0))));
        let c = (1.0
            - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0 * (1.0 - t2 / 110.0 * (1.0 - t2 / 156.0)))))
            / 6.0;
        (b, c)
    } else {
        let half = (0.5 * theta).sin();
        (2.0 * half * half / t2, (theta - theta.sin()) / (t2 * theta))
    }
}

impl LieGroup<3> for UnitQuaternion<f64> {
    fn identity() -> Self {
        UnitQuaternion::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        self * other
    }
    fn inverse(&self) -> Self {
        UnitQuaternion::inverse(self)
    }
    fn exp(phi: &Vector3<f64>) -> Self {
        let half = 0.5 * phi.norm();
        let k = if half < 1e-4 { 0.5 * (1.0 - half * half / 6.0) } else { 0.5 * half.sin() / half };
        UnitQuaternion::new_normalize(Quaternion::from_parts(half.cos(), phi * k))
    }
    fn log(&self) -> Vector3<f64> {
        let v = self.imag();
        let (n, w) = (v.norm(), self.w);
        if n < 1e-300 {
            return v * 2.0;
        }
        // q and -q are one rotation: take the half with w >= 0, so the angle stays within [0, π]
        let angle = if w < 0.0 { -2.0 * n.atan2(-w) } else { 2.0 * n.atan2(w) };
        v * (angle / n)
    }
    fn adjoint(&self) -> Matrix3<f64> {
        self.to_rotation_matrix().into_inner()
    }
    fn small_adjoint(phi: &Vector3<f64>) -> Matrix3<f64> {
        hat3(phi)
    }
    fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
        let (b, c) = jacobian_coefficients(phi.norm());
        let w = hat3(phi);
        Matrix3::identity() + w * b + w * w * c
    }
    fn left_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
        let theta = phi.norm();
        let t2 = theta * theta;
        let d = if theta < 0.3 {
            1.0 / 12.0 + t2 / 720.0 * (1.0 + t2 / 42.0 * (1.0 + t2 / 40.0 * (1.0 + t2 * 10.0 / 396.0)))
        } else {
            let half = 0.5 * theta;
            (1.0 - half * half.cos() / half.sin()) / t2
        };
        let w = hat3(phi);
        Matrix3::identity() - w * 0.5 + w * w * d
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.coords, "the rotation")?;
        check_unit(self.coords.norm())
    }
    fn renormalize(&self) -> Self {
        UnitQuaternion::new_normalize(self.into_inner())
    }
}

use nalgebra::{Isometry2, Matrix2, Matrix3, Translation2, UnitComplex, Vector2, Vector3};

use crate::cholesky::check_finite;
use crate::{Error, LieGroup};

/// `sin θ / θ` and `(1 - cos θ) / θ`.
fn sinc_and_cosc(theta: f64) -> (f64, f64) {
    if theta.abs() < 1e-4 {
        let t2 = theta * theta;
        (1.0 - t2 / 6.0, theta * (0.5 - t2 / 24.0))
    } else {
        let half = 0.5 * theta;
        (theta.sin() / theta, half.sin() * half.sin() / half)
    }
}

impl LieGroup<3> for Isometry2<f64> {
    fn identity() -> Self {
        Isometry2::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        self * other
    }
    fn inverse(&self) -> Self {
        Isometry2::inverse(self)
    }
    fn exp(xi: &Vector3<f64>) -> Self {
        let (s, c) = sinc_and_cosc(xi[2]);
        let translation = Matrix2::new(s, -c, c, s) * Vector2::new(xi[0], xi[1]);
        Isometry2::from_parts(Translation2::from(translation), UnitComplex::new(xi[2]))
    }
    fn log(&self) -> Vector3<f64> {
        let theta = self.rotation.angle();
        let (s, c) = sinc_and_cosc(theta);
        let t = &self.translation.vector;
        let n = s * s + c * c;
        Vector3::new((s * t.x + c * t.y) / n, (s * t.y - c * t.x) / n, theta)
    }
    fn adjoint(&self) -> Matrix3<f64> {
        let (c, s) = (self.rotation.re, self.rotation.im);
        let t = &self.translation.vector;
        Matrix3::new(c, -s, t.y, s, c, -t.x, 0.0, 0.0, 1.0)
    }
    fn small_adjoint(xi: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::new(0.0, -xi[2], xi[1], xi[2], 0.0, -xi[0], 0.0, 0.0, 0.0)
    }
    fn left_jacobian(xi: &Vector3<f64>) -> Matrix3<f64> {
        let theta = xi[2];
        let (s, c) = sinc_and_cosc(theta);
        // (θ - sin θ) / θ² and (1 - cos θ) / θ²
        let (a, b) = if theta.abs() < 1e-3 {
            let t2 = theta * theta;
            (theta * (1.0 / 6.0 - t2 / 120.0), 0.5 - t2 / 24.0)
        } else {
            ((1.0 - s) / theta, c / theta)
        };
        Matrix3::new(s, -c, a * xi[0] + b * xi[1], c, s, a * xi[1] - b * xi[0], 0.0, 0.0, 1.0)
    }
    fn left_jacobian_inverse(xi: &Vector3<f64>) -> Matrix3<f64> {
        let j = Self::left_jacobian(xi);
        let (s, c) = (j[(0, 0)], j[(1, 0)]);
        let n = s * s + c * c;
        let v = Matrix2::new(s, c, -c, s) / n;
        let q = -(v * Vector2::new(j[(0, 2)], j[(1, 2)]));
        Matrix3::new(v.m11, v.m12, q.x, v.m21, v.m22, q.y, 0.0, 0.0, 1.0)
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.translation.vector, "the translation")?;
        LieGroup::check(&self.rotation)
    }
    fn renormalize(&self) -> Self {
        Isometry2::from_parts(self.translation, LieGroup::renormalize(&self.rotation))
    }
}

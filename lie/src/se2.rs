use nalgebra::{Isometry2, Matrix3, Translation2, UnitComplex, Vector2, Vector3};

use crate::check::{check_bottom_row, check_finite, check_hat};
use crate::coefficients::{Angle, Forward, Inverse};
use crate::{Error, LieGroup};

/// SE(2). Tangent `[x, y, θ]` in metres and radians.
impl LieGroup<3> for Isometry2<f64> {
    type Matrix = Matrix3<f64>;

    fn identity() -> Self {
        Isometry2::identity()
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let translation = self.translation.vector + self.rotation * other.translation.vector;
        Isometry2::from_parts(translation.into(), self.rotation.compose(&other.rotation))
    }
    #[inline]
    fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Isometry2::from_parts((rotation * -self.translation.vector).into(), rotation)
    }
    fn exp(xi: &Vector3<f64>) -> Self {
        let theta = xi[2];
        let f = Forward::of(&Angle::of_plane(theta));
        let (s, c) = (f.a, f.b * theta);
        let translation = Vector2::new(s * xi[0] - c * xi[1], c * xi[0] + s * xi[1]);
        Isometry2::from_parts(Translation2::from(translation), UnitComplex::new(theta))
    }
    #[inline]
    fn log(&self) -> Vector3<f64> {
        let theta = self.rotation.im.atan2(self.rotation.re);
        let (a, half) = (Inverse::by_series(theta * theta).a, 0.5 * theta);
        let t = &self.translation.vector;
        Vector3::new(a * t.x + half * t.y, a * t.y - half * t.x, theta)
    }
    #[inline]
    fn between(&self, other: &Self) -> Self {
        // the difference first: exact for close poses however far from the origin they lie
        let rotation = self.rotation.conjugate();
        let translation = rotation * (other.translation.vector - self.translation.vector);
        Isometry2::from_parts(translation.into(), rotation.compose(&other.rotation))
    }
    fn hat(xi: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::new(0.0, -xi[2], xi[0], xi[2], 0.0, xi[1], 0.0, 0.0, 0.0)
    }
    fn vee(matrix: &Matrix3<f64>) -> Result<Vector3<f64>, Error> {
        let xi = Vector3::new(matrix.m13, matrix.m23, 0.5 * (matrix.m21 - matrix.m12));
        check_hat(matrix, &Self::hat(&xi))?;
        Ok(xi)
    }
    fn to_matrix(&self) -> Matrix3<f64> {
        self.to_homogeneous()
    }
    fn try_from_matrix(matrix: &Matrix3<f64>) -> Result<Self, Error> {
        check_bottom_row(matrix)?;
        let rotation =
            <UnitComplex<f64> as LieGroup<1>>::try_from_matrix(&matrix.fixed_view::<2, 2>(0, 0).into())?;
        Ok(Isometry2::from_parts(Translation2::new(matrix.m13, matrix.m23), rotation))
    }
    #[inline]
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
        let f = Forward::of(&Angle::of_plane(theta));
        planar(f.a, f.b * theta, f.b, f.c * theta, xi)
    }
    #[inline]
    fn left_jacobian_inverse(xi: &Vector3<f64>) -> Matrix3<f64> {
        let theta = xi[2];
        let f = Inverse::of(&Angle::of_plane(theta));
        planar(f.a, -0.5 * theta, -0.5, f.d * theta, xi)
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.translation.vector, "the translation")?;
        LieGroup::check(&self.rotation)
    }
    fn renormalize(&self) -> Self {
        Isometry2::from_parts(self.translation, LieGroup::renormalize(&self.rotation))
    }
}

/// The matrix `I + k ad(ξ) + (m/θ) ad(ξ)²`, which has the rotation block `[[cos, -sin], [sin, cos]]`.
#[inline]
fn planar(cos: f64, sin: f64, k: f64, m: f64, xi: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(cos, -sin, k * xi[1] + m * xi[0], sin, cos, m * xi[1] - k * xi[0], 0.0, 0.0, 1.0)
}

use nalgebra::{Complex, Matrix2, SMatrix, SVector, UnitComplex, Vector1, Vector2};

use crate::check::{check_finite, check_hat, check_rotation, check_unit};
use crate::{Error, LieGroup};

/// SO(2). Tangent `[θ]` in radians.
impl LieGroup<1> for UnitComplex<f64> {
    type Matrix = Matrix2<f64>;

    fn identity() -> Self {
        UnitComplex::identity()
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let product = self.into_inner() * other.into_inner();
        let norm_sq = product.norm_sqr();
        // one Newton step towards unit norm keeps 10⁵ products from drifting; within rounding leave it alone
        let off = (norm_sq - 1.0).abs() > 4.0 * f64::EPSILON;
        UnitComplex::new_unchecked(if off { product * (1.5 - 0.5 * norm_sq) } else { product })
    }
    #[inline]
    fn inverse(&self) -> Self {
        self.conjugate()
    }
    fn exp(xi: &Vector1<f64>) -> Self {
        UnitComplex::new(xi[0])
    }
    #[inline]
    fn log(&self) -> Vector1<f64> {
        Vector1::new(self.im.atan2(self.re))
    }
    fn hat(xi: &Vector1<f64>) -> Matrix2<f64> {
        Matrix2::new(0.0, -xi[0], xi[0], 0.0)
    }
    fn vee(matrix: &Matrix2<f64>) -> Result<Vector1<f64>, Error> {
        let xi = Vector1::new(0.5 * (matrix.m21 - matrix.m12));
        check_hat(matrix, &Self::hat(&xi))?;
        Ok(xi)
    }
    fn to_matrix(&self) -> Matrix2<f64> {
        Matrix2::new(self.re, -self.im, self.im, self.re)
    }
    fn try_from_matrix(matrix: &Matrix2<f64>) -> Result<Self, Error> {
        check_rotation(matrix, matrix.determinant())?;
        // the nearest rotation: the averages of what should be two copies
        Ok(UnitComplex::new_normalize(Complex::new(matrix.m11 + matrix.m22, matrix.m21 - matrix.m12)))
    }
    fn adjoint(&self) -> SMatrix<f64, 1, 1> {
        SMatrix::identity()
    }
    fn small_adjoint(_xi: &SVector<f64, 1>) -> SMatrix<f64, 1, 1> {
        SMatrix::zeros()
    }
    fn left_jacobian(_xi: &SVector<f64, 1>) -> SMatrix<f64, 1, 1> {
        SMatrix::identity()
    }
    fn left_jacobian_inverse(_xi: &SVector<f64, 1>) -> SMatrix<f64, 1, 1> {
        SMatrix::identity()
    }
    fn check(&self) -> Result<(), Error> {
        let parts = Vector2::new(self.re, self.im);
        check_finite(&parts, "the rotation")?;
        check_unit(parts.norm())
    }
    fn renormalize(&self) -> Self {
        UnitComplex::new_normalize(self.into_inner())
    }
}

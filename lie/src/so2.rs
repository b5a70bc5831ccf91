use nalgebra::{SMatrix, SVector, UnitComplex, Vector2};

use crate::cholesky::{check_finite, check_unit};
use crate::{Error, LieGroup};

impl LieGroup<1> for UnitComplex<f64> {
    fn identity() -> Self {
        UnitComplex::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        self * other
    }
    fn inverse(&self) -> Self {
        UnitComplex::inverse(self)
    }
    fn exp(xi: &SVector<f64, 1>) -> Self {
        UnitComplex::new(xi[0])
    }
    fn log(&self) -> SVector<f64, 1> {
        SVector::<f64, 1>::new(self.angle())
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
        check_finite(&Vector2::new(self.re, self.im), "the rotation")?;
        check_unit(Vector2::new(self.re, self.im).norm())
    }
    fn renormalize(&self) -> Self {
        UnitComplex::new_normalize(self.into_inner())
    }
}

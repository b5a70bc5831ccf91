use nalgebra::{
    Isometry3, Matrix3, Matrix4, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion, Vector3, Vector6,
};

use crate::check::{check_bottom_row, check_finite, check_hat};
use crate::coefficients::{Angle, Forward, Inverse};
use crate::so3::{exp_with_half, hat3, spin_matrix, vee3};
use crate::{Error, LieGroup, LinearizedPair};

#[inline]
pub(crate) fn parts(xi: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(xi[0], xi[1], xi[2]), Vector3::new(xi[3], xi[4], xi[5]))
}

/// `[[diagonal, upper], [0, diagonal]]`.
#[inline]
pub(crate) fn blocks(diagonal: &Matrix3<f64>, upper: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = SMatrix::<f64, 6, 6>::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(diagonal);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(upper);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(diagonal);
    m
}

/// The derivative of `x I + y hat(φ) + z φφᵀ` in the direction `ρ`:
/// `s x' I + y hat(ρ) + s y' hat(φ) + z (φρᵀ + ρφᵀ) + s z' φφᵀ` with `s = φ·ρ`; `x'`, `y'`, `z'` are derivatives
/// by θ over θ.
#[inline]
pub(crate) fn spin_derivative(
    (y, z): (f64, f64),
    (x_rate, y_rate, z_rate): (f64, f64, f64),
    rho: &Vector3<f64>,
    phi: &Vector3<f64>,
) -> Matrix3<f64> {
    let s = phi.dot(rho);
    let (u, skew) = (rho * z + phi * (0.5 * s * z_rate), rho * y + phi * (s * y_rate));
    // φ uᵀ + u φᵀ carries both symmetric terms
    let symmetric = |i: usize, j: usize| phi[i] * u[j] + u[i] * phi[j];
    let (xy, xz, yz) = (symmetric(0, 1), symmetric(0, 2), symmetric(1, 2));
    let x = s * x_rate;
    Matrix3::new(
        x + symmetric(0, 0),
        xy - skew.z,
        xz + skew.y,
        xy + skew.z,
        x + symmetric(1, 1),
        yz - skew.x,
        xz - skew.y,
        yz + skew.x,
        x + symmetric(2, 2),
    )
}

/// `(x I + z φφᵀ) v + y φ × v`.
#[inline]
fn spin(x: f64, y: f64, z: f64, phi: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    v * x + phi.cross(v) * y + phi * (z * phi.dot(v))
}

/// `m · hat(t)`: the rows of `m` cross `t`.
#[inline]
fn times_hat(m: &Matrix3<f64>, t: &Vector3<f64>) -> Matrix3<f64> {
    let (x, y, z) = (m.column(0), m.column(1), m.column(2));
    Matrix3::from_columns(&[y * t.z - z * t.y, z * t.x - x * t.z, x * t.y - y * t.x])
}

/// SE(3). Tangent `[ρx, ρy, ρz, φx, φy, φz]` in metres and radians.
impl LieGroup<6> for Isometry3<f64> {
    type Matrix = Matrix4<f64>;

    fn identity() -> Self {
        Isometry3::identity()
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let translation = self.translation.vector + self.rotation * other.translation.vector;
        Isometry3::from_parts(translation.into(), self.rotation.compose(&other.rotation))
    }
    #[inline]
    fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Isometry3::from_parts((rotation * -self.translation.vector).into(), rotation)
    }
    fn exp(xi: &Vector6<f64>) -> Self {
        let (rho, phi) = parts(xi);
        let angle = Angle::of(&phi);
        let half = angle.half_sin_cos();
        let f = Forward::with_half(&angle, half);
        let translation = spin(f.a, f.b, f.c, &phi, &rho);
        Isometry3::from_parts(Translation3::from(translation), exp_with_half(&phi, &angle, half))
    }
    #[inline]
    fn log(&self) -> Vector6<f64> {
        let phi = LieGroup::log(&self.rotation);
        let f = Inverse::by_series(phi.norm_squared());
        let rho = spin(f.a, -0.5, f.d, &phi, &self.translation.vector);
        Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
    }
    #[inline]
    fn between(&self, other: &Self) -> Self {
        // the difference first: exact for close poses however far from the origin they lie
        let rotation = self.rotation.conjugate();
        let translation = rotation * (other.translation.vector - self.translation.vector);
        Isometry3::from_parts(translation.into(), rotation.compose(&other.rotation))
    }
    #[inline]
    fn between_error_with_jacobians(measured: &Self, a: &Self, b: &Self) -> LinearizedPair<Vector6<f64>, 6> {
        let relative = a.between(b);
        let error = measured.between(&relative);
        let phi = LieGroup::log(&error.rotation);
        let f = Inverse::by_series(phi.norm_squared());
        let rho = spin(f.a, -0.5, f.d, &phi, &error.translation.vector);
        let j = spin_matrix(f.a, 0.5, f.d, &phi);
        let q = spin_derivative((0.5, f.d), (f.a_rate, 0.0, f.d_rate), &rho, &phi);
        // -[[j, q], [0, j]] Ad(relative⁻¹), with Ad(relative⁻¹) = [[Rᵀ, -Rᵀ [t]×], [0, Rᵀ]]
        let back = relative.rotation.conjugate().to_rotation_matrix().into_inner();
        let turned = -(j * back);
        let upper = -(q * back) - times_hat(&turned, &relative.translation.vector);
        LinearizedPair {
            value: Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z),
            first: blocks(&turned, &upper),
            second: blocks(&j, &q),
        }
    }
    fn hat(xi: &Vector6<f64>) -> Matrix4<f64> {
        let (rho, phi) = parts(xi);
        let mut m = hat3(&phi).to_homogeneous();
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&rho);
        m[(3, 3)] = 0.0;
        m
    }
    fn vee(matrix: &Matrix4<f64>) -> Result<Vector6<f64>, Error> {
        let phi = vee3(&matrix.fixed_view::<3, 3>(0, 0).into());
        let xi = Vector6::new(matrix.m14, matrix.m24, matrix.m34, phi.x, phi.y, phi.z);
        check_hat(matrix, &Self::hat(&xi))?;
        Ok(xi)
    }
    fn to_matrix(&self) -> Matrix4<f64> {
        self.to_homogeneous()
    }
    fn try_from_matrix(matrix: &Matrix4<f64>) -> Result<Self, Error> {
        check_bottom_row(matrix)?;
        let rotation =
            <UnitQuaternion<f64> as LieGroup<3>>::try_from_matrix(&matrix.fixed_view::<3, 3>(0, 0).into())?;
        Ok(Isometry3::from_parts(Translation3::new(matrix.m14, matrix.m24, matrix.m34), rotation))
    }
    #[inline]
    fn adjoint(&self) -> Matrix6<f64> {
        let r = LieGroup::adjoint(&self.rotation);
        let t = &self.translation.vector;
        let mut turned = r;
        for mut column in turned.column_iter_mut() {
            let moved = t.cross(&column);
            column.copy_from(&moved);
        }
        blocks(&r, &turned)
    }
    fn small_adjoint(xi: &SVector<f64, 6>) -> Matrix6<f64> {
        let (rho, phi) = parts(xi);
        blocks(&hat3(&phi), &hat3(&rho))
    }
    #[inline]
    fn left_jacobian(xi: &SVector<f64, 6>) -> Matrix6<f64> {
        let (rho, phi) = parts(xi);
        let angle = Angle::of(&phi);
        let f = Forward::of(&angle);
        let (b_rate, c_rate) = f.rates(&angle);
        let q = spin_derivative((f.b, f.c), (f.c - f.b, b_rate, c_rate), &rho, &phi);
        blocks(&spin_matrix(f.a, f.b, f.c, &phi), &q)
    }
    #[inline]
    fn left_jacobian_inverse(xi: &SVector<f64, 6>) -> Matrix6<f64> {
        let (rho, phi) = parts(xi);
        let f = Inverse::of(&Angle::of(&phi));
        let q = spin_derivative((-0.5, f.d), (f.a_rate, 0.0, f.d_rate), &rho, &phi);
        blocks(&spin_matrix(f.a, -0.5, f.d, &phi), &q)
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.translation.vector, "the translation")?;
        LieGroup::check(&self.rotation)
    }
    fn renormalize(&self) -> Self {
        Isometry3::from_parts(self.translation, LieGroup::renormalize(&self.rotation))
    }
}

use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::cholesky::check_finite;
use crate::so3::{hat3, jacobian_coefficients};
use crate::{Error, LieGroup};

fn parts(xi: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(xi[0], xi[1], xi[2]), Vector3::new(xi[3], xi[4], xi[5]))
}

fn blocks(
    upper_left: &Matrix3<f64>,
    upper_right: &Matrix3<f64>,
    lower_right: &Matrix3<f64>,
) -> SMatrix<f64, 6, 6> {
    let mut m = SMatrix::<f64, 6, 6>::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(upper_left);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(upper_right);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(lower_right);
    m
}

/// The block `Q` of the left Jacobian of SE(3) (Barfoot, State Estimation for Robotics, eq. 7.86).
fn q_block(rho: &Vector3<f64>, phi: &Vector3<f64>) -> Matrix3<f64> {
    let (r, p) = (hat3(rho), hat3(phi));
    let theta = phi.norm();
    let t2 = theta * theta;
    let (_, c1) = jacobian_coefficients(theta);
    let (c2, c3) = if theta < 0.5 {
        (
            1.0 / 24.0 - t2 / 720.0 * (1.0 - t2 / 56.0 * (1.0 - t2 / 90.0 * (1.0 - t2 / 132.0))),
            1.0 / 120.0 - t2 / 2520.0 * (1.0 - t2 / 48.0 * (1.0 - t2 * 3.0 / 220.0)),
        )
    } else {
        let c2 = (theta.cos() - 1.0 + 0.5 * t2) / (t2 * t2);
        (c2, 0.5 * (c2 * 2.0 - 3.0 * (theta.sin() - theta + t2 * theta / 6.0) / (t2 * t2 * theta)) - 0.5 * c2)
    };
    let (pr, rp) = (p * r, r * p);
    let prp = pr * p;
    r * 0.5 + (pr + rp + prp) * c1 + (p * pr + rp * p - prp * 3.0) * c2 + (prp * p + p * prp) * c3
}

impl LieGroup<6> for Isometry3<f64> {
    fn identity() -> Self {
        Isometry3::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        self * other
    }
    fn inverse(&self) -> Self {
        Isometry3::inverse(self)
    }
    fn exp(xi: &Vector6<f64>) -> Self {
        let (rho, phi) = parts(xi);
        let translation = <UnitQuaternion<f64> as LieGroup<3>>::left_jacobian(&phi) * rho;
        Isometry3::from_parts(
            Translation3::from(translation),
            <UnitQuaternion<f64> as LieGroup<3>>::exp(&phi),
        )
    }
    fn log(&self) -> Vector6<f64> {
        let phi = LieGroup::log(&self.rotation);
        let rho = <UnitQuaternion<f64> as LieGroup<3>>::left_jacobian_inverse(&phi) * self.translation.vector;
        Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z)
    }
    fn adjoint(&self) -> SMatrix<f64, 6, 6> {
        let r = self.rotation.to_rotation_matrix().into_inner();
        blocks(&r, &(hat3(&self.translation.vector) * r), &r)
    }
    fn small_adjoint(xi: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        let (rho, phi) = parts(xi);
        let p = hat3(&phi);
        blocks(&p, &hat3(&rho), &p)
    }
    fn left_jacobian(xi: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        let (rho, phi) = parts(xi);
        let j = <UnitQuaternion<f64> as LieGroup<3>>::left_jacobian(&phi);
        blocks(&j, &q_block(&rho, &phi), &j)
    }
    fn left_jacobian_inverse(xi: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        let (rho, phi) = parts(xi);
        let j = <UnitQuaternion<f64> as LieGroup<3>>::left_jacobian_inverse(&phi);
        blocks(&j, &(-(j * q_block(&rho, &phi) * j)), &j)
    }
    fn check(&self) -> Result<(), Error> {
        check_finite(&self.translation.vector, "the translation")?;
        LieGroup::check(&self.rotation)
    }
    fn renormalize(&self) -> Self {
        Isometry3::from_parts(self.translation, LieGroup::renormalize(&self.rotation))
    }
}

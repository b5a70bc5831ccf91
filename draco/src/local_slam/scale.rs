use draco_lie::LieGroup;
use draco_pgo::{CustomFactor, Key};
use nalgebra::{Isometry2, UnitComplex, Vector3};

/// The pose that carries the odometry's calibration: its x is the factor on lengths, its heading the
/// constant error of the odometry's heading a keyframe; its y stays 0.
pub(super) const CALIBRATION: Key = Key::new(1, 0);

/// One step of odometry whose length is misjudged by a common unknown factor, and whose heading by a common unknown angle.
///
/// Residual `σ⁻¹ log(corrected(z, s, β)⁻¹ a⁻¹ b)` where `corrected` multiplies the translation of `z` by `s` and turns its
/// heading by `β`.
#[derive(Debug)]
pub(super) struct ScaledStep {
    keys: [Key; 3],
    odometry: Isometry2<f64>,
    weight: Vector3<f64>,
}

impl ScaledStep {
    pub(super) fn new(from: Key, to: Key, odometry: Isometry2<f64>, sigma: Vector3<f64>) -> Self {
        Self { keys: [from, to, CALIBRATION], odometry, weight: sigma.map(|s| 1.0 / s) }
    }

    fn error(&self, poses: &[Isometry2<f64>]) -> Vector3<f64> {
        let predicted = corrected(&self.odometry, poses[2].translation.x, poses[2].rotation.angle());
        predicted.between(&poses[0].between(&poses[1])).log()
    }
}

/// The step with its length multiplied by `scale` and its heading turned by `bias`.
pub(super) fn corrected(odometry: &Isometry2<f64>, scale: f64, bias: f64) -> Isometry2<f64> {
    let rotation = odometry.rotation * UnitComplex::new(bias);
    Isometry2::from_parts((odometry.translation.vector * scale).into(), rotation)
}

impl CustomFactor<Isometry2<f64>, 3> for ScaledStep {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        3
    }

    fn residual(&self, poses: &[Isometry2<f64>], residual: &mut [f64]) {
        residual.copy_from_slice(self.error(poses).component_mul(&self.weight).as_slice());
    }

    fn jacobian(&self, poses: &[Isometry2<f64>], which: usize, jacobian: &mut [f64]) {
        let error = self.error(poses);
        let right = Isometry2::right_jacobian_inverse(&error);
        let mut j = match which {
            0 => -right * poses[1].between(&poses[0]).adjoint(),
            1 => right,
            _ => {
                // A change of s moves the predicted pose by its own frame's image of the step; seen from the error
                // that is a left perturbation by the negative.
                let mut column = Vector3::zeros();
                let rotation = self.odometry.rotation * poses[2].rotation;
                let body = rotation.inverse() * self.odometry.translation.vector;
                column.fixed_rows_mut::<2>(0).copy_from(&body);
                let mut j = nalgebra::Matrix3::zeros();
                let along = poses[2].rotation * nalgebra::Vector2::new(1.0, 0.0);
                let across = poses[2].rotation * nalgebra::Vector2::new(0.0, 1.0);
                let inverse = -Isometry2::left_jacobian_inverse(&error);
                let left = inverse * column;
                j.set_column(0, &(left * along.x));
                j.set_column(1, &(left * across.x));
                j.set_column(2, &(inverse * Vector3::z()));
                j
            }
        };
        for (mut row, weight) in j.row_iter_mut().zip(self.weight.iter()) {
            row *= *weight;
        }
        for row in 0..3 {
            for column in 0..3 {
                jacobian[row * 3 + column] = j[(row, column)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jacobians_agree_with_central_differences() {
        let (a, b) = (Key::new(0, 0), Key::new(0, 1));
        let odometry = Isometry2::new([2.4, -0.7].into(), 0.4);
        let factor = ScaledStep::new(a, b, odometry, Vector3::new(0.5, 0.7, 0.02));
        let poses = [
            Isometry2::new([3.0, 1.0].into(), -2.8),
            Isometry2::new([1.2, 0.1].into(), -2.1),
            Isometry2::new([0.9, 0.01].into(), 0.03),
        ];
        for which in 0..3 {
            let mut analytic = [0.0; 9];
            factor.jacobian(&poses, which, &mut analytic);
            for k in 0..3 {
                let at = |step: f64| {
                    let mut moved = poses;
                    moved[which] = poses[which].plus(&(Vector3::ith(k, step)));
                    let mut residual = [0.0; 3];
                    factor.residual(&moved, &mut residual);
                    Vector3::from(residual)
                };
                let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                for row in 0..3 {
                    assert!((numeric[row] - analytic[row * 3 + k]).abs() < 1e-5, "pose {which}, {row} {k}");
                }
            }
        }
    }
}

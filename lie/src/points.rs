use nalgebra::{
    Isometry2, Isometry3, Matrix2, Matrix3, SMatrix, SVector, UnitComplex, UnitQuaternion, Vector2, Vector3,
};

use crate::LieGroup;
use crate::so3::hat3;

/// A transformed point with its Jacobians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovedPoint<const D: usize, const N: usize> {
    /// The point in the frame the pose leads to.
    pub point: SVector<f64, D>,
    /// Its Jacobian by the pose, perturbed on the right: `D × N`, columns translation then rotation.
    pub by_pose: SMatrix<f64, D, N>,
    /// Its Jacobian by the point, the rotation matrix: `D × D`.
    pub by_point: SMatrix<f64, D, D>,
}

/// Groups of dimension `N` that move points of `D` coordinates (metres).
///
/// `a_from_b.act(&p)` takes a point given in frame `b` to frame `a`: `R p + t` for poses, `R p` for rotations.
///
/// ```
/// use draco_lie::PointAction;
/// use nalgebra::{Isometry2, Vector2};
/// let world_from_body = Isometry2::new(Vector2::new(1.0, 2.0), std::f64::consts::FRAC_PI_2);
/// let moved = world_from_body.act_with_jacobians(&Vector2::new(3.0, 0.0));
/// assert!((moved.point - Vector2::new(1.0, 5.0)).norm() < 1e-15);
/// // turning the body moves a point ahead of it sideways, here towards -x
/// assert!((moved.by_pose[(0, 2)] + 3.0).abs() < 1e-15);
/// ```
pub trait PointAction<const N: usize, const D: usize>: LieGroup<N> {
    /// The point moved by the pose.
    fn act(&self, point: &SVector<f64, D>) -> SVector<f64, D>;

    /// [`PointAction::act`] with both Jacobians: `[R, R G(p)]` by the pose and `R` by the point, where `G(p)` is
    /// `(-y, x)ᵀ` in the plane and `-hat(p)` in space (rotations have the second block only).
    fn act_with_jacobians(&self, point: &SVector<f64, D>) -> MovedPoint<D, N>;
}

impl PointAction<1, 2> for UnitComplex<f64> {
    #[inline]
    fn act(&self, point: &Vector2<f64>) -> Vector2<f64> {
        self * point
    }
    #[inline]
    fn act_with_jacobians(&self, point: &Vector2<f64>) -> MovedPoint<2, 1> {
        let moved = self * point;
        MovedPoint { point: moved, by_pose: Vector2::new(-moved.y, moved.x), by_point: rotation2(self) }
    }
}

impl PointAction<3, 2> for Isometry2<f64> {
    #[inline]
    fn act(&self, point: &Vector2<f64>) -> Vector2<f64> {
        self.rotation * point + self.translation.vector
    }
    #[inline]
    fn act_with_jacobians(&self, point: &Vector2<f64>) -> MovedPoint<2, 3> {
        let (turned, r) = (self.rotation * point, rotation2(&self.rotation));
        let by_pose = SMatrix::<f64, 2, 3>::new(r.m11, r.m12, -turned.y, r.m21, r.m22, turned.x);
        MovedPoint { point: turned + self.translation.vector, by_pose, by_point: r }
    }
}

impl PointAction<3, 3> for UnitQuaternion<f64> {
    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self * point
    }
    #[inline]
    fn act_with_jacobians(&self, point: &Vector3<f64>) -> MovedPoint<3, 3> {
        let r = self.to_rotation_matrix().into_inner();
        MovedPoint { point: r * point, by_pose: -(r * hat3(point)), by_point: r }
    }
}

impl PointAction<6, 3> for Isometry3<f64> {
    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation.vector
    }
    #[inline]
    fn act_with_jacobians(&self, point: &Vector3<f64>) -> MovedPoint<3, 6> {
        let r: Matrix3<f64> = self.rotation.to_rotation_matrix().into_inner();
        let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&r);
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-(r * hat3(point)));
        MovedPoint { point: r * point + self.translation.vector, by_pose, by_point: r }
    }
}

#[inline]
fn rotation2(rotation: &UnitComplex<f64>) -> Matrix2<f64> {
    Matrix2::new(rotation.re, -rotation.im, rotation.im, rotation.re)
}

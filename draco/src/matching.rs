//! What the matching of a step, of an own loop and of a closure between robots have in common.

use draco_lie::LieGroup;
use draco_registration::correlative::{CorrelativeParams, FieldParams};
use nalgebra::{Isometry2, Matrix3, Point2, Vector2, Vector3};

/// The finer search, wherever a match is refined: half the width of the coarse kernel, and so twice as many points that
/// tell something of their own; a field that ends where the kernel has.
pub(crate) fn refinement() -> CorrelativeParams {
    let coarse = CorrelativeParams::default();
    let kernel_sigma = 0.5 * coarse.kernel_sigma;
    CorrelativeParams {
        field: FieldParams { cell: 0.1, reach: 3.0 * kernel_sigma },
        kernel_sigma,
        effective_points: 2.0 * coarse.effective_points,
        step: 0.2,
        radius: 1.2,
        angle: 0.05,
        ..coarse
    }
}

/// Centroid of points; the origin if there are none.
pub(crate) fn centroid(points: &[Point2<f64>]) -> Vector2<f64> {
    let sum: Vector2<f64> = points.iter().map(|point| point.coords).sum();
    sum / points.len().max(1) as f64
}

/// Covariance, in the frame of the points, of a turn by `sigma` radians about their centroid.
pub(crate) fn turn_covariance(centroid: &Vector2<f64>, sigma: f64) -> Matrix3<f64> {
    let about = turn_about(centroid);
    sigma * sigma * about * about.transpose()
}

/// The motion of the frame, order x, y, theta, when what lies in it turns by 1 rad about `centroid`.
pub(crate) fn turn_about(centroid: &Vector2<f64>) -> Vector3<f64> {
    Isometry2::new(*centroid, 0.0).adjoint().column(2).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_about_the_centroid_leaves_it_where_it_is() {
        let center = centroid(&[Point2::new(14.0, 2.0), Point2::new(16.0, 4.0)]);
        assert_eq!(center, Vector2::new(15.0, 3.0));
        let step = 1e-6;
        let turned = Isometry2::identity().plus(&(turn_about(&center) * step));
        let moved = turned * Point2::from(center) - Point2::from(center);
        assert!(moved.norm() < 1e-10, "{moved}");
        assert!((turned.rotation.angle() - step).abs() < 1e-12);
        // one standard deviation of 0.01 rad fifteen metres ahead is 0.15 m to the side and 0.03 m along
        let covariance = turn_covariance(&center, 0.01);
        let expected = [0.03, 0.15, 0.01];
        for k in 0..3 {
            assert!((covariance[(k, k)].sqrt() - expected[k]).abs() < 1e-9, "{covariance}");
        }
        assert!(covariance[(0, 1)] < 0.0 && covariance[(1, 2)] < 0.0, "{covariance}");
    }
}

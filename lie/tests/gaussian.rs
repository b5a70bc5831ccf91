//! Gaussian poses: algebra by hand and errors.
use draco_lie::{Error, GaussianPose2, GaussianPose3, LieGroup, chi2};
use nalgebra::{Isometry2, Isometry3, Matrix3, Matrix6, Vector2, Vector3};

#[test]
fn a_turned_arm_swings_heading_noise_sideways() {
    // heading noise 0.01 rad at the start of a 10 m arm moves its tip 0.1 m sideways
    let start =
        GaussianPose2::from_deviations(Isometry2::identity(), &Vector3::new(1e-6, 1e-6, 0.01)).unwrap();
    let arm = GaussianPose2::exact(Isometry2::new(Vector2::new(10.0, 0.0), 0.0)).unwrap();
    let tip = start.compose(&arm);
    assert!((tip.covariance()[(1, 1)].sqrt() - 0.1).abs() < 1e-9);
    assert!((tip.covariance()[(1, 2)] - 10.0 * 1e-4).abs() < 1e-12);
}

#[test]
fn between_of_fully_correlated_poses_has_no_noise_left() {
    let a = GaussianPose3::from_deviations(
        Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5)),
        &nalgebra::Vector6::repeat(0.1),
    )
    .unwrap();
    let same = a.between_correlated(&a, a.covariance());
    assert!(same.covariance().norm() < 1e-15);
    assert!(same.mean().log().norm() < 1e-15);
}

#[test]
fn inverse_twice_is_the_same() {
    let a = GaussianPose3::new(
        Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5)),
        Matrix6::identity() * 0.01,
    )
    .unwrap();
    let back = a.inverse().inverse();
    assert!((back.covariance() - a.covariance()).norm() < 1e-15);
}

#[test]
fn bad_input_is_named() {
    let mean = Isometry2::identity();
    let mut m = Matrix3::identity();
    m[(1, 1)] = -1.0;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotPositiveDefinite { pivot: 1, .. })));
    m[(1, 1)] = f64::NAN;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotFinite { index: 4, .. })));
    m[(1, 1)] = 1.0;
    m[(0, 1)] = 0.5;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotSymmetric { row: 1, column: 0, .. })));
    let nowhere = Isometry2::new(Vector2::new(f64::INFINITY, 0.0), 0.0);
    assert!(matches!(GaussianPose2::exact(nowhere), Err(Error::NotFinite { index: 0, .. })));
    assert!(matches!(chi2::gate(-1.0, 0.9, 3), Err(Error::NegativeDistance { .. })));
    assert!(matches!(chi2::gate(1.0, 1.0, 3), Err(Error::Probability { .. })));
    assert!(matches!(chi2::gate(1.0, 0.5, 0), Err(Error::DegreesOfFreedom)));
    assert!(GaussianPose2::exact(mean).unwrap().mahalanobis_sq(&mean).is_err());
}

//! The first DRACo-SLAM's method on a scene it can solve.

use draco_registration::global::{Draco1Params, Draco1Rejection, draco1};
use draco_registration::{Cloud, Target};
use nalgebra::{Isometry2, Vector2};

/// Quay, corner block and three piles, 0.25 m spacing.
fn harbour() -> Vec<Vector2<f64>> {
    let mut points: Vec<_> = (0..80).map(|i| Vector2::new(0.25 * f64::from(i), 12.0)).collect();
    points.extend((0..24).map(|i| Vector2::new(20.0, 12.0 - 0.25 * f64::from(i))));
    for (x, y) in [(4.0, 3.0), (9.0, 5.5), (15.0, 2.0)] {
        points.extend((0..16).map(|i| {
            let a = f64::from(i) / 16.0 * std::f64::consts::TAU;
            Vector2::new(x + 0.8 * a.cos(), y + 0.8 * a.sin())
        }));
    }
    points
}

#[test]
fn draco1_finds_a_pose_far_from_its_start() {
    let truth = Isometry2::new(Vector2::new(4.0, -3.0), 0.6);
    let seen = harbour().iter().map(|p| truth.inverse_transform_point(&(*p).into()).coords).collect();
    let target = Target::new(&Cloud::new(harbour()).unwrap()).unwrap();
    let source = Cloud::new(seen).unwrap();
    let found = draco1(&target, &source, &Isometry2::identity(), &Draco1Params::default()).unwrap();
    let error = truth.inv_mul(&found.registration.target_from_source);
    assert_eq!(found.rejection, None);
    assert!(error.translation.vector.norm() < 0.2 && error.rotation.angle().abs() < 0.02, "{error}");
}

#[test]
fn draco1_names_the_gate_that_fails() {
    let target = Target::new(&Cloud::new(harbour()).unwrap()).unwrap();
    let run = |points: Vec<_>| {
        let source = Cloud::new(points).unwrap();
        draco1(&target, &source, &Isometry2::identity(), &Draco1Params::default()).unwrap().rejection
    };
    assert_eq!(run(harbour()[..50].to_vec()), Some(Draco1Rejection::FewPoints));
    let many = harbour().iter().cycle().take(400).copied().collect();
    assert_eq!(run(many), Some(Draco1Rejection::PointRatio));
    let apart = (0..100).map(|i| Vector2::new(1e3, f64::from(i))).collect();
    assert_eq!(run(apart), Some(Draco1Rejection::Overlap));
}

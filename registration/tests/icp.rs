//! Alignment on scenes whose answer is known by construction.

use std::f64::consts::TAU;

use draco_lie::LieGroup;
use draco_registration::{
    Cloud, Covariance, Error, IcpParams, Kernel, Matcher, Optimizer, Rejector, Residual, RigidMotion, Target,
    Termination,
};
use nalgebra::{Isometry2, Isometry3, Vector2, Vector3, Vector6};

/// An L-shaped wall and a round pile, sampled finely.
fn scene_2d() -> Vec<Vector2<f64>> {
    let mut points: Vec<_> = (0..120).map(|i| Vector2::new(0.05 * f64::from(i), 3.0)).collect();
    points.extend((0..80).map(|i| Vector2::new(6.0, 3.0 - 0.05 * f64::from(i))));
    points.extend((0..40).map(|i| {
        let a = f64::from(i) / 40.0 * TAU;
        Vector2::new(1.0 + 0.4 * a.cos(), 0.5 + 0.4 * a.sin())
    }));
    points
}

/// Three faces of a box.
fn scene_3d() -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for i in 0..25 {
        for j in 0..25 {
            let (a, b) = (0.1 * f64::from(i), 0.1 * f64::from(j));
            points.extend([Vector3::new(a, b, 0.0), Vector3::new(a, 0.0, b), Vector3::new(0.0, a, b)]);
        }
    }
    points
}

fn pull_back<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    points: &[nalgebra::SVector<f64, D>],
    truth: &G,
) -> Vec<nalgebra::SVector<f64, D>> {
    let inverse = truth.inverse();
    points.iter().map(|p| inverse.transform(p)).collect()
}

const RESIDUALS: [Residual; 4] =
    [Residual::PointToPoint, Residual::PointToPlane, Residual::Symmetric, Residual::PlaneToPlane];

fn exact_params() -> IcpParams {
    let mut params = IcpParams::sonar_2d();
    params.rejectors.clear();
    params.stop.max_iterations = 200;
    (params.stop.translation, params.stop.rotation) = (1e-12, 1e-12);
    params
}

#[test]
fn every_residual_and_optimizer_finds_the_exact_pose_in_2d() {
    let truth = Isometry2::new(Vector2::new(0.3, -0.2), 0.08);
    let target = Cloud::new(scene_2d()).unwrap().estimate_normals(5, &Vector2::new(3.0, 1.0)).unwrap();
    let source = Cloud::new(pull_back(&scene_2d(), &truth)).unwrap();
    let source =
        source.estimate_normals(5, &truth.inverse().transform_point(&[3.0, 1.0].into()).coords).unwrap();
    let target = Target::new(&target).unwrap();
    for residual in RESIDUALS {
        for optimizer in [Optimizer::GaussNewton, Optimizer::LevenbergMarquardt] {
            let params = IcpParams { residual, optimizer, ..exact_params() };
            let found = target.align(&source, &Isometry2::identity(), &params).unwrap();
            let error = found.target_from_source.minus(&truth).norm();
            assert!(error < tolerance_2d(residual), "{residual:?} {optimizer:?}: {error:e} {found:?}");
            assert!((found.overlap - 1.0).abs() < 1e-12);
            assert!(found.degenerate_directions.is_empty());
        }
    }
    let closed = IcpParams { optimizer: Optimizer::ClosedForm, ..exact_params() };
    let found = target.align(&source, &Isometry2::identity(), &closed).unwrap();
    assert!(found.target_from_source.minus(&truth).norm() < tolerance_2d(Residual::PointToPoint));
}

/// Point to point may rest in a local minimum half a point spacing (0.05 m) from the truth; the others may not.
fn tolerance_2d(residual: Residual) -> f64 {
    if residual == Residual::PointToPoint { 0.025 } else { 1e-9 }
}

#[test]
fn every_residual_finds_the_exact_pose_in_3d() {
    let truth = Isometry3::exp(&Vector6::new(0.05, -0.04, 0.03, 0.02, -0.03, 0.04));
    let view = Vector3::new(5.0, 5.0, 5.0);
    let target = Cloud::new(scene_3d()).unwrap().estimate_normals(9, &view).unwrap();
    let source = Cloud::new(pull_back(&scene_3d(), &truth)).unwrap();
    let source = source.estimate_normals(9, &truth.inverse().transform(&view)).unwrap();
    let target = Target::new(&target).unwrap();
    for residual in RESIDUALS {
        let params = IcpParams { residual, ..exact_params() };
        let found = target.align(&source, &Isometry3::identity(), &params).unwrap();
        let error = found.target_from_source.minus(&truth).norm();
        assert!(error < 1e-8, "{residual:?}: {error:e}");
    }
}

#[test]
fn every_kernel_and_rejector_survives_a_quarter_of_clutter() {
    let truth = Isometry2::new(Vector2::new(0.2, 0.1), -0.05);
    let target = Cloud::new(scene_2d()).unwrap().estimate_normals(5, &Vector2::new(3.0, 1.0)).unwrap();
    let target = Target::new(&target).unwrap();
    let mut seen = pull_back(&scene_2d(), &truth);
    seen.extend((0..60).map(|i| Vector2::new(2.5 + 0.02 * f64::from(i), 1.2 + 0.3 * f64::from(i % 4))));
    let source = Cloud::new(seen).unwrap().estimate_normals(5, &Vector2::new(3.0, 1.0)).unwrap();
    let scale = 0.1;
    let kernels = [
        Kernel::Cauchy { scale },
        Kernel::Tukey { scale: 4.0 * scale },
        Kernel::GemanMcClure { scale },
        Kernel::Welsch { scale: 2.0 * scale },
        Kernel::Huber { scale: 0.1 * scale },
    ];
    for kernel in kernels {
        let params = IcpParams { kernel, residual: Residual::PointToPlane, ..exact_params() };
        let found = target.align(&source, &Isometry2::identity(), &params).unwrap();
        assert!(found.target_from_source.minus(&truth).norm() < 0.02, "{kernel:?} {found:?}");
    }
    let rejectors = [
        Rejector::Distance { max: 0.3 },
        Rejector::Trimmed { keep: 0.75 },
        Rejector::VariableTrimmed { min_keep: 0.4, max_keep: 1.0, lambda: 2.0 },
    ];
    for rejector in rejectors {
        for matcher in [Matcher::Nearest, Matcher::Reciprocal] {
            let params = IcpParams {
                matcher,
                rejectors: vec![rejector],
                residual: Residual::PointToPlane,
                ..exact_params()
            };
            let found = target.align(&source, &Isometry2::identity(), &params).unwrap();
            assert!(
                found.target_from_source.minus(&truth).norm() < 0.02,
                "{rejector:?} {matcher:?} {found:?}"
            );
        }
    }
}

#[test]
fn a_single_line_slides_and_says_so() {
    let line: Vec<_> = (0..400).map(|i| Vector2::new(0.05 * f64::from(i) - 10.0, 1.0)).collect();
    let target = Cloud::new(line.clone()).unwrap().estimate_normals(5, &Vector2::zeros()).unwrap();
    let source = Cloud::new(line[100..300].iter().map(|p| p + Vector2::new(0.0, 0.2)).collect()).unwrap();
    let params = IcpParams { residual: Residual::PointToPlane, ..exact_params() };
    let found = Target::new(&target).unwrap().align(&source, &Isometry2::identity(), &params).unwrap();
    assert_eq!(found.degenerate_directions.len(), 1);
    assert!(found.degenerate_directions[0].x.abs() > 0.999_999);
    assert!((found.target_from_source.translation.y + 0.2).abs() < 1e-9);
    assert!((found.information * found.degenerate_directions[0]).norm() < 1e-6);
}

#[test]
fn spacing_covariance_follows_the_published_formula() {
    let target = Target::new(&Cloud::new(vec![Vector2::zeros(), Vector2::new(4.0, 0.0)]).unwrap()).unwrap();
    // both points miss by 0.3 m across: mean d² = 0.09, covariance 20 · 0.09
    let source = Cloud::new(vec![Vector2::new(0.0, 0.3), Vector2::new(4.0, -0.3)]).unwrap();
    let mut params = IcpParams::libpointmatcher_like();
    params.stop.max_iterations = 0;
    let found = target.align(&source, &Isometry2::identity(), &params).unwrap();
    assert_eq!(params.covariance, Covariance::Spacing { scale: 20.0, radius: 0.5 });
    assert!((found.covariance - nalgebra::Matrix3::identity() * 1.8).norm() < 1e-9);
    assert_eq!(found.termination, Termination::MaxIterations);
}

#[test]
fn no_pairs_is_told() {
    let target = Target::new(&Cloud::new(scene_2d()).unwrap()).unwrap();
    let far = Cloud::new(vec![Vector2::new(1e4, 0.0); 10]).unwrap();
    let found = target.align(&far, &Isometry2::identity(), &IcpParams::sonar_2d()).unwrap();
    assert_eq!((found.termination, found.overlap), (Termination::TooFewPairs, 0.0));
    assert_eq!(found.degenerate_directions.len(), 3);
}

#[test]
fn wrong_input_is_an_error() {
    let empty = Cloud::<2>::new(Vec::new()).unwrap();
    let one = Cloud::new(vec![Vector2::new(1.0, 2.0)]).unwrap();
    assert!(matches!(Target::new(&empty), Err(Error::TooFewPoints { .. })));
    let target = Target::new(&one).unwrap();
    let start = Isometry2::identity();
    assert!(matches!(target.align(&empty, &start, &IcpParams::sonar_2d()), Err(Error::TooFewPoints { .. })));
    assert!(matches!(
        target.align(&one, &start, &IcpParams::lidar_3d()),
        Err(Error::MissingNormals { what: "target" })
    ));
    let bad = Isometry2::new(Vector2::new(f64::NAN, 0.0), 0.0);
    assert!(matches!(target.align(&one, &bad, &IcpParams::sonar_2d()), Err(Error::NonFinite { .. })));
    let params = IcpParams { max_distance: -1.0, ..IcpParams::sonar_2d() };
    assert!(matches!(
        target.align(&one, &start, &params),
        Err(Error::Parameter { name: "max_distance", .. })
    ));
}

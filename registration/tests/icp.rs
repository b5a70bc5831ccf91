//! Alignment on scenes whose answer is known by construction.

use std::f64::consts::TAU;

use draco_lie::LieGroup;
use draco_registration::{
    Cloud, Covariance, Error, IcpParams, Kernel, Matcher, Optimizer, RangeBearingNoise, Rejector, Residual,
    RigidMotion, Target, Termination, starts_around,
};
use nalgebra::{Isometry2, Isometry3, Matrix2, Vector2, Vector3, Vector6};

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

#[test]
fn mahalanobis_with_round_covariances_is_point_to_point() {
    let truth = Isometry2::new(Vector2::new(0.3, -0.2), 0.08);
    let seen = pull_back(&scene_2d(), &truth);
    let round = |points: &[Vector2<f64>]| {
        Cloud::new(points.to_vec())
            .unwrap()
            .with_covariances(vec![Matrix2::identity() * 0.25; points.len()])
            .unwrap()
    };
    let (target, source) = (Target::new(&round(&scene_2d())).unwrap(), round(&seen));
    let run = |residual| {
        let params = IcpParams { residual, ..exact_params() };
        target.align(&source, &Isometry2::identity(), &params).unwrap()
    };
    let (weighted, plain) = (run(Residual::Mahalanobis), run(Residual::PointToPoint));
    assert!(weighted.target_from_source.minus(&plain.target_from_source).norm() < 1e-9);
    // the noise of a residual coordinate is told in standard deviations: both covariances add to half a square metre
    assert!((weighted.residuals.sigma * 0.5f64.sqrt() - plain.residuals.sigma).abs() < 1e-9);
}

#[test]
fn told_the_noise_of_range_and_bearing_the_error_falls_by_half() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    let noise = RangeBearingNoise { range_sigma: 0.02, bearing_sigma: 0.02 };
    let normal = |sigma| Normal::new(0.0, sigma).unwrap();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let beams: Vec<(f64, f64)> =
        (0..14).map(|i| (2.0 + 3.0 * f64::from(i), -1.0 + 0.15 * f64::from(5 * i % 14))).collect();
    let mut scan = || -> Vec<Vector2<f64>> {
        let seen = |&(r, b): &(f64, f64)| {
            let (r, b) = (r + normal(0.02).sample(&mut rng), b + normal(0.02).sample(&mut rng));
            Vector2::new(r * b.cos(), r * b.sin())
        };
        beams.iter().map(seen).collect()
    };
    let (mut weighted, mut plain) = (0.0, 0.0);
    for _ in 0..100 {
        let ready = |points: Vec<Vector2<f64>>| {
            let covariances = noise.covariances(&points).unwrap();
            Cloud::new(points).unwrap().with_covariances(covariances).unwrap()
        };
        let (target, source) = (Target::new(&ready(scan())).unwrap(), ready(scan()));
        let error = |residual| {
            let params = IcpParams { residual, max_distance: 10.0, ..exact_params() };
            let found = target.align(&source, &Isometry2::identity(), &params).unwrap();
            found.target_from_source.translation.vector.norm_squared()
        };
        weighted += error(Residual::Mahalanobis);
        plain += error(Residual::PointToPoint);
    }
    assert!(weighted < 0.25 * plain, "{weighted} {plain}");
}

#[test]
fn covariances_are_checked_and_needed() {
    let points = scene_2d();
    let cloud = Cloud::new(points.clone()).unwrap();
    let params = IcpParams { residual: Residual::Mahalanobis, ..exact_params() };
    let target = Target::new(&cloud).unwrap();
    assert_eq!(target.align(&cloud, &Isometry2::identity(), &params).unwrap_err(), Error::MissingCovariances);
    let with = |c: Matrix2<f64>| cloud.clone().with_covariances(vec![c; points.len()]);
    assert!(matches!(with(Matrix2::new(1.0, 0.0, 0.0, -1.0)), Err(Error::NotPositiveDefinite { .. })));
    assert!(matches!(with(Matrix2::new(1.0, f64::NAN, 0.0, 1.0)), Err(Error::NonFinite { .. })));
    assert!(matches!(cloud.clone().with_covariances(vec![]), Err(Error::LengthMismatch { found: 0, .. })));
    let estimated = cloud.estimate_covariances(8, 0.01).unwrap();
    let found = target.align(&estimated, &Isometry2::identity(), &params).unwrap();
    assert!(found.target_from_source.log().norm() < 1e-9);
}

#[test]
fn many_starts_find_what_one_misses_and_rank_it_first() {
    let truth = Isometry2::new(Vector2::new(6.0, -5.0), 2.5);
    let target = Target::new(&Cloud::new(scene_2d()).unwrap()).unwrap();
    let source = Cloud::new(pull_back(&scene_2d(), &truth)).unwrap();
    let params = IcpParams { max_distance: 2.0, overlap_radius: 0.1, ..exact_params() };
    let one = target.align(&source, &Isometry2::identity(), &params).unwrap();
    assert!(one.target_from_source.minus(&truth).norm() > 0.3, "{one:?}");
    let starts = starts_around(&Isometry2::identity(), &Vector3::new(8.0, 8.0, 3.0), &[7, 7, 7]).unwrap();
    assert_eq!((starts.len(), starts[0]), (343, Isometry2::identity()));
    let found = target.align_from(&source, &starts, &params).unwrap();
    let best = found.best();
    assert!(best.registration.target_from_source.minus(&truth).norm() < 0.1, "{best:?}");
    assert!(best.support > 0.9 && found.ambiguity().unwrap() < 0.8);
    assert!(found.modes.windows(2).all(|w| w[0].support >= w[1].support));
    assert!(matches!(
        target.align_from::<3, Isometry2<f64>>(&source, &[], &params),
        Err(Error::TooFewPoints { .. })
    ));
}

#[test]
fn stages_of_shrinking_reach_find_what_the_last_alone_misses() {
    let truth = Isometry2::new(Vector2::new(0.9, -0.4), 0.1);
    let target = Target::new(&Cloud::new(scene_2d()).unwrap()).unwrap();
    let source = Cloud::new(pull_back(&scene_2d(), &truth)).unwrap();
    let fine = IcpParams { max_distance: 0.25, ..exact_params() };
    let stages = fine.coarse_to_fine(2.0);
    assert_eq!(stages.iter().map(|s| s.max_distance).collect::<Vec<_>>(), [2.0, 1.0, 0.5, 0.25]);
    assert_eq!(stages[3], fine);
    let start = Isometry2::identity();
    let alone = target.align(&source, &start, &fine).unwrap();
    let staged = target.align_in_stages(&source, &start, &stages).unwrap();
    assert!(alone.target_from_source.minus(&truth).norm() > 0.1, "{alone:?}");
    assert!(staged.target_from_source.minus(&truth).norm() < 0.03, "{staged:?}");
    assert!(staged.iterations > stages.len());
}

//! What must hold for any scans: inverse, shift, permutation, chains and degenerate sets.

use draco_lie::LieGroup;
use draco_registration::{Cloud, Error, IcpParams, Registration, Residual, StopRule, Target, Termination};
use nalgebra::{Isometry2, Isometry3, Vector2, Vector3, Vector6};
use proptest::prelude::*;

/// A room corner with a column, with a fixed ripple as noise.
fn scene(count: usize) -> Vec<Vector2<f64>> {
    (0..count)
        .map(|i| {
            let s = 12.0 * i as f64 / count as f64;
            let ripple = 0.01 * (37.0 * s).sin();
            match s {
                s if s < 5.0 => Vector2::new(s, 3.0 + ripple),
                s if s < 8.0 => Vector2::new(5.0 + ripple, 8.0 - s),
                s => Vector2::new(1.0 + 0.5 * (1.6 * s).cos(), 1.0 + (0.5 + ripple) * (1.6 * s).sin()),
            }
        })
        .collect()
}

fn exact() -> IcpParams {
    let stop = StopRule { max_iterations: 200, translation: 1e-13, rotation: 1e-13, window: 1 };
    IcpParams { stop, rejectors: Vec::new(), ..IcpParams::laser_2d() }
}

fn cloud(points: Vec<Vector2<f64>>, view: Vector2<f64>) -> Cloud<2> {
    Cloud::new(points).unwrap().estimate_normals(6, &view).unwrap()
}

fn moved(points: &[Vector2<f64>], pose: &Isometry2<f64>) -> Vec<Vector2<f64>> {
    points.iter().map(|p| pose.transform_point(&(*p).into()).coords).collect()
}

fn align(target: &Cloud<2>, source: &Cloud<2>, start: &Isometry2<f64>) -> Registration<Isometry2<f64>, 3> {
    Target::new(target).unwrap().align(source, start, &exact()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn swapping_the_scans_inverts_the_answer(x in -0.2..0.2f64, y in -0.2..0.2f64, a in -0.1..0.1f64) {
        let truth = Isometry2::new(Vector2::new(x, y), a);
        let target = cloud(scene(240), Vector2::new(3.0, 1.0));
        let seen = moved(&scene(240), &truth.inverse());
        let source = cloud(seen, truth.inverse_transform_point(&[3.0, 1.0].into()).coords);
        let there = align(&target, &source, &Isometry2::identity());
        let back = align(&source, &target, &Isometry2::identity());
        prop_assert!((there.target_from_source * back.target_from_source).log().norm() < 1e-9);
        prop_assert!(there.target_from_source.minus(&truth).norm() < 1e-9);
    }

    #[test]
    fn a_million_metres_away_the_answer_is_the_same(x in -0.2..0.2f64, a in -0.1..0.1f64, k in 0usize..4) {
        let shift = [Vector2::new(1e6, 0.0), Vector2::new(-1e6, 1e6), Vector2::new(0.0, -1e6), Vector2::zeros()][k];
        let far = Isometry2::new(shift, 0.0);
        let truth = Isometry2::new(Vector2::new(x, 0.1), a);
        let (target, seen) = (scene(240), moved(&scene(240), &truth.inverse()));
        let near = align(&cloud(target.clone(), Vector2::zeros()), &cloud(seen.clone(), Vector2::zeros()), &Isometry2::identity());
        let away = align(
            &cloud(moved(&target, &far), shift),
            &cloud(moved(&seen, &far), shift),
            &Isometry2::identity(),
        );
        // the same motion, seen from a frame whose origin is far: compare what it does to the scan
        for p in seen.iter().step_by(40) {
            let here = near.target_from_source.transform_point(&(*p).into()).coords;
            let there = away.target_from_source.transform_point(&(p + shift).into()).coords - shift;
            prop_assert!((here - there).norm() < 1e-3, "{}", (here - there).norm());
        }
    }

    #[test]
    fn the_order_of_the_points_does_not_matter(seed in 0u64..1000) {
        use rand::{SeedableRng, seq::SliceRandom};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let start = Isometry2::new(Vector2::new(0.1, -0.1), 0.05);
        let (mut target, mut source) = (scene(240), moved(&scene(200), &Isometry2::new(Vector2::new(0.2, 0.0), 0.1)));
        let first = align(&cloud(target.clone(), Vector2::zeros()), &cloud(source.clone(), Vector2::zeros()), &start);
        target.shuffle(&mut rng);
        source.shuffle(&mut rng);
        let second = align(&cloud(target, Vector2::zeros()), &cloud(source, Vector2::zeros()), &start);
        prop_assert!(first.target_from_source.minus(&second.target_from_source).norm() < 1e-9);
        prop_assert!((first.covariance - second.covariance).norm() < 1e-6 * first.covariance.norm());
    }
}

#[test]
fn identical_clouds_stay_where_they_are() {
    let same = cloud(scene(240), Vector2::zeros());
    let found = align(&same, &same, &Isometry2::identity());
    assert!(found.target_from_source.log().norm() < 1e-12);
    assert_eq!((found.overlap, found.iterations, found.termination), (1.0, 1, Termination::Converged));
    assert!(found.covariance.iter().all(|v| v.is_finite()));
}

#[test]
fn one_point_and_equal_points_give_an_answer_that_claims_nothing() {
    for count in [1, 50] {
        let same = Cloud::new(vec![Vector2::new(2.0, 1.0); count]).unwrap();
        let params = IcpParams { residual: Residual::PointToPoint, ..exact() };
        let found = Target::new(&same).unwrap().align(&same, &Isometry2::identity(), &params).unwrap();
        assert!(found.target_from_source.log().norm() < 1e-12);
        assert!(found.is_degenerate(), "rotation cannot be known: {found:?}");
    }
}

#[test]
fn a_long_chain_of_answers_stays_a_rotation() {
    let target = cloud(scene(60), Vector2::zeros());
    let step = |k: i32| {
        let turn = Isometry2::new(Vector2::new(0.01, 0.0), 0.005 * f64::from(k));
        align(&target, &cloud(moved(&scene(60), &turn), Vector2::zeros()), &Isometry2::identity())
            .target_from_source
    };
    let steps: Vec<_> = (-4..5).map(step).collect();
    let mut pose = Isometry2::identity();
    for k in 0..100_000 {
        pose = pose.compose(&steps[k % steps.len()]);
    }
    let r = pose.rotation.to_rotation_matrix().into_inner();
    assert!((r.transpose() * r - nalgebra::Matrix2::identity()).norm() < 1e-13);
    let again = align(&target, &cloud(scene(60), Vector2::zeros()), &steps[0]);
    assert!((again.target_from_source.rotation.norm() - 1.0).abs() < 1e-15);
}

#[test]
fn the_same_call_twice_gives_the_same_bits() {
    let (target, source) = (cloud(scene(240), Vector2::zeros()), cloud(scene(200), Vector2::zeros()));
    let start = Isometry2::new(Vector2::new(0.1, -0.1), 0.05);
    assert_eq!(align(&target, &source, &start), align(&target, &source, &start));
}

const RESIDUALS: [Residual; 4] =
    [Residual::PointToPoint, Residual::PointToPlane, Residual::Symmetric, Residual::PlaneToPlane];

fn with(residual: Residual) -> IcpParams {
    IcpParams { residual, ..exact() }
}

/// A bent sheet with a pole, uneven enough to fix all six directions.
fn scene_3d() -> Vec<Vector3<f64>> {
    (0..900)
        .map(|i| {
            let (u, v) = (f64::from(i % 30) / 5.0, f64::from(i / 30) / 5.0);
            match i % 30 {
                0..20 => Vector3::new(u, v, 0.3 * (1.3 * u).sin() + 0.2 * (0.9 * v).cos()),
                _ => Vector3::new(5.0 + 0.4 * (2.0 * v).sin(), v, u - 4.0),
            }
        })
        .collect()
}

fn cloud_3d(points: Vec<Vector3<f64>>, view: &Vector3<f64>) -> Cloud<3> {
    Cloud::new(points).unwrap().estimate_normals(8, view).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn in_space_inverse_shift_and_order_hold_for_every_residual(
        xi in prop::array::uniform6(-0.03..0.03f64),
        seed in 0u64..1000,
    ) {
        use rand::{SeedableRng, seq::SliceRandom};
        let view = Vector3::new(2.0, 2.0, 8.0);
        let truth = Isometry3::exp(&Vector6::from(xi));
        let target = scene_3d();
        let seen: Vec<_> = target.iter().map(|p| truth.inverse_transform_point(&(*p).into()).coords).collect();
        let source_view = truth.inverse_transform_point(&view.into()).coords;
        let run = |target: &[Vector3<f64>], source: &[Vector3<f64>], shift: Vector3<f64>, residual| {
            let moved = |points: &[Vector3<f64>]| points.iter().map(|p| p + shift).collect::<Vec<_>>();
            let ready = Target::new(&cloud_3d(moved(target), &(view + shift))).unwrap();
            ready.align(&cloud_3d(moved(source), &(source_view + shift)), &Isometry3::identity(), &with(residual)).unwrap()
        };
        for residual in RESIDUALS {
            let there = run(&target, &seen, Vector3::zeros(), residual).target_from_source;
            // points nearest by chance may hold a point-to-point fit within a spacing of the truth
            let tolerance = if residual == Residual::PointToPoint { 0.1 } else { 1e-7 };
            prop_assert!(there.minus(&truth).norm() < tolerance, "{residual:?} {}", there.minus(&truth).norm());
            let back = {
                let ready = Target::new(&cloud_3d(seen.clone(), &source_view)).unwrap();
                ready.align(&cloud_3d(target.clone(), &view), &Isometry3::identity(), &with(residual)).unwrap()
            };
            prop_assert!((there * back.target_from_source).log().norm() < 2.0 * tolerance, "{residual:?}");
            let shift = Vector3::new(1e6, -1e6, 1e6);
            let away = run(&target, &seen, shift, residual).target_from_source;
            for p in seen.iter().step_by(150) {
                let here = there.transform_point(&(*p).into()).coords;
                let far = away.transform_point(&(p + shift).into()).coords - shift;
                prop_assert!((here - far).norm() < 1e-3, "{residual:?} {}", (here - far).norm());
            }
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let (mut other_target, mut other_seen) = (target.clone(), seen.clone());
            other_target.shuffle(&mut rng);
            other_seen.shuffle(&mut rng);
            let again = run(&other_target, &other_seen, Vector3::zeros(), residual).target_from_source;
            prop_assert!(there.minus(&again).norm() < 1e-9, "{residual:?} {:e}", there.minus(&again).norm());
        }
    }

    #[test]
    fn with_noise_there_and_back_agree_within_their_covariances(seed in 0u64..1000) {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut noisy = |points: Vec<Vector2<f64>>| -> Vec<Vector2<f64>> {
            points.iter().map(|p| p + Vector2::new(rng.random_range(-0.02..0.02), rng.random_range(-0.02..0.02))).collect()
        };
        let truth = Isometry2::new(Vector2::new(0.1, -0.05), 0.04);
        let view = Vector2::new(3.0, 1.0);
        let target = cloud(noisy(scene(300)), view);
        let source = cloud(noisy(moved(&scene(280), &truth.inverse())), truth.inverse_transform_point(&view.into()).coords);
        for residual in RESIDUALS {
            let params = IcpParams { residual, ..IcpParams::laser_2d() };
            let there = Target::new(&target).unwrap().align(&source, &Isometry2::identity(), &params).unwrap();
            let back = Target::new(&source).unwrap().align(&target, &Isometry2::identity(), &params).unwrap();
            let loop_error = (there.target_from_source * back.target_from_source).log();
            let sigma = (there.covariance.trace() + back.covariance.trace()).sqrt();
            prop_assert!(loop_error.norm() < 4.0 * sigma, "{residual:?}: {} of {sigma}", loop_error.norm());
        }
    }
}

#[test]
fn degenerate_sets_are_answered_by_every_residual() {
    let line: Vec<_> = (0..80).map(|i| Vector2::new(0.1 * f64::from(i), 2.0)).collect();
    let sets = [vec![Vector2::new(1.0, 2.0)], vec![Vector2::new(1.0, 2.0); 30], line];
    for points in sets {
        for residual in RESIDUALS {
            let same = cloud(points.clone(), Vector2::zeros());
            let found =
                Target::new(&same).unwrap().align(&same, &Isometry2::identity(), &with(residual)).unwrap();
            assert!(found.target_from_source.log().norm() < 1e-12, "{residual:?} {found:?}");
            assert!(found.covariance.iter().all(|v| v.is_finite()), "{residual:?}");
            // equal points hold a line against a slide where the residual counts what lies along it
            let slides =
                points.len() < 80 || matches!(residual, Residual::PointToPlane | Residual::Symmetric);
            assert_eq!(found.is_degenerate(), slides, "{residual:?} {} points", points.len());
        }
    }
}

#[test]
fn empty_sets_and_numbers_that_are_none_are_errors() {
    let empty = Cloud::<2>::new(Vec::new()).unwrap();
    let some = cloud(scene(60), Vector2::zeros());
    let start = Isometry2::identity();
    assert!(matches!(Target::new(&empty), Err(Error::TooFewPoints { .. })));
    let target = Target::new(&some).unwrap();
    for residual in RESIDUALS {
        let none = target.align(
            &empty.clone().estimate_normals(5, &Vector2::zeros()).unwrap(),
            &start,
            &with(residual),
        );
        assert!(matches!(none, Err(Error::TooFewPoints { .. })));
        for bad in [f64::NAN, f64::INFINITY] {
            let start = Isometry2::new(Vector2::new(bad, 0.0), 0.0);
            assert!(matches!(target.align(&some, &start, &with(residual)), Err(Error::NonFinite { .. })));
        }
    }
    for bad in [f64::NAN, f64::NEG_INFINITY] {
        let mut points = scene(10);
        points[7].y = bad;
        assert_eq!(Cloud::new(points).unwrap_err(), Error::NonFinitePoint { index: 7 });
    }
}

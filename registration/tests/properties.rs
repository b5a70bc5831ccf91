//! What must hold for any scans: inverse, shift, permutation, chains and degenerate sets.

use draco_lie::LieGroup;
use draco_registration::{Cloud, IcpParams, Registration, Residual, StopRule, Target, Termination};
use nalgebra::{Isometry2, Vector2};
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
    let source = cloud(moved(&scene(60), &Isometry2::new(Vector2::new(0.01, 0.0), 0.02)), Vector2::zeros());
    let step = align(&target, &source, &Isometry2::identity()).target_from_source;
    let mut pose = Isometry2::identity();
    for _ in 0..100_000 {
        pose = pose.compose(&step).renormalize();
    }
    assert!((pose.rotation.norm() - 1.0).abs() < 1e-14);
    let again = align(&target, &source, &step);
    assert!((again.target_from_source.rotation.norm() - 1.0).abs() < 1e-15);
}

#[test]
fn the_same_call_twice_gives_the_same_bits() {
    let (target, source) = (cloud(scene(240), Vector2::zeros()), cloud(scene(200), Vector2::zeros()));
    let start = Isometry2::new(Vector2::new(0.1, -0.1), 0.05);
    assert_eq!(align(&target, &source, &start), align(&target, &source, &start));
}

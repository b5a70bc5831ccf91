//! Branch and bound against a dense grid that shares none of its code.

use std::f64::consts::PI;

use draco_registration::global::{
    NearStartParams, Pivot, SearchParams, align_near_start, branch_and_bound_2d,
};
use draco_registration::{Cloud, Target};
use nalgebra::{Isometry2, Vector2};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `mean min(d, τ)²` by brute force.
fn cost(target: &[Vector2<f64>], source: &[Vector2<f64>], pose: &Isometry2<f64>, tau: f64) -> f64 {
    let one = |p: &Vector2<f64>| {
        let x = pose.transform_point(&(*p).into()).coords;
        target.iter().map(|q| (q - x).norm_squared()).fold(tau * tau, f64::min)
    };
    source.iter().map(one).sum::<f64>() / source.len() as f64
}

fn random_points(rng: &mut ChaCha8Rng, n: usize) -> Vec<Vector2<f64>> {
    (0..n).map(|_| Vector2::new(rng.random_range(-2.0..2.0), rng.random_range(-2.0..2.0))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn no_pose_of_a_dense_grid_beats_the_certificate(seed in 0u64..1000) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (target, source) = (random_points(&mut rng, 12), random_points(&mut rng, 8));
        // a scene of so few points may need more boxes than the default grants
        let params = SearchParams { translation: 1.0, rotation: PI, truncation: 0.8, gap: 0.02, max_nodes: 5_000_000, ..SearchParams::default() };
        let built = Target::new(&Cloud::new(target.clone()).unwrap()).unwrap();
        let found = branch_and_bound_2d(&built, &Cloud::new(source.clone()).unwrap(), &Isometry2::identity(), &params).unwrap();
        let best = found.best();
        prop_assert!(best.certified);
        prop_assert!((best.cost - cost(&target, &source, &best.target_from_source, 0.8)).abs() < 1e-9);
        prop_assert!(best.cost - best.lower_bound <= 0.02 * 0.64 + 1e-12);
        let centroid: Vector2<f64> = source.iter().sum::<Vector2<f64>>() / 8.0;
        for turn in 0..72 {
            let angle = f64::from(turn) / 72.0 * 2.0 * PI;
            for i in -12..=12 {
                for j in -12..=12 {
                    let shift = Vector2::new(f64::from(i), f64::from(j)) / 12.0;
                    let turned = Isometry2::rotation(angle).transform_point(&centroid.into()).coords;
                    let pose = Isometry2::new(centroid + shift - turned, angle);
                    let there = cost(&target, &source, &pose, 0.8);
                    prop_assert!(there >= best.lower_bound - 1e-9, "{there} < {}", best.lower_bound);
                }
            }
        }
    }
}

#[test]
fn no_pose_within_reach_of_the_sensors_start_beats_the_certificate() {
    for seed in 0..6 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // far from the source's origin, so that a turn carries the points farther than the box is wide
        let arm = Vector2::new(6.0, 2.0);
        let target: Vec<_> = random_points(&mut rng, 12).iter().map(|p| p + arm).collect();
        let source: Vec<_> = random_points(&mut rng, 8).iter().map(|p| p + arm).collect();
        let start = Isometry2::new(Vector2::new(0.1, -0.2), 0.1);
        let params = SearchParams {
            translation: 0.4,
            rotation: 0.5,
            pivot: Pivot::Origin,
            truncation: 0.8,
            gap: 0.02,
            ..SearchParams::default()
        };
        let built = Target::new(&Cloud::new(target.clone()).unwrap()).unwrap();
        let found =
            branch_and_bound_2d(&built, &Cloud::new(source.clone()).unwrap(), &start, &params).unwrap();
        let best = found.best();
        assert!(best.certified);
        let moved = best.target_from_source.translation.vector - start.translation.vector;
        assert!(moved.amax() <= 0.4 + 1e-9, "{moved}");
        assert!(start.rotation.angle_to(&best.target_from_source.rotation) <= 0.5 + 1e-9);
        for turn in -40..=40 {
            for i in -8..=8 {
                for j in -8..=8 {
                    let shift = Vector2::new(f64::from(i), f64::from(j)) / 20.0;
                    let pose = Isometry2::new(start.translation.vector + shift, 0.1 + f64::from(turn) / 80.0);
                    let there = cost(&target, &source, &pose, 0.8);
                    assert!(there >= best.lower_bound - 1e-9, "{there} < {}", best.lower_bound);
                }
            }
        }
    }
}

#[test]
fn a_wrong_heading_may_carry_the_points_farther_than_the_start_is_off() {
    // an open box ten metres ahead; half a radian moves it by five metres
    let target: Vec<_> = (0..240)
        .map(|i| match i {
            i if i < 80 => Vector2::new(10.0 + 0.05 * f64::from(i), -2.0),
            i if i < 160 => Vector2::new(14.0, -2.0 + 0.05 * f64::from(i - 80)),
            i => Vector2::new(14.0 - 0.03 * f64::from(i - 160), 2.0),
        })
        .collect();
    let truth = Isometry2::new(Vector2::new(0.3, -0.2), 0.2);
    let source = target.iter().map(|q| truth.inverse_transform_point(&(*q).into()).coords).collect();
    let ready = |points: Vec<_>| Cloud::new(points).unwrap().estimate_normals(8, &Vector2::zeros()).unwrap();
    let start = truth * Isometry2::new(Vector2::new(-0.3, 0.3), 0.45);
    let params = NearStartParams::laser_2d(0.5);
    let found =
        align_near_start(&Target::new(&ready(target)).unwrap(), &ready(source), &start, &params).unwrap();
    let error = truth.inverse() * found.target_from_source;
    assert!(error.translation.vector.norm() < 1e-2 && error.rotation.angle().abs() < 1e-3, "{error}");
}

#[test]
fn a_repeated_row_has_a_rival_and_a_lone_shape_has_none() {
    // piles every 2 m: a shift by one pile fits five of six
    let piles: Vec<_> = (0..6)
        .flat_map(|k| {
            (0..8).map(move |i| {
                let a = f64::from(i) / 8.0 * 2.0 * PI;
                Vector2::new(2.0 * f64::from(k) + 0.2 * a.cos(), 0.2 * a.sin())
            })
        })
        .collect();
    let params =
        SearchParams { translation: 3.0, rotation: 0.3, modes: 2, gap: 0.02, ..SearchParams::default() };
    let run = |points: &[Vector2<f64>]| {
        let cloud = Cloud::new(points.to_vec()).unwrap();
        branch_and_bound_2d(&Target::new(&cloud).unwrap(), &cloud, &Isometry2::identity(), &params).unwrap()
    };
    let row = run(&piles);
    assert!(row.best().score > 0.97);
    assert!((row.modes[1].target_from_source.translation.x.abs() - 2.0).abs() < 0.1);
    assert!((row.ambiguity().unwrap() - 5.0 / 6.0).abs() < 0.05);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let lone = random_points(&mut rng, 60);
    assert!(run(&lone).ambiguity().unwrap() < 0.7);
}

#[test]
fn trimming_ignores_the_share_that_does_not_fit() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let target = random_points(&mut rng, 60);
    let truth = Isometry2::new(Vector2::new(1.5, -0.7), 2.0);
    let mut source: Vec<_> =
        target.iter().map(|q| truth.inverse_transform_point(&(*q).into()).coords).collect();
    source.extend((0..30).map(|i| Vector2::new(20.0 + f64::from(i), 20.0)));
    let built = Target::new(&Cloud::new(target).unwrap()).unwrap();
    let params = SearchParams { translation: 30.0, keep: 0.6, ..SearchParams::default() };
    let found =
        branch_and_bound_2d(&built, &Cloud::new(source).unwrap(), &Isometry2::identity(), &params).unwrap();
    assert!(found.best().certified);
    assert!(
        (found.best().target_from_source.inverse() * truth).translation.vector.norm() < 1e-3,
        "{found:?}"
    );
}

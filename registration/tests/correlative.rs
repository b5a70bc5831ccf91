//! The correlative matcher against a posterior summed by brute force, and whole maps against known transforms.

use draco_lie::LieGroup;
use draco_registration::correlative::{
    CorrelativeParams, FieldParams, MapAlignmentParams, Start, Target, align_maps,
};
use nalgebra::{Isometry2, Matrix3, Point2, Vector3};
use proptest::prelude::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Points every half metre along a closed outline with corners, so that the pose is determined.
fn harbour(rng: &mut impl Rng, count: usize) -> Vec<Point2<f64>> {
    let mut points = Vec::new();
    let corners: Vec<Point2<f64>> = (0..count)
        .map(|_| Point2::new(rng.random_range(-30.0..30.0), rng.random_range(-25.0..25.0)))
        .collect();
    for pair in corners.windows(2) {
        let length = (pair[1] - pair[0]).norm();
        let steps = (length.min(15.0) / 0.5) as usize;
        for k in 0..steps {
            points.push(pair[0] + (pair[1] - pair[0]) * (k as f64 * 0.5 / length));
        }
    }
    points
}

fn apply(pose: &Isometry2<f64>, points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    points.iter().map(|p| pose * p).collect()
}

/// Posterior mean (as a pose) and covariance by nearest-neighbour search over a fine lattice of poses in the tangent
/// space at the start: no distance field, no centroid, no body-frame transport.
fn brute_force(
    target: &[Point2<f64>],
    source: &[Point2<f64>],
    start: &Start,
    params: &CorrelativeParams,
) -> (Isometry2<f64>, Matrix3<f64>) {
    let information = start.covariance.unwrap().try_inverse().unwrap();
    let middle =
        source.iter().fold(nalgebra::Vector2::zeros(), |sum, p| sum + p.coords) / source.len() as f64;
    let placed = start.target_from_source * Point2::from(middle);
    let (mut peak, mut samples) = (f64::NEG_INFINITY, Vec::new());
    let cells = |half: f64, step: f64| {
        let n = (half / step).round() as i32;
        (-n..=n).map(move |k| f64::from(k) * step)
    };
    for turn in cells(params.angle, 0.01) {
        for dx in cells(params.radius, 0.25) {
            for dy in cells(params.radius, 0.25) {
                let rotation = nalgebra::Rotation2::new(turn);
                let about = Isometry2::new(placed - rotation * placed, turn);
                let pose = Isometry2::translation(dx, dy) * about * start.target_from_source;
                let score = source
                    .iter()
                    .map(|p| {
                        let p = pose * p;
                        let d = target.iter().map(|q| (q - p).norm_squared()).fold(f64::INFINITY, f64::min);
                        (-0.5 * d / params.kernel_sigma.powi(2)).exp()
                    })
                    .sum::<f64>()
                    / source.len() as f64;
                let xi = pose.minus(&start.target_from_source);
                let log =
                    params.effective_points * (params.floor + score).ln() - 0.5 * xi.dot(&(information * xi));
                peak = peak.max(log);
                samples.push((pose, log));
            }
        }
    }
    let best = samples.iter().find(|(_, log)| *log == peak).unwrap().0;
    let (mut weight, mut mean) = (0.0, Vector3::zeros());
    for (pose, log) in &samples {
        weight += (log - peak).exp();
        mean += (log - peak).exp() * pose.minus(&best);
    }
    let mean = best.plus(&(mean / weight));
    let covariance = samples
        .iter()
        .map(|(pose, log)| (log - peak).exp() / weight * pose.minus(&mean) * pose.minus(&mean).transpose())
        .sum();
    (mean, covariance)
}

#[test]
fn posterior_agrees_with_brute_force() {
    let params = CorrelativeParams {
        radius: 2.0,
        angle: 0.06,
        step: 0.25,
        extra_sigma: 0.0,
        extra_sigma_angle: 0.0,
        far_distance: 100.0,
        far_angle: 10.0,
        field: FieldParams { cell: 0.125, reach: 6.0 },
        ..CorrelativeParams::default()
    };
    for seed in 0..3 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let target = harbour(&mut rng, 5);
        let truth = Isometry2::new([3.0, -4.0].into(), -2.1 + seed as f64);
        let source: Vec<_> = apply(&truth.inverse(), &target).into_iter().step_by(4).collect();
        let off = Isometry2::new([0.6, -0.4].into(), 0.02);
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.5, 0.3, 0.002));
        let start = Start { target_from_source: truth * off, covariance: Some(covariance) };
        let found = Target::new(&target, &params).unwrap().locate(&source, &start).unwrap();
        let (mean, expected) = brute_force(&target, &source, &start, &params);
        // Cells of 0.125 m and the different lattices in heading leave a few centimetres.
        let difference = found.target_from_source.minus(&mean);
        assert!(difference.xy().norm() < 0.06 && difference.z.abs() < 0.003, "seed {seed}: {difference}");
        let deviation = |c: &Matrix3<f64>| c.diagonal().map(f64::sqrt);
        let (ours, theirs) = (deviation(&found.covariance), deviation(&expected));
        for k in 0..3 {
            let ratio = ours[k] / theirs[k];
            assert!((0.85..1.18).contains(&ratio), "seed {seed}: deviations {ours} against {theirs}");
            for l in 0..k {
                let correlation = |c: &Matrix3<f64>| c[(k, l)] / (c[(k, k)] * c[(l, l)]).sqrt();
                assert!(
                    (correlation(&found.covariance) - correlation(&expected)).abs() < 0.15,
                    "seed {seed}"
                );
            }
        }
    }
}

#[test]
fn a_straight_wall_leaves_its_own_direction_open() {
    let wall: Vec<_> = (0..120).map(|k| Point2::new(k as f64 * 0.5, 0.0)).collect();
    let scan: Vec<_> = (0..30).map(|k| Point2::new(k as f64 * 0.5, 0.0)).collect();
    let start = Start { target_from_source: Isometry2::translation(20.0, 0.7), covariance: None };
    let found = Target::new(&wall, &CorrelativeParams::default()).unwrap().locate(&scan, &start).unwrap();
    assert!(found.covariance[(0, 0)].sqrt() > 1.3, "along the wall nothing is known: {}", found.covariance);
    assert!(found.covariance[(1, 1)].sqrt() < 0.4, "across it the wall tells: {}", found.covariance);
    let middle = found.target_from_source * Point2::new(7.25, 0.0);
    // A wall along the grid: all its points fall on the same side of their cells, half a cell and half a step in all.
    assert!(middle.y.abs() < 0.375, "{middle}");
}

#[test]
fn a_second_place_that_fits_is_reported() {
    let mut target = Vec::new();
    for base in [0.0, 8.0] {
        for k in 0..8 {
            target.push(Point2::new(base, f64::from(k) * 0.5));
            target.push(Point2::new(base + f64::from(k) * 0.5, 0.0));
        }
    }
    let scan = target[..16].to_vec();
    let params = CorrelativeParams { radius: 10.0, ..CorrelativeParams::default() };
    let start = Start { target_from_source: Isometry2::identity(), covariance: None };
    let found = Target::new(&target, &params).unwrap().locate(&scan, &start).unwrap();
    assert!(found.far_ratio > 0.97, "{}", found.far_ratio);
    let alone = Target::new(&target[..16], &params).unwrap().locate(&scan, &start).unwrap();
    assert!(alone.far_ratio < 0.6, "{}", alone.far_ratio);
}

#[test]
fn a_best_pose_on_the_border_is_told() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let target = harbour(&mut rng, 6);
    let start = Start { target_from_source: Isometry2::translation(4.0, 0.0), covariance: None };
    let prepared = Target::new(&target, &CorrelativeParams::default()).unwrap();
    assert!(prepared.locate(&target, &start).unwrap().at_border);
    assert!(!prepared.locate_within(&target, &start, 6.0, 0.05).unwrap().at_border);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn maps_are_aligned_from_any_heading(seed in 0u64..1000, x in -90.0..90.0f64, y in -90.0..90.0f64, yaw in -3.1..3.1f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let map: Vec<_> = harbour(&mut rng, 14).into_iter().step_by(3).collect();
        let truth = Isometry2::new([x, y].into(), yaw);
        // The partner saw two thirds of it, with noise, and something of its own.
        let mut source: Vec<_> = apply(&truth.inverse(), &map[map.len() / 3..])
            .into_iter()
            .map(|p| Point2::new(p.x + rng.random_range(-0.5..0.5), p.y + rng.random_range(-0.5..0.5)))
            .collect();
        source.extend(harbour(&mut rng, 3).into_iter().step_by(3).map(|p| truth.inverse() * p));
        let modes = align_maps(&map, &source, &MapAlignmentParams::default()).unwrap();
        let found = modes[0].target_from_source;
        let farthest = source.iter().map(|p| (found * p - truth * p).norm()).fold(0.0, f64::max);
        prop_assert!(farthest < 2.5, "a point is off by {farthest} m, modes {modes:?}");
        prop_assert!(modes.windows(2).all(|pair| pair[0].score >= pair[1].score));
    }
}

#[test]
fn a_map_that_looks_the_same_turned_around_has_two_modes() {
    let mut map = Vec::new();
    for k in 0..40 {
        let along = f64::from(k);
        map.extend([Point2::new(along, 0.0), Point2::new(along, 20.0)]);
        map.extend([Point2::new(0.0, along / 2.0), Point2::new(40.0, along / 2.0)]);
    }
    let modes = align_maps(&map, &map, &MapAlignmentParams::default()).unwrap();
    assert!(modes[1].score / modes[0].score > 0.97, "{modes:?}");
    let turn = modes[0].target_from_source.rotation.angle_to(&modes[1].target_from_source.rotation).abs();
    assert!((turn - std::f64::consts::PI).abs() < 0.05, "{turn}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_target_for_one_source_gives_the_same_answer(
        seed in 0..1000u64, x in -40.0..40.0f64, y in -40.0..40.0f64, angle in -3.0..3.0f64, radius in 0.0..4.0f64,
        turn in 0.0..0.5f64,
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let target = harbour(&mut rng, 6);
        let source: Vec<_> = harbour(&mut rng, 6).into_iter().step_by(7).collect();
        let pose = Isometry2::new([x, y].into(), angle);
        let params = CorrelativeParams { radius, angle: turn, ..CorrelativeParams::default() };
        let start = Start { target_from_source: pose, covariance: None };
        let whole = Target::new(&target, &params).unwrap().locate(&source, &start).unwrap();
        let part = Target::for_source(&target, &params, &source, &pose).unwrap().locate(&source, &start).unwrap();
        // the places of points on the part are rounded otherwise than on the whole
        prop_assert!((whole.score - part.score).abs() < 1e-5);
        prop_assert!((whole.background - part.background).abs() < 1e-5);
        prop_assert!((whole.far_ratio - part.far_ratio).abs() < 1e-3 || whole.score < 0.01);
        let off = whole.target_from_source.minus(&part.target_from_source);
        prop_assert!(off.norm() < 1e-3, "{}", off);
        prop_assert!((whole.covariance - part.covariance).norm() < 1e-3 * whole.covariance.norm());
    }
}

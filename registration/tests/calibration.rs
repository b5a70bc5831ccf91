//! Whether the covariance is as large as the error, on simulated scans whose noise the library is not told.

use std::f64::consts::{PI, TAU};

use draco_lie::LieGroup;
use draco_registration::{Cloud, IcpParams, Registration, Residual, Target};
use nalgebra::{Isometry2, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// 95 % quantile of the chi-square distribution with 3 degrees of freedom.
const CHI2_95: f64 = 7.815;

struct World {
    segments: Vec<[f64; 4]>,
    circles: Vec<[f64; 3]>,
    beams: Vec<f64>,
    sigma: f64,
    max_distance: f64,
    /// Of the first scan.
    heading: f64,
}

fn full_turn() -> Vec<f64> {
    (0..360).map(|i| -PI + f64::from(i) / 360.0 * TAU).collect()
}

fn room() -> World {
    let segments = vec![
        [-6., -4., 6., -4.],
        [6., -4., 6., 4.],
        [6., 4., -6., 4.],
        [-6., 4., -6., -4.],
        [1., -4., 1., -1.5],
        [-3., 4., -3., 2.],
        [3., 1., 4., 2.],
        [4., 2., 5., 1.],
    ];
    World { segments, circles: vec![], beams: full_turn(), sigma: 0.02, max_distance: 0.5, heading: 0.1 }
}

fn corridor() -> World {
    World { segments: vec![[-40., -1.5, 40., -1.5], [-40., 1.5, 40., 1.5]], ..room() }
}

fn pond() -> World {
    World { segments: vec![], circles: vec![[0.0, 0.0, 8.0]], ..room() }
}

/// Two rows of piles before a quay, seen by a sonar fan whose noise is a third of a pile's radius.
fn pilings() -> World {
    let circles = (0..10).flat_map(|k| [5.0, 8.0].map(|y| [-13.5 + 3.0 * f64::from(k), y, 0.3])).collect();
    let beams = (0..256).map(|i| (-60.0 + 120.0 * f64::from(i) / 255.0).to_radians()).collect();
    World {
        segments: vec![[-25., 14., 25., 14.]],
        circles,
        beams,
        sigma: 0.1,
        max_distance: 0.5,
        heading: PI / 2.0,
    }
}

fn scan(world: &World, pose: &Isometry2<f64>, rng: &mut ChaCha8Rng) -> Vec<Vector2<f64>> {
    let noise = Normal::new(0.0, world.sigma).unwrap();
    let (x, y) = (pose.translation.x, pose.translation.y);
    let mut points = Vec::new();
    for beam in &world.beams {
        let (dy, dx) = (pose.rotation.angle() + beam).sin_cos();
        let mut best: f64 = 30.0;
        for [x1, y1, x2, y2] in &world.segments {
            let (ex, ey) = (x2 - x1, y2 - y1);
            let den = dx * ey - dy * ex;
            if den.abs() > 1e-12 {
                let r = ((x1 - x) * ey - (y1 - y) * ex) / den;
                let u = ((x1 - x) * dy - (y1 - y) * dx) / den;
                if r > 0.02 && (0.0..=1.0).contains(&u) {
                    best = best.min(r);
                }
            }
        }
        for [cx, cy, radius] in &world.circles {
            let b = (x - cx) * dx + (y - cy) * dy;
            let q = b * b - ((x - cx).powi(2) + (y - cy).powi(2) - radius * radius);
            if q >= 0.0 {
                [-b - q.sqrt(), -b + q.sqrt()]
                    .iter()
                    .filter(|r| **r > 0.02)
                    .for_each(|r| best = best.min(*r));
            }
        }
        if best < 30.0 {
            let r = best + noise.sample(rng);
            points.push(Vector2::new(r * beam.cos(), r * beam.sin()));
        }
    }
    points
}

type Answer = Registration<Isometry2<f64>, 3>;

fn trials(world: &World, residual: Residual, count: usize, seed: u64) -> Vec<(Answer, Isometry2<f64>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let a = Isometry2::new(Vector2::zeros(), world.heading);
            let b = Isometry2::new(Vector2::new(0.6, 0.3), world.heading + 0.15);
            let truth = a.inv_mul(&b);
            let (target, source) = (scan(world, &a, &mut rng), scan(world, &b, &mut rng));
            let offset = [0; 3].map(|_| rng.random_range(-1.0..1.0));
            let start = truth * Isometry2::new(Vector2::new(offset[0], offset[1]) * 0.15, offset[2] * 0.08);
            let ready = |points| Cloud::new(points).unwrap().estimate_normals(8, &Vector2::zeros()).unwrap();
            let params = IcpParams { max_distance: world.max_distance, residual, ..IcpParams::laser_2d() };
            let found = Target::new(&ready(target)).unwrap().align(&ready(source), &start, &params).unwrap();
            (found, truth)
        })
        .collect()
}

#[test]
fn the_error_in_a_room_and_among_piles_is_as_large_as_the_covariance_says() {
    let cases = [
        ("room", room(), Residual::PointToPlane),
        ("room", room(), Residual::PlaneToPlane),
        ("pilings", pilings(), Residual::PointToPlane),
    ];
    for (name, world, residual) in cases {
        let all = trials(&world, residual, 400, 11);
        let squares: Vec<f64> = all
            .iter()
            .map(|(found, truth)| {
                assert!(!found.is_degenerate());
                let xi = truth.between(&found.target_from_source).log();
                (xi.transpose() * found.information * xi)[0]
            })
            .collect();
        let nees = squares.iter().sum::<f64>() / (3.0 * squares.len() as f64);
        let covered = squares.iter().filter(|s| **s < CHI2_95).count() as f64 / squares.len() as f64;
        println!("{name}, {residual:?}: NEES/dof {nees:.3}, 95 % ellipsoid covers {covered:.3}");
        assert!((0.8..1.25).contains(&nees), "NEES/dof {nees}");
        // 400 trials tell the coverage to a hundredth
        assert!((0.90..0.985).contains(&covered), "coverage {covered}");
    }
}

#[test]
fn a_corridor_is_flagged_along_itself_and_a_pond_about_its_centre() {
    for (found, truth) in trials(&corridor(), Residual::PointToPlane, 50, 12) {
        assert_eq!(found.degenerate_directions.len(), 1);
        let along = (Isometry2::rotation(0.1) * truth).rotation.inverse() * Vector2::x();
        let dot = found.degenerate_directions[0].dot(&Vector3::new(along.x, along.y, 0.0)).abs();
        assert!(dot > 0.99, "{dot}");
        assert!(
            (found.information * found.degenerate_directions[0]).norm() < 1e-6 * found.information.norm()
        );
    }
    for (found, truth) in trials(&pond(), Residual::PointToPlane, 50, 13) {
        assert_eq!(found.degenerate_directions.len(), 1);
        // a turn about the pond's centre c, seen from the source: translation (c.y, -c.x)
        let c = truth.inverse_transform_point(&[0.0, 0.0].into());
        let dot = found.degenerate_directions[0].dot(&Vector3::new(c.y, -c.x, 1.0).normalize()).abs();
        assert!(dot > 0.97, "{dot}");
    }
}

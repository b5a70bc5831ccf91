//! Alignment of trajectories that leave a rotation hard to tell: planar, thin, symmetric and reflected ones. The oracle
//! is Horn's: the largest eigenvalue of a matrix on quaternions is what the best rotation attains.

use draco_pgo::Error;
use draco_pgo::evaluation::{Alignment, align};
use nalgebra::{Isometry3, Matrix3, Matrix4, Translation3, UnitQuaternion, Vector3, Vector4};
use rand::{Rng, RngExt, SeedableRng};

/// Least of what the best rotation attains, relative to the spread of both trajectories.
const TOLERANCE: f64 = 1e-13;

fn poses(points: &[Vector3<f64>]) -> Vec<Isometry3<f64>> {
    let pose = |p: &Vector3<f64>| Isometry3::from_parts(Translation3::from(*p), UnitQuaternion::identity());
    points.iter().map(pose).collect()
}

fn vector(rng: &mut impl Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..=size))
}

/// `Σ q pᵀ` about the means, and the spread.
fn covariance(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> (Matrix3<f64>, f64) {
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (p, q) = (mean(from), mean(to));
    let sum = from.iter().zip(to).map(|(a, b)| (b - q) * (a - p).transpose()).sum();
    let square = |points: &[Vector3<f64>], mean: Vector3<f64>| {
        points.iter().map(|x| (x - mean).norm_squared()).sum::<f64>()
    };
    (sum, (square(from, p) * square(to, q)).sqrt())
}

/// The maximum of `tr(Rᵀ C)` over rotations (Horn, *Closed-form solution of absolute orientation using unit
/// quaternions*, 1987), by repeated squaring of his matrix.
fn best(c: &Matrix3<f64>) -> f64 {
    let s = c.transpose();
    let skew = Vector3::new(s[(1, 2)] - s[(2, 1)], s[(2, 0)] - s[(0, 2)], s[(0, 1)] - s[(1, 0)]);
    let mut n = Matrix4::zeros();
    n[(0, 0)] = s.trace();
    n.fixed_view_mut::<3, 1>(1, 0).copy_from(&skew);
    n.fixed_view_mut::<1, 3>(0, 1).copy_from(&skew.transpose());
    n.fixed_view_mut::<3, 3>(1, 1).copy_from(&(s + c - Matrix3::identity() * s.trace()));
    let shift = 2.0 * c.norm();
    let mut power = n + Matrix4::identity() * shift;
    for _ in 0..45 {
        power = power * power / power.norm();
    }
    let column = (0..4).max_by(|a, b| power.column(*a).norm().total_cmp(&power.column(*b).norm())).unwrap();
    let vector: Vector4<f64> = power.column(column).normalize();
    vector.dot(&(n * vector))
}

fn check(name: &str, from: &[Vector3<f64>], to: &[Vector3<f64>], exact: bool) {
    let found = align(&poses(from), &poses(to), Alignment::Rigid).unwrap_or_else(|e| panic!("{name}: {e}"));
    let rotation = found.isometry.rotation.to_rotation_matrix().into_inner();
    assert!((rotation.tr_mul(&rotation) - Matrix3::identity()).amax() < 1e-14, "{name}");
    let (c, spread) = covariance(from, to);
    let (attained, best) = (rotation.dot(&c), best(&c));
    assert!(attained >= best - TOLERANCE * spread, "{name}: {attained} instead of {best}");
    let extent = (spread / from.len() as f64).sqrt();
    for (p, q) in from.iter().zip(to).filter(|_| exact) {
        let error = (found.isometry.rotation * p + found.isometry.translation.vector - q).norm();
        assert!(error <= 1e-10 * extent + 1e-14 * q.norm(), "{name}: off by {error} of {extent}");
    }
    if let Ok(similarity) = align(&poses(from), &poses(to), Alignment::Similarity) {
        let square = covariance(from, from).1;
        assert!((similarity.scaling() * square - best).abs() <= 1e-12 * spread.max(square), "{name}");
    }
}

#[test]
fn no_rotation_aligns_better() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let widths = [
        ("full", [1.0, 0.7, 0.3]),
        ("round", [1.0, 1.0, 1.0]),
        ("planar", [1.0, 0.6, 0.0]),
        ("nearly planar", [1.0, 0.6, 1e-9]),
        ("thin in the plane", [1.0, 1e-3, 0.0]),
        ("very thin in the plane", [1.0, 1e-5, 0.0]),
        ("very thin", [1.0, 1e-5, 1e-5]),
        ("flat and thin", [1.0, 1e-4, 1e-7]),
    ];
    for (name, width) in widths {
        for round in 0..60 {
            let size = [1e-3, 1.0, 1e4][round % 3];
            let turn = UnitQuaternion::new(vector(&mut rng, 3.0));
            let (by, shift) = (UnitQuaternion::new(vector(&mut rng, 3.0)), vector(&mut rng, 2.0 * size));
            let from: Vec<Vector3<f64>> = (0..3 + round)
                .map(|_| turn * vector(&mut rng, size).component_mul(&Vector3::from(width)))
                .collect();
            let to: Vec<Vector3<f64>> = from.iter().map(|p| by * p + shift).collect();
            check(name, &from, &to, true);
            let noise = size * 1e-3 * width[1];
            let noisy: Vec<_> = to.iter().map(|q| q + vector(&mut rng, noise)).collect();
            check(&format!("{name}, noisy"), &from, &noisy, false);
            let mirrored: Vec<_> = noisy.iter().map(|q| Vector3::new(q.x, q.y, -q.z)).collect();
            check(&format!("{name}, mirrored"), &from, &mirrored, false);
        }
    }
}

#[test]
fn symmetric_trajectories_are_no_harder() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
    let axis = |k: usize, sign: f64| Vector3::ith(k, sign);
    let octahedron: Vec<_> = (0..3).flat_map(|k| [axis(k, 1.0), axis(k, -1.0)]).collect();
    let corner = |bits: usize| Vector3::from_fn(|r, _| if bits >> r & 1 == 1 { 1.0 } else { -1.0 });
    let circle = |n: usize| {
        (0..n)
            .map(move |i| std::f64::consts::TAU * i as f64 / n as f64)
            .map(|angle| Vector3::new(angle.cos(), angle.sin(), 0.0))
            .collect::<Vec<_>>()
    };
    let shapes = [octahedron, (0..8).map(corner).collect(), circle(4), circle(97)];
    for (index, from) in shapes.iter().enumerate() {
        for round in 0..40 {
            let (by, shift) = (UnitQuaternion::new(vector(&mut rng, 3.0)), vector(&mut rng, 5.0));
            let to: Vec<_> = from.iter().map(|p| by * p + shift).collect();
            check(&format!("shape {index}"), from, &to, true);
            // singular values that differ in their last digits
            let noise = 10f64.powi(-4 - round % 12);
            let noisy: Vec<_> = to.iter().map(|q| q + vector(&mut rng, noise)).collect();
            check(&format!("shape {index}, noise {noise:e}"), from, &noisy, false);
            let mirrored: Vec<_> = noisy.iter().map(|q| -q).collect();
            check(&format!("shape {index}, mirrored"), from, &mirrored, false);
        }
    }
}

#[test]
fn what_lies_on_a_line_has_no_alignment() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(13);
    for _ in 0..50 {
        let (along, start) = (vector(&mut rng, 3.0), vector(&mut rng, 100.0));
        let line: Vec<_> = (0..20).map(|i| start + along * f64::from(i)).collect();
        let turned: Vec<_> = line.iter().map(|p| UnitQuaternion::new(start) * p).collect();
        let found = align(&poses(&line), &poses(&turned), Alignment::Rigid);
        assert_eq!(found, Err(Error::Alignment));
    }
}

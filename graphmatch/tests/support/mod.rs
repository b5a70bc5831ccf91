//! What several test files need.
#![allow(dead_code, reason = "each test file uses its part")]

use std::path::PathBuf;

use draco_graphmatch::Object;
use nalgebra::{Isometry2, Point2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A folder of the shared data, or `None` (told on stderr) where it is not there.
///
/// # Panics
/// If it is missing and `DRACO_REQUIRE_DATA=1`.
pub(crate) fn data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    assert!(std::env::var("DRACO_REQUIRE_DATA").as_deref() != Ok("1"), "{} is missing", path.display());
    eprintln!("skipped: {} is not there", path.display());
    None
}

/// `n` places at least 3 m apart, one to 64 m² on average.
pub(crate) fn scatter(n: usize, seed: u64) -> Vec<Point2<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let side = 8.0 * (n as f64).sqrt();
    let mut points: Vec<Point2<f64>> = Vec::new();
    while points.len() < n {
        let p = Point2::new(rng.random_range(0.0..side), rng.random_range(0.0..side));
        if points.iter().all(|q| (p - q).norm() >= 3.0) {
            points.push(p);
        }
    }
    points
}

/// Objects at places, with varied sizes.
pub(crate) fn objects(points: &[Point2<f64>], seed: u64) -> Vec<Object> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    points
        .iter()
        .map(|p| {
            let length = rng.random_range(3.0..9.0);
            Object::new(*p, length, length * rng.random_range(0.3..1.0))
        })
        .collect()
}

/// The same objects seen from another frame, with uniform noise of `noise` on each coordinate.
pub(crate) fn seen_from(map: &[Object], frame: &Isometry2<f64>, noise: f64, seed: u64) -> Vec<Object> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut jitter = || if noise > 0.0 { rng.random_range(-noise..noise) } else { 0.0 };
    map.iter()
        .map(|o| {
            let p = frame.inverse_transform_point(&o.centroid);
            Object { centroid: Point2::new(p.x + jitter(), p.y + jitter()), ..*o }
        })
        .collect()
}

/// Costs of four kinds: uniform, whole numbers with ties, a product with noise (all rows want the same columns), and
/// uniform with half of the pairs forbidden except a diagonal.
pub(crate) fn random_costs(rows: usize, columns: usize, kind: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut costs = Vec::with_capacity(rows * columns);
    for i in 0..rows {
        for j in 0..columns {
            let uniform: f64 = rng.random();
            costs.push(match kind {
                0 => uniform,
                1 => (6.0 * uniform).floor() - 3.0,
                2 => ((i + 1) * (j + 1)) as f64 + uniform,
                _ if rng.random::<bool>() && i % columns != j && j % rows != i => f64::INFINITY,
                _ => uniform,
            });
        }
    }
    costs
}

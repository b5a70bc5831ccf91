//! Peer on the same machine and points: scikit-learn 1.7 `DBSCAN(eps=1.5, min_samples=20)`, see the README.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use draco_graphmatch::{Dbscan, dbscan};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// 100 disks of radius 3 m in 400 m × 400 m, and one point in ten anywhere.
fn cloud(n: usize) -> Vec<Point2<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut uniform = |a: f64, b: f64| rng.random_range(a..b);
    let centres: Vec<_> = (0..100).map(|_| (uniform(0.0, 400.0), uniform(0.0, 400.0))).collect();
    (0..n)
        .map(|i| {
            if i % 10 == 0 {
                return Point2::new(uniform(0.0, 400.0), uniform(0.0, 400.0));
            }
            let (x, y) = centres[i % 100];
            let (radius, angle) = (3.0 * uniform(0.0, 1.0).sqrt(), uniform(0.0, std::f64::consts::TAU));
            Point2::new(x + radius * angle.cos(), y + radius * angle.sin())
        })
        .collect()
}

fn bench(c: &mut Criterion) {
    let points = cloud(50_200);
    c.bench_function("dbscan/batch/50k", |b| b.iter(|| dbscan(black_box(&points[..50_000]), 1.5, 20)));
    let mut grown = Dbscan::new(1.5, 20).expect("valid");
    grown.insert(&points[..50_000]).expect("finite");
    c.bench_function("dbscan/insert/200_into_50k", |b| {
        b.iter_batched_ref(
            || grown.clone(),
            |clusters| clusters.insert(&points[50_000..]),
            BatchSize::LargeInput,
        );
    });
    c.bench_function("dbscan/labels/50k", |b| b.iter(|| grown.labels()));
}

criterion_group!(benches, bench);
criterion_main!(benches);

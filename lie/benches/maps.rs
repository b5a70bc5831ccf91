//! Maps, Jacobians and residuals of SE(2) and SE(3) on 1024 random poses, time a call.
//!
//! Angles are spread as in a pose graph: residuals from 1e-4 to 0.5 rad for `between_error`, any angle for the rest.
use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use draco_lie::{GaussianPose, LieGroup};
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const COUNT: usize = 1024;

/// Tangents with translations up to 10 m and rotations up to 1.8 rad an axis, times `scale`.
fn tangents<const N: usize>(rng: &mut ChaCha8Rng, rotations: usize, scale: f64) -> Vec<SVector<f64, N>> {
    let mut tangent = || {
        SVector::<f64, N>::from_fn(|i, _| {
            let reach = if i < N - rotations { 10.0 } else { 1.8 };
            scale * rng.random_range(-reach..reach)
        })
    };
    (0..COUNT).map(|_| tangent()).collect()
}

fn group<const N: usize, G: LieGroup<N>>(c: &mut Criterion, name: &str, rotations: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let xs = tangents::<N>(&mut rng, rotations, 1.0);
    let poses: Vec<G> = xs.iter().map(G::exp).collect();
    let others: Vec<G> = tangents::<N>(&mut rng, rotations, 1.0).iter().map(G::exp).collect();
    let errors = tangents::<N>(&mut rng, rotations, 1.0);
    let measured: Vec<G> = (0..COUNT)
        .map(|k| {
            let size = 10_f64.powf(rng.random_range(-4.0..-0.5));
            poses[k].between(&others[k]).plus(&(errors[k] * size))
        })
        .collect();
    let noise = SMatrix::<f64, N, N>::identity() * 0.01;
    let gaussian = |pose: &G| GaussianPose::new(*pose, noise).expect("a valid pose");
    let (left, right): (Vec<_>, Vec<_>) =
        (poses.iter().map(gaussian).collect(), others.iter().map(gaussian).collect());

    let mut bench = c.benchmark_group(name);
    bench.throughput(Throughput::Elements(COUNT as u64));
    let mut each = |what: &str, call: &mut dyn FnMut(usize)| {
        bench.bench_function(BenchmarkId::new(what, COUNT), |b| b.iter(|| (0..COUNT).for_each(&mut *call)));
    };
    each("exp", &mut |k| {
        black_box(G::exp(black_box(&xs[k])));
    });
    each("log", &mut |k| {
        black_box(black_box(&poses[k]).log());
    });
    each("compose", &mut |k| {
        black_box(poses[k].compose(black_box(&others[k])));
    });
    each("right_jacobian", &mut |k| {
        black_box(G::right_jacobian(black_box(&xs[k])));
    });
    each("right_jacobian_inverse", &mut |k| {
        black_box(G::right_jacobian_inverse(black_box(&xs[k])));
    });
    each("between_error", &mut |k| {
        black_box(G::between_error(black_box(&measured[k]), &poses[k], &others[k]));
    });
    each("between_error_with_jacobians", &mut |k| {
        black_box(G::between_error_with_jacobians(black_box(&measured[k]), &poses[k], &others[k]));
    });
    each("gaussian_compose", &mut |k| {
        black_box(left[k].compose(black_box(&right[k])));
    });
    bench.finish();
}

fn all(c: &mut Criterion) {
    group::<3, Isometry2<f64>>(c, "se2", 1);
    group::<6, Isometry3<f64>>(c, "se3", 3);
}

criterion_group! {
    name = benches;
    config = Criterion::default().measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300)).sample_size(20);
    targets = all
}
criterion_main!(benches);

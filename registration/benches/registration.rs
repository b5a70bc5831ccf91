//! Trees, 2-D alignment and 2-D search. Bars on a quiet core: 1000 x 1000 point to point with tree 1 ms,
//! generalised ICP with normals 1.5 ms, 500 x 3000 5 ms; small_gicp takes 20 to 40 ms for its 3-D pair.

use std::f64::consts::TAU;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use draco_registration::global::{SearchParams, branch_and_bound_2d};
use draco_registration::{Cloud, Covariance, IcpParams, KdTree, Residual, StopRule, Target};
use nalgebra::{Isometry2, Vector2};

/// Points on the walls of a room with two columns, with a fixed ripple as noise.
fn room(count: usize, phase: f64) -> Vec<Vector2<f64>> {
    (0..count)
        .map(|i| {
            let s = 40.0 * (i as f64 + phase) / count as f64;
            let ripple = 0.02 * (371.0 * s).sin();
            match s {
                s if s < 12.0 => Vector2::new(s, ripple),
                s if s < 20.0 => Vector2::new(12.0 + ripple, s - 12.0),
                s if s < 32.0 => Vector2::new(32.0 - s, 8.0 + ripple),
                s if s < 36.0 => Vector2::new(ripple, 40.0 - s),
                s => {
                    let a = 0.5 * s * TAU;
                    Vector2::new(4.0 + (0.6 + ripple) * a.cos(), 3.0 + (0.6 + ripple) * a.sin())
                }
            }
        })
        .collect()
}

fn pair(source: usize, target: usize) -> (Vec<Vector2<f64>>, Vec<Vector2<f64>>) {
    let truth = Isometry2::new(Vector2::new(0.2, -0.1), 0.05);
    let seen = room(source, 0.3).iter().map(|p| truth.inverse_transform_point(&(*p).into()).coords).collect();
    (seen, room(target, 0.0))
}

fn bench(c: &mut Criterion) {
    let points = room(1000, 0.0);
    c.bench_function("kd_tree/build/1k", |b| b.iter(|| KdTree::new(black_box(&points))));
    let tree = KdTree::new(&points).unwrap();
    let queries = room(1000, 0.4);
    c.bench_function("kd_tree/nearest/1k x 1k", |b| {
        b.iter(|| queries.iter().filter_map(|q| tree.nearest(q)).map(|n| n.distance_sq).sum::<f64>())
    });
    let stop = StopRule { max_iterations: 20, ..StopRule::default() };
    for (n, m) in [(1000, 1000), (500, 3000)] {
        let (source, target) = pair(n, m);
        let point =
            IcpParams { stop, covariance: Covariance::Residual, max_distance: 1.0, ..IcpParams::sonar_2d() };
        c.bench_function(&format!("icp/point to point with tree/{n} x {m}"), |b| {
            b.iter(|| {
                let ready = Target::new(&Cloud::new(target.clone())?)?;
                ready.align(&Cloud::new(source.clone())?, &Isometry2::identity(), &point)
            });
        });
        let full = IcpParams { stop, residual: Residual::PlaneToPlane, ..IcpParams::laser_2d() };
        let plane = IcpParams { covariance: Covariance::Residual, ..full.clone() };
        let normals =
            |p: &[Vector2<f64>]| Cloud::new(p.to_vec())?.estimate_normals(6, &Vector2::new(6.0, 4.0));
        c.bench_function(&format!("icp/generalised with normals and tree/{n} x {m}"), |b| {
            b.iter(|| {
                Target::new(&normals(&target)?)?.align(&normals(&source)?, &Isometry2::identity(), &plane)
            });
        });
        let ready = (Target::new(&normals(&target).unwrap()).unwrap(), normals(&source).unwrap());
        c.bench_function(&format!("icp/generalised with calibrated covariance, prepared/{n} x {m}"), |b| {
            b.iter(|| ready.0.align(&ready.1, &Isometry2::identity(), &full));
        });
    }
    let (source, target) = pair(360, 360);
    let (target, source) = (Target::new(&Cloud::new(target).unwrap()).unwrap(), Cloud::new(source).unwrap());
    let mut group = c.benchmark_group("global");
    group.sample_size(10);
    group.bench_function("branch_and_bound_2d/360 x 360, 5 m, all headings", |b| {
        b.iter(|| branch_and_bound_2d(&target, &source, &Isometry2::identity(), &SearchParams::default()));
    });
}

criterion_group!(benches, bench);
criterion_main!(benches);

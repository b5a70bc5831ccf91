//! Two maps of n objects in clutter, 30 % of them common, 0.2 m of noise. A peer's numbers are in the README.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use draco_graphmatch::{
    Affinity, AffinityParams, Attributes, ConsensusParams, Method, NoSimilarity, Object, RrwmParams,
    consensus, match_objects, principal_eigenvector, rrwm,
};
use nalgebra::{Isometry2, Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn maps(n: usize) -> (Vec<Object>, Vec<Object>) {
    let mut rng = ChaCha8Rng::seed_from_u64(n as u64);
    let side = 8.0 * (n as f64).sqrt();
    let common = (0.3 * n as f64).round() as usize;
    let mut all: Vec<Object> = Vec::new();
    while all.len() < 2 * n - common {
        let place = Point2::new(rng.random_range(0.0..side), rng.random_range(0.0..side));
        if all.iter().all(|o| (o.centroid - place).norm() >= 1.5) {
            let length = rng.random_range(2.5..9.0);
            all.push(Object::new(place, length, length * rng.random_range(0.25..1.0)));
        }
    }
    let frame = Isometry2::new(Vector2::new(20.0, -3.0), 1.3);
    let seen = all[..common].iter().chain(&all[n..]).map(|o| {
        let mut jitter = || rng.random_range(-0.3..0.3);
        let place = frame.inverse_transform_point(&o.centroid) + Vector2::new(jitter(), jitter());
        Object::new(place, o.length + jitter(), (o.breadth + jitter()).max(0.1))
    });
    let map2 = seen.collect();
    (all[..n].to_vec(), map2)
}

fn bench(c: &mut Criterion) {
    let shapes = AffinityParams {
        attributes: Attributes::Gaussian { sigma: 0.2, gate: 3.5 },
        ..AffinityParams::default()
    };
    for n in [20, 40, 80, 150] {
        let (map1, map2) = maps(n);
        for (name, params) in [("places", AffinityParams::default()), ("shapes", shapes.clone())] {
            c.bench_function(&format!("affinity_eigenvector/{name}/{n}"), |b| {
                b.iter(|| {
                    let affinity = Affinity::new(black_box(&map1), &map2, &params).expect("valid");
                    principal_eigenvector(&affinity, None)
                });
            });
        }
        c.bench_function(&format!("match/places/{n}"), |b| {
            b.iter(|| consensus(black_box(&map1), &map2, &NoSimilarity, &ConsensusParams::default()));
        });
        c.bench_function(&format!("match/shapes/{n}"), |b| {
            b.iter(|| match_objects(black_box(&map1), &map2, &Method::default()));
        });
    }
    let (map1, map2) = maps(20);
    let affinity = Affinity::new(&map1, &map2, &AffinityParams::default()).expect("valid");
    c.bench_function("rrwm/20", |b| b.iter(|| rrwm(black_box(&affinity), &RrwmParams::default())));
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = bench }
criterion_main!(benches);

//! Square cost matrices of the families of lapx's and scipy's comparison; a peer's numbers are in the README.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use draco_graphmatch::{Costs, assign};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn costs(family: &str, n: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(n as u64);
    let mut uniform = || rng.random::<f64>();
    match family {
        "uniform" => (0..n * n).map(|_| uniform()).collect(),
        "int100" => (0..n * n).map(|_| (100.0 * uniform()).floor()).collect(),
        "product" => (0..n * n).map(|k| ((k / n + 1) * (k % n + 1)) as f64).collect(),
        // Distances of points seen twice, in another order.
        _ => {
            let seen: Vec<[f64; 2]> = (0..n).map(|_| [100.0 * uniform(), 100.0 * uniform()]).collect();
            let again: Vec<[f64; 2]> = seen.iter().map(|p| p.map(|x| x + 3.0 * uniform() - 1.5)).collect();
            let distance = |p: &[f64; 2], q: &[f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
            seen.iter().flat_map(|p| again.iter().rev().map(move |q| distance(p, q))).collect()
        }
    }
}

fn bench(c: &mut Criterion) {
    for (family, n) in [
        ("uniform", 200),
        ("uniform", 1000),
        ("int100", 200),
        ("int100", 1000),
        ("product", 200),
        ("geometric", 200),
    ] {
        let values = costs(family, n);
        c.bench_function(&format!("assign/{family}/{n}"), |b| {
            b.iter(|| assign(Costs::new(n, n, black_box(&values)).expect("finite")));
        });
    }
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = bench }
criterion_main!(benches);

//! Pair tests, PCM and the group posterior on generated teams.
//!
//! Peers: the released C++ of distributed PCM rebuilds every covariance for every pair; its 16-robot set takes it
//! seconds. No peer has a group posterior.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use draco_consistency::simulate::{Harbor, Meetings, SimulatedTeam, harbor};
use draco_consistency::{GcmParams, PairTest, PcmParams, Pose, gcm, pcm};
use nalgebra::{Isometry2, Isometry3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn team<const N: usize, G: Pose<N>>(params: &Harbor) -> SimulatedTeam<G, N> {
    harbor(params, &mut ChaCha8Rng::seed_from_u64(1)).expect("the parameters are sound")
}

/// 120 closures of one robot pair: 7140 pairs.
fn one_pair() -> Harbor {
    let meetings = vec![Meetings { first: 0, second: 1, groups: vec![Some((12, false)); 10] }];
    Harbor { robots: 2, meetings, ..Harbor::default() }
}

fn pair_tests<const N: usize, G: Pose<N>>(criterion: &mut Criterion, name: &str) {
    let team = team::<N, G>(&one_pair());
    let test = PairTest::new(&team.trajectories, &team.closures, 0.99).expect("the closures are sound");
    let n = test.len();
    let mut group = criterion.benchmark_group("pair_test");
    group.throughput(Throughput::Elements((n * (n - 1) / 2) as u64));
    group.bench_function(name, |b| {
        b.iter(|| {
            (0..n).flat_map(|m| (m + 1..n).map(move |o| (m, o))).filter(|&(m, o)| test.agree(m, o)).count()
        });
    });
    group.finish();
}

fn sets(criterion: &mut Criterion) {
    let two = team::<3, Isometry2<f64>>(&one_pair());
    criterion.bench_function("pcm/se2/120", |b| {
        b.iter(|| pcm(&two.trajectories, &two.closures, &PcmParams::default()));
    });
    for (name, size) in [("gcm/star5/500", 10), ("gcm/star5/1000", 20)] {
        let mut params = Harbor::star(5, 10);
        params.group_size = (size, size);
        let star = team::<3, Isometry2<f64>>(&params);
        criterion.bench_function(name, |b| {
            b.iter_batched(
                GcmParams::default,
                |p| gcm(&star.trajectories, &star.closures, &star.priors, &p),
                BatchSize::SmallInput,
            );
        });
    }
}

fn all(criterion: &mut Criterion) {
    pair_tests::<3, Isometry2<f64>>(criterion, "se2");
    pair_tests::<6, Isometry3<f64>>(criterion, "se3");
    sets(criterion);
}

criterion_group! {
    name = measurements;
    config = Criterion::default().sample_size(20);
    targets = all
}
criterion_main!(measurements);

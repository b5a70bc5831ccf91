//! Cliques: one graph in one go, weighted, step by step; hypercliques.
//!
//! Peers on the same graphs, CPU seconds of the whole process with reading: PMC brock200_1 0.62, p_hat300-3 3.15,
//! gen200_p0.9_55 1.01; MC-BRB 0.92, 1.56, 0.084; the near-clique 1.7 by MC-BRB, PMC does not finish.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use draco_consistency::clique::{self, Budget, Incremental, IncrementalWeight};
use draco_consistency::graph::{Adjacency, Graph, PlantedParams, planted, random, read_dimacs};
use draco_consistency::hyperclique;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A benchmark graph with weights `(i mod 200) + 1`, or `None` with a word if the shared data are not there.
fn dimacs(name: &str) -> Option<Graph> {
    let root = std::env::var_os("DRACO_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        std::path::PathBuf::from,
    );
    let path = root.join(format!("maxclique/dimacs/{name}.clq"));
    let Ok(sparse) = read_dimacs(&path) else {
        println!("skipped: {} cannot be read; set DRACO_DATA", path.display());
        return None;
    };
    let graph = Graph::from_sparse(&sparse).expect("benchmark graphs are small");
    let weights: Vec<f64> = (1..=graph.len()).map(|i| (i % 200 + 1) as f64).collect();
    Some(graph.with_weights(&weights).expect("one weight a vertex"))
}

fn whole_graphs(criterion: &mut Criterion) {
    for name in ["brock200_1", "p_hat300-3", "gen200_p0.9_55", "MANN_a27"] {
        let Some(graph) = dimacs(name) else { return };
        criterion.bench_function(&format!("clique/{name}"), |b| {
            b.iter(|| clique::maximum(&graph, &Budget::UNLIMITED));
        });
    }
    for name in ["brock200_2", "gen200_p0.9_55"] {
        let Some(graph) = dimacs(name) else { return };
        criterion.bench_function(&format!("clique/weighted/{name}"), |b| {
            b.iter(|| clique::maximum_weight(&graph, &Budget::UNLIMITED));
        });
    }
    let random = random(200, 0.8, &mut rng(1)).expect("small");
    criterion.bench_function("clique/random/200/0.8", |b| {
        b.iter(|| clique::maximum(&random, &Budget::UNLIMITED));
    });
    let near = planted(&PlantedParams::default(), &mut rng(0)).expect("sound").graph;
    criterion.bench_function("clique/near/1000", |b| b.iter(|| clique::maximum(&near, &Budget::UNLIMITED)));
}

/// Neighbours with a lower number: what is known when each vertex arrives.
fn arrivals(graph: &Graph) -> Vec<Vec<usize>> {
    (0..graph.len()).map(|v| graph.neighbors(v).filter(|&u| u < v).collect()).collect()
}

fn step_by_step(criterion: &mut Criterion) {
    let params = PlantedParams { inner: 1.0, ..PlantedParams::default() };
    let arrivals = arrivals(&planted(&params, &mut rng(1)).expect("sound").graph);
    criterion.bench_function("clique/incremental/1000", |b| {
        b.iter(|| {
            let mut cliques = Incremental::new(Budget::UNLIMITED);
            arrivals.iter().for_each(|near| drop(cliques.insert(near)));
            cliques.best().value
        });
    });
    criterion.bench_function("clique/incremental/weighted/1000", |b| {
        b.iter(|| {
            let mut cliques = IncrementalWeight::new(Budget::UNLIMITED);
            arrivals.iter().enumerate().for_each(|(v, near)| drop(cliques.insert(near, (v % 7 + 1) as f64)));
            cliques.best().value
        });
    });
}

fn hypercliques(criterion: &mut Criterion) {
    let mut rng = rng(3);
    let checked = hyperclique::from_checks(200, 3, 3, |_| rng.random_bool(0.1)).expect("small");
    criterion.bench_function("hyperclique/3/200", |b| {
        b.iter(|| hyperclique::maximum(&checked.hypergraph, &Budget::UNLIMITED));
    });
    let mut grown = hyperclique::Incremental::new(3, Budget::UNLIMITED).expect("order three");
    let pairs = |v: usize| {
        let pairs = (0..v).flat_map(|b| (0..b).map(move |a| [a, b]));
        pairs.filter(|&[a, b]| checked.hypergraph.has_edge(&[a, b, v])).collect::<Vec<_>>()
    };
    (0..199).for_each(|v| drop(grown.insert(pairs(v))));
    let last = pairs(199);
    criterion.bench_function("hyperclique/3/200/insert", |b| {
        b.iter_batched(
            || grown.clone(),
            |mut grown| grown.insert(&last).map(|b| b.value),
            BatchSize::SmallInput,
        );
    });
}

fn all(criterion: &mut Criterion) {
    whole_graphs(criterion);
    step_by_step(criterion);
    hypercliques(criterion);
}

criterion_group! {
    name = cliques;
    config = Criterion::default().sample_size(10);
    targets = all
}
criterion_main!(cliques);

//! What does it cost to keep the largest consistent set up to date, closure by closure?

use std::time::Instant;

use draco_consistency::clique::{self, Budget, Incremental};
use draco_consistency::graph::{Adjacency, PlantedParams, planted};
use draco_consistency::hyperclique;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn main() -> anyhow::Result<()> {
    println!("planted of 1000  largest  batch ms  all inserts ms  99th percentile us");
    for (share, inner) in [(100, 1.0), (200, 1.0), (300, 1.0), (100, 0.98), (200, 0.98)] {
        let params = PlantedParams { planted: share, inner, ..PlantedParams::default() };
        let graph = planted(&params, &mut ChaCha8Rng::seed_from_u64(7))?.graph;
        let start = Instant::now();
        let batch = clique::maximum(&graph, &Budget::UNLIMITED);
        let batch_ms = start.elapsed().as_secs_f64() * 1e3;

        let mut cliques = Incremental::new(Budget::UNLIMITED);
        let mut micros = Vec::with_capacity(graph.len());
        for v in 0..graph.len() {
            let neighbors: Vec<usize> = graph.neighbors(v).filter(|&u| u < v).collect();
            let start = Instant::now();
            cliques.insert(&neighbors)?;
            micros.push(start.elapsed().as_secs_f64() * 1e6);
        }
        anyhow::ensure!(cliques.best().value == batch.value && cliques.best().optimal);
        let total_ms: f64 = micros.iter().sum::<f64>() / 1e3;
        micros.sort_by(f64::total_cmp);
        let p99 = micros[micros.len() * 99 / 100];
        println!(
            "{share:4} joined {inner:4}  {:7}  {batch_ms:8.2}  {total_ms:14.2}  {p99:18.1}",
            batch.value
        );
    }
    triples()
}

/// The same for sets that can only be judged three at a time.
fn triples() -> anyhow::Result<()> {
    let (n, mut rng) = (200, ChaCha8Rng::seed_from_u64(3));
    let start = Instant::now();
    let checked = hyperclique::from_checks(n, 3, 3, |_| rng.random_bool(0.1))?;
    let built = start.elapsed().as_secs_f64() * 1e3;
    let start = Instant::now();
    let batch = hyperclique::maximum(&checked.hypergraph, &Budget::UNLIMITED);
    let batch_ms = start.elapsed().as_secs_f64() * 1e3;

    let mut cliques = hyperclique::Incremental::new(3, Budget::UNLIMITED)?;
    let mut last_ms = 0.0;
    for v in 0..n {
        let pairs = (0..v).flat_map(|b| (0..b).map(move |a| [a, b]));
        let pairs: Vec<[usize; 2]> =
            pairs.filter(|&[a, b]| checked.hypergraph.has_edge(&[a, b, v])).collect();
        let start = Instant::now();
        cliques.insert(&pairs)?;
        last_ms = start.elapsed().as_secs_f64() * 1e3;
    }
    anyhow::ensure!(cliques.best().value == batch.value);
    println!(
        "triples, n = {n}, density 0.1: largest {}, {} tests in {built:.1} ms, batch {batch_ms:.1} ms, last insert {last_ms:.2} ms",
        batch.value, checked.tests[3]
    );
    Ok(())
}

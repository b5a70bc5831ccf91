//! What does it cost to keep the largest consistent set up to date, closure by closure? Seeds may be given.

use cpu_time::ProcessTime;
use draco_consistency::clique::{self, Budget, Incremental};
use draco_consistency::graph::{Adjacency, PlantedParams, planted};
use draco_consistency::hyperclique;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn main() -> anyhow::Result<()> {
    println!("CPU time; shortest of three runs, of one for the hardest row");
    println!(
        "planted of 1000  joined  largest  batch ms  all inserts ms  ratio  99th percentile us  slowest us"
    );
    // The hardest graphs take seconds, so they are left to those who ask for a seed.
    let named = std::env::args().len() > 1;
    for (share, inner) in [(100, 1.0), (200, 1.0), (300, 1.0), (100, 0.98), (200, 0.98), (300, 0.98)] {
        if share == 300 && inner < 1.0 && !named {
            continue;
        }
        let runs = if share == 300 && inner < 1.0 { 1 } else { 3 };
        for seed in seeds() {
            row(share, inner, seed, runs)?;
        }
    }
    triples()
}

/// Seeds named on the command line, or one.
fn seeds() -> Vec<u64> {
    let named: Vec<u64> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    if named.is_empty() { vec![7] } else { named }
}

fn row(share: usize, inner: f64, seed: u64, runs: usize) -> anyhow::Result<()> {
    let params = PlantedParams { planted: share, inner, ..PlantedParams::default() };
    let graph = planted(&params, &mut ChaCha8Rng::seed_from_u64(seed))?.graph;
    let arrivals: Vec<Vec<usize>> =
        (0..graph.len()).map(|v| graph.neighbors(v).filter(|&u| u < v).collect()).collect();
    let (mut batch_ms, mut largest) = (f64::INFINITY, 0);
    let (mut total_ms, mut micros) = (f64::INFINITY, vec![f64::INFINITY; arrivals.len()]);
    for _ in 0..runs {
        let start = ProcessTime::now();
        let batch = clique::maximum(&graph, &Budget::UNLIMITED);
        batch_ms = batch_ms.min(milliseconds(start));
        largest = batch.value;

        // Looking at the clock costs a good part of a step, so the whole is timed by itself.
        let mut cliques = Incremental::new(Budget::UNLIMITED);
        let start = ProcessTime::now();
        for near in &arrivals {
            cliques.insert(near)?;
        }
        total_ms = total_ms.min(milliseconds(start));
        anyhow::ensure!(cliques.best().value == batch.value && cliques.best().optimal);

        let mut cliques = Incremental::new(Budget::UNLIMITED);
        for (best, near) in micros.iter_mut().zip(&arrivals) {
            let start = ProcessTime::now();
            cliques.insert(near)?;
            *best = best.min(milliseconds(start) * 1e3);
        }
    }
    micros.sort_by(f64::total_cmp);
    let (p99, slowest) = (micros[micros.len() * 99 / 100], micros[micros.len() - 1]);
    println!(
        "{share:4} joined {inner:4}  {largest:7}  {batch_ms:8.2}  {total_ms:14.2}  {:5.1}  {p99:18.0}  {slowest:10.0}",
        total_ms / batch_ms
    );
    Ok(())
}

fn milliseconds(start: ProcessTime) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// The same for sets that can only be judged three at a time.
fn triples() -> anyhow::Result<()> {
    let (n, mut rng) = (200, ChaCha8Rng::seed_from_u64(3));
    let start = ProcessTime::now();
    let checked = hyperclique::from_checks(n, 3, 3, |_| rng.random_bool(0.1))?;
    let built = milliseconds(start);
    let start = ProcessTime::now();
    let batch = hyperclique::maximum(&checked.hypergraph, &Budget::UNLIMITED);
    let batch_ms = milliseconds(start);

    let mut cliques = hyperclique::Incremental::new(3, Budget::UNLIMITED)?;
    let mut last_ms = 0.0;
    for v in 0..n {
        let pairs = (0..v).flat_map(|b| (0..b).map(move |a| [a, b]));
        let pairs: Vec<[usize; 2]> =
            pairs.filter(|&[a, b]| checked.hypergraph.has_edge(&[a, b, v])).collect();
        let start = ProcessTime::now();
        cliques.insert(&pairs)?;
        last_ms = milliseconds(start);
    }
    anyhow::ensure!(cliques.best().value == batch.value);
    println!(
        "triples, n = {n}, density 0.1: largest {}, {} tests in {built:.1} ms, batch {batch_ms:.1} ms, last insert {last_ms:.2} ms",
        batch.value, checked.tests[3]
    );
    Ok(())
}

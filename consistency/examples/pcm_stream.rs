//! What does it cost to keep the consistent closures of two robots up to date, closure by closure? Seeds may be given.

use cpu_time::ProcessTime;
use draco_consistency::clique::{self, Budget, Incremental};
use draco_consistency::graph::{Adjacency, Graph};
use draco_consistency::simulate::{Label, Planted, SimulatedTeam, planted};
use draco_consistency::{PairTest, Pcm, PcmParams, Pose};
use nalgebra::{Isometry2, Isometry3};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Closures of a team.
const CLOSURES: usize = 1000;

/// Of so many runs the shortest counts: fewer leave errors of a hundredth, as much as a solve.
const RUNS: usize = 15;

fn main() -> anyhow::Result<()> {
    println!(
        "CPU time, shortest of {RUNS} runs: all pair tests, the largest clique of their graph in one batch"
    );
    println!(
        "solve and in {CLOSURES} inserts, {CLOSURES} inserts into `Pcm`, which tests and solves; the slowest of those;"
    );
    println!("million pairs a second where each chi2 is told whole");
    println!(
        "    true  accepted (true)  tests ms  solve ms  clique inserts ms  Pcm inserts ms  99 % us  slowest us  chi2 M/s"
    );
    let named: Vec<u64> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    for seed in if named.is_empty() { vec![7] } else { named } {
        for good in [100, 200, 300] {
            row::<3, Isometry2<f64>>("2d", good, seed)?;
            row::<6, Isometry3<f64>>("3d", good, seed)?;
        }
    }
    Ok(())
}

/// True closures among wrong ones, half of them random and half in runs to places that look alike, in any order.
fn team<const N: usize, G: Pose<N>>(good: usize, seed: u64) -> anyhow::Result<SimulatedTeam<G, N>> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let wrong = CLOSURES - good;
    let aliased_runs = wrong / 2 / Planted::default().run_length;
    let random = wrong - aliased_runs * Planted::default().run_length;
    let mut team = planted::<N, G>(&Planted { good, random, aliased_runs, ..Planted::default() }, rng)?;
    let mut mixed: Vec<_> = team.closures.into_iter().zip(team.labels).collect();
    mixed.shuffle(rng);
    (team.closures, team.labels) = mixed.into_iter().unzip();
    Ok(team)
}

fn row<const N: usize, G: Pose<N>>(name: &str, good: usize, seed: u64) -> anyhow::Result<()> {
    let team = team::<N, G>(good, seed)?;
    let params = PcmParams::default();
    let (mut tests_ms, mut solve_ms, mut inserts_ms) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    let mut micros = vec![f64::INFINITY; CLOSURES];
    let (mut cliques_ms, mut chi2_ms, mut accepted) = (f64::INFINITY, f64::INFINITY, Vec::new());
    for _ in 0..RUNS {
        let start = ProcessTime::now();
        let test = PairTest::new(&team.trajectories, &team.closures, params.probability)?;
        let edges: Vec<(usize, usize)> = pairs(CLOSURES).filter(|&(b, a)| test.agree(b, a)).collect();
        tests_ms = tests_ms.min(milliseconds(start));
        let start = ProcessTime::now();
        let within = pairs(CLOSURES).filter(|&(b, a)| test.chi2(b, a) <= test.limit()).count();
        chi2_ms = chi2_ms.min(milliseconds(start));
        anyhow::ensure!(within == edges.len());
        let graph = Graph::from_edges(CLOSURES, edges)?;
        let start = ProcessTime::now();
        let batch = clique::maximum(&graph, &Budget::UNLIMITED);
        solve_ms = solve_ms.min(milliseconds(start));

        let arrivals: Vec<Vec<usize>> =
            (0..CLOSURES).map(|v| graph.neighbors(v).filter(|&u| u < v).collect()).collect();
        let mut cliques = Incremental::new(Budget::UNLIMITED);
        let start = ProcessTime::now();
        for near in &arrivals {
            cliques.insert(near)?;
        }
        cliques_ms = cliques_ms.min(milliseconds(start));

        // Looking at the clock costs a good part of a step, so the whole is timed by itself.
        let mut stream = Pcm::new(team.trajectories.clone(), params.clone())?;
        let start = ProcessTime::now();
        for closure in &team.closures {
            stream.insert(closure)?;
        }
        inserts_ms = inserts_ms.min(milliseconds(start));
        accepted = stream.selection().accepted;
        anyhow::ensure!(accepted.len() == batch.value && batch.optimal);

        let mut stream = Pcm::new(team.trajectories.clone(), params.clone())?;
        for (best, closure) in micros.iter_mut().zip(&team.closures) {
            let start = ProcessTime::now();
            stream.insert(closure)?;
            *best = best.min(milliseconds(start) * 1e3);
        }
    }
    micros.sort_by(f64::total_cmp);
    let right = accepted.iter().filter(|&&c| team.labels[c] == Label::Good).count();
    println!(
        "{name}  {good:4}  {:8} ({right:4})  {tests_ms:8.1}  {solve_ms:8.2}  {cliques_ms:17.2}  {inserts_ms:14.1}  {:7.0}  {:10.0}  {:8.1}",
        accepted.len(),
        micros[CLOSURES * 99 / 100],
        micros[CLOSURES - 1],
        pairs(CLOSURES).count() as f64 / chi2_ms / 1e3
    );
    Ok(())
}

fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(|a| (0..a).map(move |b| (b, a)))
}

fn milliseconds(start: ProcessTime) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

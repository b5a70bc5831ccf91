//! Largest or heaviest clique of graph files, one line of JSON a file.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::{Parser, ValueEnum};
use cpu_time::ProcessTime;
use draco_consistency::clique::{self, Budget};
use draco_consistency::graph::{Adjacency, FileGraph, Graph, read_dimacs_smaller, read_matrix_market};
use serde_json::json;

/// Largest or heaviest clique of DIMACS `.clq` and MatrixMarket `.mtx` files, as JSON lines.
#[derive(Parser)]
struct Options {
    /// Threads of the search; without the feature `rayon` it runs on one.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Seconds of wall time a file; without it the search runs to its proof.
    #[arg(long, value_name = "S")]
    time_limit: Option<f64>,
    /// Vertex weights instead of counting vertices: `mod200` gives vertex i, from one, the weight (i mod 200) + 1.
    #[arg(long)]
    weights: Option<Weights>,
    /// Graphs to solve.
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Weights {
    Mod200,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("max_clique: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    let options = Options::parse();
    let time = options.time_limit.map(Duration::try_from_secs_f64).transpose().context("--time-limit")?;
    let budget = Budget { nodes: None, time };
    in_threads(options.threads, || {
        options.files.iter().try_for_each(|path| {
            let line =
                solve(path, options.weights, &budget).with_context(|| format!("{}", path.display()))?;
            println!("{line}");
            Ok(())
        })
    })?
}

#[cfg(feature = "rayon")]
fn in_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(work))
}

#[cfg(not(feature = "rayon"))]
fn in_threads<T>(threads: usize, work: impl FnOnce() -> T) -> Result<T> {
    if threads > 1 {
        // The answer is the same, so this is worth a word and no failure.
        eprintln!("max_clique: one thread; --threads {threads} needs a build with `--features rayon`");
    }
    Ok(work())
}

fn read(path: &std::path::Path) -> Result<FileGraph> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("clq") => Ok(read_dimacs_smaller(path)?),
        Some("mtx") => Ok(FileGraph::Sparse(read_matrix_market(path)?)),
        _ => bail!("neither .clq nor .mtx"),
    }
}

fn solve(path: &std::path::Path, weights: Option<Weights>, budget: &Budget) -> Result<serde_json::Value> {
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    let graph = match read(path)? {
        // Bit rows pay off as soon as the graph is not very sparse.
        FileGraph::Sparse(graph) if graph.len() <= 4096 => FileGraph::Dense(Graph::from_sparse(&graph)?),
        graph => graph,
    };
    let mod200 = |n: usize| weights.map(|_| (1..=n).map(|i| (i % 200 + 1) as f64).collect::<Vec<_>>());
    match graph {
        FileGraph::Dense(mut graph) => {
            if let Some(given) = mod200(graph.len()) {
                graph = graph.with_weights(&given)?;
            }
            report(path, &graph, weights, budget, wall, cpu)
        }
        FileGraph::Sparse(mut graph) => {
            if let Some(given) = mod200(graph.len()) {
                graph = graph.with_weights(&given)?;
            }
            report(path, &graph, weights, budget, wall, cpu)
        }
    }
}

fn report<A: Adjacency + Sync>(
    path: &std::path::Path,
    graph: &A,
    weights: Option<Weights>,
    budget: &Budget,
    wall: Instant,
    cpu: ProcessTime,
) -> Result<serde_json::Value> {
    let (vertices, upper_bound, optimal, nodes) = if weights.is_some() {
        let best = clique::maximum_weight(graph, budget);
        (best.vertices, best.upper_bound, best.optimal, best.nodes)
    } else {
        let best = clique::maximum(graph, budget);
        (best.vertices, best.upper_bound as f64, best.optimal, best.nodes)
    };
    Ok(json!({
        "file": path.display().to_string(),
        "n": graph.len(),
        "m": graph.edge_count(),
        "omega": vertices.len(),
        "weight": graph.total_weight(&vertices),
        "optimal": optimal,
        "upper_bound": upper_bound,
        "clique": vertices.iter().map(|v| v + 1).collect::<Vec<_>>(),
        "nodes": nodes,
        "cpu_ms": cpu.elapsed().as_secs_f64() * 1e3,
        "wall_ms": wall.elapsed().as_secs_f64() * 1e3,
    }))
}

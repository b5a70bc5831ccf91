//! Is the map globally optimal, or did the solver end in a valley? And if so, how to get out?
//!
//! Without arguments: a ring of poses, from a good and a wound start, and the staircase out of the valley.
//! `certify FILE.g2o...`: each file's certified optimum of the chordal objective from the chordal start, one JSON line
//! each, with CPU times, medians of some runs each on a graph just read: the search for the optimum; a Gauss-Newton
//! iteration (an eighth of what nine take longer than one) and the first, which has to order and analyse; the chordal
//! start alone, and what it adds to the solver's first iteration after it, which takes its order over; the certificate
//! alone, and after the solver, whose order it takes over. `..._iterations`: the latter in Gauss-Newton iterations.
//! `certify --random SEED FILE.g2o...`: the staircase from poses drawn at random instead, and where descent alone ends
//! from there.

use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{
    ChordalPose, Error, Kernel, Key, Method, PoseGraph, PoseGraph2, PoseGraph3, SolveParams, StaircaseParams,
    Start, certify, chordal, chordal_objective, solve, staircase,
};
use nalgebra::{Isometry2, Matrix3, SVector, Vector2};
use rand::{RngExt, SeedableRng};

const POSES: u64 = 20;
/// Runs, of which the median counts.
const RUNS: usize = 21;

fn main() -> Result<(), Error> {
    let mut files: Vec<String> = std::env::args().skip(1).collect();
    let seed = if files.first().is_some_and(|first| first == "--random") {
        files.drain(..2.min(files.len())).nth(1).and_then(|seed| seed.parse::<u64>().ok())
    } else {
        None
    };
    for file in &files {
        match (g2o::read(file)?, seed) {
            (AnyGraph::Two(_), None) => measure(|| planar(file), file)?,
            (AnyGraph::Three(_), None) => measure(|| spatial(file), file)?,
            (AnyGraph::Two(graph), Some(seed)) => climb(graph, file, seed)?,
            (AnyGraph::Three(graph), Some(seed)) => climb(graph, file, seed)?,
        }
    }
    if files.is_empty() { rings() } else { Ok(()) }
}

fn planar(file: &str) -> Result<PoseGraph2, Error> {
    match g2o::read(file)? {
        AnyGraph::Two(graph) => Ok(graph),
        AnyGraph::Three(_) => Err(Error::EmptyGraph),
    }
}

fn spatial(file: &str) -> Result<PoseGraph3, Error> {
    match g2o::read(file)? {
        AnyGraph::Three(graph) => Ok(graph),
        AnyGraph::Two(_) => Err(Error::EmptyGraph),
    }
}

fn rings() -> Result<(), Error> {
    println!("start      objective   certified");
    let turn = std::f64::consts::TAU / POSES as f64;
    // headings that wind once too often around the ring are a valley of their own
    let mut graph = ring(|i| 2.0 * turn * i as f64)?;
    report("wound", &graph)?;
    let climbed = staircase(&graph, &StaircaseParams::default())?;
    println!("staircase from there climbs to rank {}", climbed.rank);
    let mut top = graph.clone();
    top.update(&climbed.solution);
    report("climbed", &top)?;
    chordal(&mut graph)?;
    report("chordal", &graph)
}

/// CPU time of a run on `at`, in milliseconds.
fn time<S>(mut at: S, run: impl FnOnce(&mut S) -> Result<(), Error>) -> Result<f64, Error> {
    let start = cpu_ms();
    run(&mut at)?;
    Ok(cpu_ms() - start)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Every graph that `read` gives is one of which nothing is known, not even the order of elimination.
fn measure<const N: usize, G: ChordalPose<N>>(
    read: impl Fn() -> Result<PoseGraph<G, N>, Error>,
    file: &str,
) -> Result<(), Error> {
    let mut relaxed = read()?;
    chordal(&mut relaxed)?;
    let begin = cpu_ms();
    let found = staircase(&relaxed, &StaircaseParams::default())?;
    let search_ms = cpu_ms() - begin;
    let steps = |count| SolveParams {
        method: Method::GaussNewton,
        start: Start::Given,
        max_iterations: count,
        relative_tolerance: 0.0,
        absolute_tolerance: 0.0,
        ..SolveParams::default()
    };
    let place = |at: &PoseGraph<G, N>| {
        let mut graph = read()?;
        at.poses().try_for_each(|(key, pose)| graph.set_pose(key, *pose))?;
        Ok(graph)
    };
    let iterate = |graph: &PoseGraph<G, N>, count| solve(graph, &steps(count)).map(drop);
    let both = |graph: &mut PoseGraph<G, N>| chordal(graph).and_then(|()| iterate(graph, 1));
    let (mut one, mut relax) = (Vec::new(), Vec::new());
    let (mut iteration, mut added) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        // side by side, so that both have the same clock
        let first = time(place(&relaxed)?, |graph| iterate(graph, 1))?;
        added.push(time(read()?, both)? - first);
        iteration.push((time(place(&relaxed)?, |graph| iterate(graph, 9))? - first) / 8.0);
        relax.push(time(read()?, |graph| chordal(graph))?);
        one.push(first);
    }
    let [one, relax_ms, iteration_ms, chordal_ms] = [one, relax, iteration, added].map(median);
    let mut best = relaxed.clone();
    best.update(&found.solution);
    let (mut after, mut alone) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        let solved = place(&best)?;
        iterate(&solved, 1)?;
        after.push(time(solved, |graph| certify(graph).map(drop))?);
        alone.push(time(place(&best)?, |graph| certify(graph).map(drop))?);
    }
    let [certify_ms, certify_alone_ms] = [after, alone].map(median);
    let certificate = found.certificate;
    println!(
        "{{\"file\":{file:?},\"objective\":{},\"slack\":{},\"gap\":{},\"rank\":{},\"steps\":{},\
         \"search_ms\":{search_ms:.1},\"iteration_ms\":{iteration_ms:.3},\"first_iteration_ms\":{one:.3},\
         \"chordal_alone_ms\":{relax_ms:.3},\"chordal_ms\":{chordal_ms:.3},\"chordal_iterations\":{:.2},\
         \"certify_alone_ms\":{certify_alone_ms:.3},\"certify_ms\":{certify_ms:.3},\"certify_iterations\":{:.2}}}",
        certificate.objective,
        certificate.slack.map_or("null".into(), |x| format!("{x:e}")),
        certificate.gap.map_or("null".into(), |x| format!("{x:e}")),
        found.rank,
        found.solution.iterations,
        chordal_ms / iteration_ms,
        certify_ms / iteration_ms,
    );
    Ok(())
}

fn climb<const N: usize, G: ChordalPose<N>>(
    mut graph: PoseGraph<G, N>,
    file: &str,
    seed: u64,
) -> Result<(), Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    for key in keys {
        let xi = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-3.0..3.0));
        graph.set_pose(key, G::exp(&xi))?;
    }
    let begin = cpu_ms();
    let flat = StaircaseParams { max_rank: 0, ..StaircaseParams::default() };
    let valley = staircase(&graph, &flat)?;
    let middle = cpu_ms();
    let top = staircase(&graph, &StaircaseParams::default())?;
    println!(
        "{{\"file\":{file:?},\"seed\":{seed},\"valley\":{},\"valley_certified\":{},\"valley_ms\":{:.0},\
         \"objective\":{},\"certified\":{},\"rank\":{},\"steps\":{},\"climb_ms\":{:.0}}}",
        valley.certificate.objective,
        valley.certificate.slack.is_some(),
        middle - begin,
        top.certificate.objective,
        top.certificate.slack.is_some(),
        top.rank,
        top.solution.iterations,
        cpu_ms() - middle,
    );
    Ok(())
}

/// CPU time of this process so far.
fn cpu_ms() -> f64 {
    cpu_time::ProcessTime::now().as_duration().as_secs_f64() * 1e3
}

fn ring(heading: impl Fn(u64) -> f64) -> Result<PoseGraph2, Error> {
    let mut graph = PoseGraph2::new();
    for i in 0..POSES {
        graph.add_pose(Key::new(0, i), Isometry2::new(Vector2::zeros(), heading(i)))?;
    }
    let step = Isometry2::new(Vector2::new(1.0, 0.02), std::f64::consts::TAU / POSES as f64 + 0.01);
    for i in 0..POSES {
        let (a, b) = (Key::new(0, i), Key::new(0, (i + 1) % POSES));
        graph.add_between(a, b, step, Matrix3::from_diagonal_element(100.0), Kernel::None)?;
    }
    Ok(graph)
}

fn report(start: &str, graph: &PoseGraph2) -> Result<(), Error> {
    let mut graph = graph.clone();
    let params = SolveParams { start: Start::Given, ..SolveParams::default() };
    let solution = solve(&chordal_objective(&graph)?, &params)?;
    graph.update(&solution);
    let certificate = certify(&graph)?;
    let verdict = match certificate.slack {
        Some(_) => format!("yes, within {:.0e} of the optimum", certificate.gap.unwrap_or(f64::NAN)),
        None => "no".into(),
    };
    println!("{start:8}  {:9.4}   {verdict}", certificate.objective);
    Ok(())
}

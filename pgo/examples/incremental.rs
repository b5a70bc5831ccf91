//! How much does it cost to follow a graph while it grows? Replays a g2o file pose by pose.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::process::ExitCode;

use cpu_time::ProcessTime;
use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{
    ChordalPose, FactorId, Incremental, IncrementalMode, IncrementalParams, Kernel, Key, Measurement,
    PoseGraph, PoseGraph2, SolveParams, chordal, solve,
};
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

const USAGE: &str = "usage: incremental [--exact] [--relinearize X] [--wildfire X] [FILE.g2o...]

One JSON line a file: one update per pose in id order, each pose started from the present estimate of a neighbour;
cpu_ms is that of all updates, chi2 = 1/2 sum e' W e at the end, batch_chi2 that of the batch optimum. Without a
file: a simulated walk on a grid.";

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("incremental: {reason}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut params = IncrementalParams::default();
    let mut files = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--help" | "-h" => {
                println!("{USAGE}");
                return Ok(());
            }
            "--exact" => params.mode = IncrementalMode::Exact,
            "--relinearize" => params.relinearize_threshold = arguments.next().ok_or(USAGE)?.parse()?,
            "--wildfire" => params.wildfire_threshold = arguments.next().ok_or(USAGE)?.parse()?,
            flag if flag.starts_with('-') => {
                eprintln!("incremental: unknown option {flag}\n{USAGE}");
                std::process::exit(2);
            }
            file => files.push(file.to_owned()),
        }
    }
    if files.is_empty() {
        replay("walk", &walk(1500)?, &params)?;
    }
    for file in files {
        match g2o::read(&file)? {
            AnyGraph::Two(graph) => replay(&file, &graph, &params)?,
            AnyGraph::Three(graph) => replay(&file, &graph, &params)?,
        }
    }
    Ok(())
}

fn replay<const N: usize, G: ChordalPose<N>>(
    name: &str,
    graph: &PoseGraph<G, N>,
    params: &IncrementalParams,
) -> Result<(), Box<dyn std::error::Error>> {
    let poses: Vec<(Key, G)> = graph.poses().map(|(key, pose)| (key, *pose)).collect();
    // factors by the later of their poses
    let mut arriving: Vec<(Key, FactorId)> = graph
        .factors()
        .filter_map(|(id, factor)| factor.keys().into_iter().max().map(|key| (key, id)))
        .collect();
    arriving.sort_unstable();
    let mut smoother = Incremental::new(params.clone())?;
    let (mut next, mut eliminated, mut relinearised, mut slowest) = (0, 0, 0, 0.0);
    let start = ProcessTime::now();
    for (at, (key, first)) in poses.iter().enumerate() {
        let begin = ProcessTime::now();
        let from = next;
        while arriving.get(next).is_some_and(|(k, _)| k == key) {
            next += 1;
        }
        let factors = arriving[from..next].iter().filter_map(|(_, id)| graph.factor(*id));
        if at == 0 {
            smoother.add_fixed_pose(*key, *first)?;
        } else {
            let mut guess = None;
            for factor in factors.clone() {
                let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
                let (other, step) = if to == key { (from, *measured) } else { (to, measured.inverse()) };
                // the nearest neighbour in time has drifted least
                if guess.is_none_or(|(k, _)| *other > k)
                    && let Some(pose) = smoother.graph().pose(*other)
                {
                    guess = Some((*other, pose.compose(&step)));
                }
            }
            smoother.add_pose(*key, guess.map_or(*first, |(_, pose)| pose))?;
        }
        for factor in factors {
            if let Measurement::Between { from, to, measured } = &factor.measurement {
                smoother.add_between(*from, *to, *measured, factor.information, factor.kernel)?;
            }
        }
        let report = smoother.update()?;
        eliminated += report.eliminated;
        relinearised += report.relinearised;
        slowest = f64::max(slowest, begin.elapsed().as_secs_f64() * 1e3);
    }
    let cpu = start.elapsed().as_secs_f64() * 1e3;
    let mut relaxed = graph.clone();
    chordal(&mut relaxed)?;
    let batch = solve(&relaxed, &SolveParams::default())?.final_cost;
    let chi2 = smoother.graph().cost();
    println!(
        "{{\"file\":{name:?},\"updates\":{},\"mode\":\"{:?}\",\"cpu_ms\":{cpu:.1},\"slowest_ms\":{slowest:.2},\
         \"eliminated\":{eliminated},\"relinearised\":{relinearised},\"chi2\":{chi2},\"batch_chi2\":{batch}}}",
        poses.len(),
        params.mode,
    );
    Ok(())
}

/// A walk of 1 m steps over a grid of 10 m squares, with noisy odometry and a closure wherever a place is met
/// again.
fn walk(steps: u64) -> Result<PoseGraph2, draco_pgo::Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let deviations = Vector3::new(0.02, 0.02, 0.005);
    let information = Matrix3::from_diagonal(&deviations.map(|d| 1.0 / (d * d)));
    let mut graph = PoseGraph2::new();
    let mut truth: Vec<Isometry2<f64>> = vec![Isometry2::identity()];
    let mut seen = BTreeMap::new();
    for i in 0..steps {
        let key = Key::new(0, i);
        let at = truth[i as usize];
        graph.add_pose(key, at)?;
        let place = (at.translation.x.round() as i64, at.translation.y.round() as i64);
        let others = [i.checked_sub(1), seen.insert(place, i).filter(|other| other + 1 < i)];
        for other in others.into_iter().flatten() {
            let noise = deviations.map(|d| d * rng.sample::<f64, _>(StandardNormal));
            let measured = truth[other as usize].between(&at).plus(&noise);
            graph.add_between(Key::new(0, other), key, measured, information, Kernel::None)?;
        }
        let turn = if i % 10 == 9 { f64::from(rng.random_range(-1..=1)) * FRAC_PI_2 } else { 0.0 };
        truth.push(at * Isometry2::new(Vector2::new(1.0, 0.0), turn));
    }
    Ok(graph)
}

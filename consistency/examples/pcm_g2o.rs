//! Which inter-robot loop closures of a team agree? Reads one g2o file a robot, prints one line of JSON.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Parser;
use cpu_time::ProcessTime;
use draco_consistency::{Closure, PcmParams, Pose, PoseKey, Trajectories, Trajectory, pcm};
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Key, Measurement, PoseGraph};
use nalgebra::SMatrix;
use serde_json::{Value, json};

/// Pairwise consistent loop closures of a team, as one JSON line.
///
/// An edge between consecutive poses of one robot is odometry, every other edge a closure; an edge that stands in the
/// files of both its robots counts once.
#[derive(Parser)]
struct Options {
    /// Share of true pairs that shall pass the pair test.
    #[arg(long, default_value_t = 0.99)]
    confidence: f64,
    /// Least size of a set of closures that is believed.
    #[arg(long, default_value_t = 1)]
    minimum: usize,
    /// One g2o file a robot.
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let start = ProcessTime::now();
    let (mut two, mut three) = (Vec::new(), Vec::new());
    for path in &options.files {
        match read_team_file(path).with_context(|| path.display().to_string())? {
            AnyGraph::Two(graph) => two.push(graph),
            AnyGraph::Three(graph) => three.push(graph),
        }
    }
    let read = start.elapsed();
    let line = match (two.is_empty(), three.is_empty()) {
        (false, true) => solve(&two, &options, read.as_secs_f64())?,
        (true, false) => solve(&three, &options, read.as_secs_f64())?,
        _ => bail!("the files hold poses of the plane and of space"),
    };
    println!("{line}");
    Ok(())
}

/// Reads a g2o file. Lines that start with a number are no g2o; one published file has such a torn line, which is
/// told and passed over.
fn read_team_file(path: &Path) -> Result<AnyGraph> {
    let text = std::fs::read_to_string(path)?;
    let is_torn = |line: &str| line.trim_start().starts_with(|c: char| c.is_ascii_digit());
    for (number, _) in text.lines().enumerate().filter(|(_, line)| is_torn(line)) {
        eprintln!("{}: line {} has no tag and is passed over", path.display(), number + 1);
    }
    let kept: Vec<&str> = text.lines().map(|line| if is_torn(line) { "" } else { line }).collect();
    Ok(g2o::parse_any(&kept.join("\n"))?)
}

fn solve<const N: usize, G: Pose<N>>(
    graphs: &[PoseGraph<G, N>],
    options: &Options,
    read_s: f64,
) -> Result<Value> {
    let start = ProcessTime::now();
    let team = Team::merge(graphs)?;
    let params =
        PcmParams { probability: options.confidence, minimum: options.minimum, ..PcmParams::default() };
    let selection = pcm(&team.trajectories, &team.closures, &params)?;
    let cpu_ms = start.elapsed().as_secs_f64() * 1e3;

    let mut pairs: BTreeMap<(u32, u32), (usize, usize)> = BTreeMap::new();
    for (index, closure) in team.closures.iter().enumerate() {
        let counts = pairs.entry(closure.robots()).or_default();
        counts.0 += 1;
        counts.1 += usize::from(selection.accepts(index));
    }
    let pairs: Vec<Value> = pairs
        .iter()
        .map(|((a, b), (closures, accepted))| {
            json!({ "robots": [a, b], "closures": closures, "accepted": accepted, "rejected": closures - accepted })
        })
        .collect();
    let rejected: Vec<Value> = selection
        .rejected
        .iter()
        .map(|r| {
            let (from, to) = team.names[r.closure];
            json!({ "from": from.to_string(), "to": to.to_string(), "reason": r.reason.to_string() })
        })
        .collect();
    Ok(json!({
        "closures": team.closures.len(),
        "accepted": selection.accepted.len(),
        "rejected": rejected.len(),
        "pairs": pairs,
        "rejected_edges": rejected,
        "cpu_ms": cpu_ms,
        "read_cpu_ms": read_s * 1e3,
    }))
}

/// The measurements of all files.
struct Team<G, const N: usize> {
    trajectories: Trajectories<G, N>,
    closures: Vec<Closure<G, N>>,
    /// The keys of each closure as the files name them.
    names: Vec<(Key, Key)>,
}

impl<G: Pose<N>, const N: usize> Team<G, N> {
    fn merge(graphs: &[PoseGraph<G, N>]) -> Result<Self> {
        let mut steps: BTreeMap<Key, (G, SMatrix<f64, N, N>)> = BTreeMap::new();
        let mut edges = BTreeMap::new();
        let mut keys: BTreeSet<Key> = BTreeSet::new();
        for (_, factor) in graphs.iter().flat_map(|graph| graph.factors()) {
            let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
            let covariance = factor
                .information
                .try_inverse()
                .with_context(|| format!("edge {from} to {to}: the information matrix is singular"))?;
            keys.extend([*from, *to]);
            if from.robot == to.robot && to.index == from.index + 1 {
                steps.insert(*from, (*measured, covariance));
            } else {
                edges.insert((*from, *to), (*measured, covariance));
            }
        }
        let mut places: BTreeMap<Key, PoseKey> = BTreeMap::new();
        let mut trajectories = Trajectories::new();
        let robots: BTreeSet<u32> = keys.iter().map(|key| key.robot).collect();
        for robot in robots {
            let own: Vec<Key> = keys.iter().filter(|key| key.robot == robot).copied().collect();
            trajectories.insert(robot, chain(&own, &steps)?);
            places.extend(own.iter().enumerate().map(|(index, key)| (*key, PoseKey::new(robot, index))));
        }
        let mut closures = Vec::new();
        let mut names = Vec::new();
        for ((from, to), (measured, covariance)) in edges {
            // an edge holds `to` seen from `from`
            let (target, source) = (places[&from], places[&to]);
            closures.push(Closure { source, target, target_from_source: measured, covariance });
            names.push((from, to));
        }
        Ok(Self { trajectories, closures, names })
    }
}

/// One robot's poses by composing its odometry.
fn chain<const N: usize, G: Pose<N>>(
    own: &[Key],
    steps: &BTreeMap<Key, (G, SMatrix<f64, N, N>)>,
) -> Result<Trajectory<G, N>> {
    let mut poses = vec![G::identity()];
    let mut covariances = Vec::new();
    for pair in own.windows(2) {
        let step = steps.get(&pair[0]).filter(|_| pair[1].index == pair[0].index + 1);
        let (measured, covariance) =
            step.with_context(|| format!("no odometry from {} to {}", pair[0], pair[1]))?;
        poses.push(poses[poses.len() - 1].compose(measured).renormalize());
        covariances.push(*covariance);
    }
    Ok(Trajectory::from_steps(poses, &covariances)?)
}

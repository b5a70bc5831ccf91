//! How many false loop closures can a map stand? Random closures are added to a drive, or to g2o files, and told
//! from the true ones.
//!
//! Without arguments: a Manhattan-like drive, by plain least squares and by graduated non-convexity.
//! `outliers_gnc [--ipc] [--seed N] [--shares 0,50] [--write DIR] FILE...`: each file with so many percent (0, 50, 70, 90)
//! of its closures false, one JSON line each, by graduated non-convexity or incremental consensus; `--write` stores the
//! spoiled graphs, false closures last, as DIR/<name>.<percent>.<seed>.g2o.

use std::path::{Path, PathBuf};
use std::time::Instant;

use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph, G2oPose};
use draco_pgo::{
    FactorId, GncParams, IpcParams, Kernel, Key, PoseGraph, PoseGraph2, SolveParams, gnc, ipc, solve,
};
use nalgebra::{Isometry2, Matrix3, SVector, Vector3};
use rand::{RngExt, SeedableRng};

const POSES: u64 = 400;
const SHARES: [f64; 4] = [0.0, 0.5, 0.7, 0.9];

/// What to do with files.
struct Options {
    ipc: bool,
    seed: u64,
    shares: Vec<f64>,
    write: Option<PathBuf>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = Options { ipc: false, seed: 1, shares: SHARES.to_vec(), write: None };
    let mut files: Vec<PathBuf> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--ipc" => options.ipc = true,
            "--seed" => options.seed = value()?.parse()?,
            "--shares" => {
                let percent = |s: &str| s.parse::<f64>().map(|percent| percent / 100.0);
                options.shares = value()?.split(',').map(percent).collect::<Result<_, _>>()?;
            }
            "--write" => options.write = Some(value()?.into()),
            _ => files.push(argument.into()),
        }
    }
    if files.is_empty() {
        println!("outliers  found  precision  recall  rms plain [m]  rms gnc [m]");
        SHARES.into_iter().try_for_each(drive)?;
    }
    for file in files {
        for share in &options.shares {
            match g2o::read(&file)? {
                AnyGraph::Two(graph) => spoil(graph, &file, *share, &options)?,
                AnyGraph::Three(graph) => spoil(graph, &file, *share, &options)?,
            }
        }
    }
    Ok(())
}

/// Adds `share` of false closures to the true ones of a file, consecutive poses being joined by odometry.
fn spoil<const N: usize, G: G2oPose<N>>(
    mut graph: PoseGraph<G, N>,
    file: &Path,
    share: f64,
    options: &Options,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(options.seed);
    let mut params = GncParams::default();
    let mut closures: Vec<FactorId> = Vec::new();
    for (id, factor) in graph.factors() {
        match factor.keys().as_slice() {
            [a, b] if a.index.abs_diff(b.index) == 1 => drop(params.known_inliers.insert(id)),
            _ => closures.push(id),
        }
    }
    let first = closures.first().and_then(|id| graph.factor(*id)).ok_or("no closure")?;
    let information = first.information;
    let n = graph.pose_count() as u64;
    for _ in 0..(closures.len() as f64 * share / (1.0 - share)).round() as usize {
        let (i, j) = (rng.random_range(0..n / 2), rng.random_range(n / 2 + 2..n));
        let xi = SVector::<f64, N>::from_fn(|r, _| {
            let size = if r < N.div_ceil(2) { 5.0 } else { 1.5 };
            rng.random_range(-size..size)
        });
        graph.add_between(Key::new(0, i), Key::new(0, j), G::exp(&xi), information, Kernel::None)?;
    }
    let name = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let percent = (100.0 * share).round();
    if let Some(folder) = &options.write {
        std::fs::create_dir_all(folder)?;
        g2o::write(&graph, folder.join(format!("{name}.{percent}.{}.g2o", options.seed)))?;
    }
    let (wall, cpu) = (Instant::now(), cpu_ms());
    let (accepted, rounds) = if options.ipc {
        (ipc(&graph, &params.known_inliers, &IpcParams::default())?.accepted, closures.len())
    } else {
        let found = gnc(&graph, &params)?;
        let known = &params.known_inliers;
        (found.inliers.into_iter().filter(|id| !known.contains(id)).collect(), found.rounds)
    };
    let (cpu, wall) = (cpu_ms() - cpu, wall.elapsed().as_secs_f64() * 1e3);
    let right = accepted.iter().filter(|id| closures.binary_search(id).is_ok()).count();
    println!(
        "{{\"method\":{:?},\"file\":{name:?},\"outliers_percent\":{percent},\"seed\":{},\"true\":{},\"false\":{},\
         \"accepted\":{},\"precision\":{:.4},\"recall\":{:.4},\"rounds\":{rounds},\"cpu_ms\":{cpu:.1},\
         \"wall_ms\":{wall:.1}}}",
        if options.ipc { "ipc" } else { "gnc" },
        options.seed,
        closures.len(),
        graph.factor_count() - closures.len() - params.known_inliers.len(),
        accepted.len(),
        right as f64 / accepted.len().max(1) as f64,
        right as f64 / closures.len() as f64,
    );
    Ok(())
}

/// CPU time of this process so far.
fn cpu_ms() -> f64 {
    cpu_time::ProcessTime::now().as_duration().as_secs_f64() * 1e3
}

fn truth(index: u64) -> Isometry2<f64> {
    let mut pose = Isometry2::identity();
    for i in 0..index {
        let turn =
            if i % 10 == 9 { std::f64::consts::FRAC_PI_2 * if i % 40 < 30 { 1.0 } else { 2.0 } } else { 0.0 };
        pose *= Isometry2::new(nalgebra::Vector2::new(1.0, 0.0), turn);
    }
    pose
}

fn drive(share: f64) -> Result<(), draco_pgo::Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let sigma = Vector3::new(0.03, 0.03, 0.005);
    let information = Matrix3::from_diagonal(&sigma.map(|s| 1.0 / (s * s)));
    let poses: Vec<Isometry2<f64>> = (0..POSES).map(truth).collect();
    let mut noise = || sigma.map(|s| s * rng.sample::<f64, _>(rand_distr::StandardNormal));
    let mut graph = PoseGraph2::new();
    let mut params = GncParams::default();
    let mut at = Isometry2::identity();
    graph.add_pose(Key::new(0, 0), at)?;
    for i in 1..POSES {
        let z = poses[i as usize - 1].between(&poses[i as usize]).plus(&noise());
        at *= z;
        graph.add_pose(Key::new(0, i), at)?;
        let id = graph.add_between(Key::new(0, i - 1), Key::new(0, i), z, information, Kernel::None)?;
        params.known_inliers.insert(id);
    }
    let mut right = Vec::new();
    for i in 0..POSES {
        for j in (i + 10..POSES).step_by(3) {
            let z = poses[i as usize].between(&poses[j as usize]);
            if z.translation.vector.norm() < 1.5 && right.len() < 150 {
                let z = z.plus(&noise());
                right.push(graph.add_between(
                    Key::new(0, i),
                    Key::new(0, j),
                    z,
                    information,
                    Kernel::None,
                )?);
            }
        }
    }
    let wrong = (right.len() as f64 * share / (1.0 - share)).round() as usize;
    for _ in 0..wrong {
        let (i, j) = (rng.random_range(0..POSES / 2), rng.random_range(POSES / 2 + 2..POSES));
        let xi = Vector3::new(
            rng.random_range(-5.0..5.0),
            rng.random_range(-5.0..5.0),
            rng.random_range(-3.0..3.0),
        );
        graph.add_between(Key::new(0, i), Key::new(0, j), Isometry2::exp(&xi), information, Kernel::None)?;
    }
    let plain = solve(&graph, &SolveParams::default())?;
    let robust = gnc(&graph, &params)?;
    let rms = |pose: &dyn Fn(Key) -> Option<Isometry2<f64>>| {
        let error = |i: u64| {
            pose(Key::new(0, i))
                .map_or(0.0, |x| (x.translation.vector - poses[i as usize].translation.vector).norm_squared())
        };
        ((0..POSES).map(error).sum::<f64>() / POSES as f64).sqrt()
    };
    let kept = robust.inliers.iter().filter(|id| !params.known_inliers.contains(id)).count();
    let true_kept = robust.inliers.iter().filter(|id| right.contains(id)).count();
    println!(
        "{:7.0} %  {kept:5}  {:9.3}  {:6.3}  {:13.3}  {:11.3}",
        100.0 * share,
        true_kept as f64 / kept.max(1) as f64,
        true_kept as f64 / right.len() as f64,
        rms(&|key| plain.pose(key).copied()),
        rms(&|key| robust.solution.pose(key).copied()),
    );
    Ok(())
}

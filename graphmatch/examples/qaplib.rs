//! How near does robust tabu search come to the known optima of QAPLIB, and how fast?
//!
//! usage: qaplib [FOLDER [SEEDS]]   (NAME.dat and NAME.sol.txt: size, optimum, permutation)
//!
//! With several seeds: how many reach the optimum, and the worst gap and time.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use draco_graphmatch::{FaqParams, Qap, TabuParams, faq, robust_tabu};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn main() -> Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || {
            let root = std::env::var_os("DRACO_DATA").map_or_else(
                || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
                PathBuf::from,
            );
            root.join("graphmatch/qaplib")
        },
        PathBuf::from,
    );
    if !folder.is_dir() {
        println!("{} is not there: give the folder of the instances", folder.display());
        return Ok(());
    }
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .filter(|path| path.extension().is_some_and(|e| e == "dat"))
        .collect();
    files.sort();
    let seeds = std::env::args().nth(2).map_or(Ok(1), |seeds| seeds.parse()).context("SEEDS is a number")?;
    println!("name       n    optimum  reached  worst_gap_%  faq_gap_%  worst_ms");
    for file in files {
        solve(&file, seeds).with_context(|| format!("solving {}", file.display()))?;
    }
    Ok(())
}

fn solve(file: &Path, seeds: u64) -> Result<()> {
    let problem = Qap::from_qaplib(&std::fs::read_to_string(file)?)?;
    let answer = std::fs::read_to_string(file.with_extension("sol.txt"))?.replace(',', " ");
    let optimum: f64 = answer.split_whitespace().nth(1).context("no optimum")?.parse()?;
    let gap = |cost: f64| 100.0 * (cost - optimum) / optimum;
    let (mut reached, mut worst_gap, mut worst_ms) = (0, 0.0, 0.0);
    for seed in 1..=seeds {
        let start = Instant::now();
        let found = robust_tabu(&problem, &TabuParams::default(), &mut ChaCha8Rng::seed_from_u64(seed));
        worst_ms = f64::max(worst_ms, 1e3 * start.elapsed().as_secs_f64());
        worst_gap = f64::max(worst_gap, gap(found.cost));
        reached += u64::from(found.cost <= optimum);
    }
    let relaxed = gap(faq(&problem, &FaqParams::default())?.cost);
    println!(
        "{:9} {:3} {optimum:10} {reached:4}/{seeds:<3} {worst_gap:12.3} {relaxed:10.2} {worst_ms:9.0}",
        file.file_stem().unwrap_or_default().to_string_lossy(),
        problem.size(),
    );
    Ok(())
}

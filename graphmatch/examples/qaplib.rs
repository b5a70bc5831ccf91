//! How near does robust tabu search come to the known optima of QAPLIB, and how fast?
//!
//! usage: qaplib [FOLDER]   (NAME.dat and NAME.sol.txt: size, optimum, permutation)

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
    println!("name       n    optimum      found   gap_%   faq_gap_%     ms");
    for file in files {
        solve(&file).with_context(|| format!("solving {}", file.display()))?;
    }
    Ok(())
}

fn solve(file: &Path) -> Result<()> {
    let problem = Qap::from_qaplib(&std::fs::read_to_string(file)?)?;
    let answer = std::fs::read_to_string(file.with_extension("sol.txt"))?.replace(',', " ");
    let optimum: f64 = answer.split_whitespace().nth(1).context("no optimum")?.parse()?;
    let start = Instant::now();
    let found = robust_tabu(&problem, &TabuParams::default(), &mut ChaCha8Rng::seed_from_u64(1));
    let ms = 1e3 * start.elapsed().as_secs_f64();
    let relaxed = faq(&problem, &FaqParams::default())?;
    let gap = |cost: f64| 100.0 * (cost - optimum) / optimum;
    println!(
        "{:9} {:3} {optimum:10} {:10} {:7.3} {:11.2} {ms:6.0}",
        file.file_stem().unwrap_or_default().to_string_lossy(),
        problem.size(),
        found.cost,
        gap(found.cost),
        gap(relaxed.cost)
    );
    Ok(())
}

//! How long does an assignment take? Reads cost matrices (npy, float64, C order) and prints one JSON line each.

#[path = "support/npy.rs"]
mod npy;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;
use draco_graphmatch::{Costs, assign};
use npy::read_npy;
use serde_json::json;

/// Solves linear assignment problems.
#[derive(Parser)]
struct Arguments {
    /// Cost matrices as .npy files.
    #[arg(required = true)]
    costs: Vec<PathBuf>,
    /// Times each problem is solved; the best time counts.
    #[arg(long, default_value_t = 3)]
    repeat: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    for file in &arguments.costs {
        let (rows, columns, values) = std::fs::read(file)
            .map_err(Into::into)
            .and_then(|bytes| read_npy(&bytes))
            .with_context(|| format!("reading {}", file.display()))?;
        let (mut best, mut cost) = (f64::INFINITY, f64::NAN);
        for _ in 0..arguments.repeat.max(1) {
            let start = Instant::now();
            cost = assign(Costs::new(rows, columns, &values)?)?.cost;
            best = best.min(start.elapsed().as_secs_f64());
        }
        println!(
            "{}",
            json!({"file": file.display().to_string(), "rows": rows, "cols": columns, "cost": cost, "best_s": best})
        );
    }
    Ok(())
}

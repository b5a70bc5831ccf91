//! How long does an assignment take? Reads cost matrices (npy, float64, C order) and prints one JSON line each.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use draco_graphmatch::{Costs, assign};
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
        let (rows, columns, values) =
            read_npy(file).with_context(|| format!("reading {}", file.display()))?;
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

fn read_npy(path: &Path) -> Result<(usize, usize, Vec<f64>)> {
    let bytes = std::fs::read(path)?;
    ensure!(bytes.starts_with(b"\x93NUMPY"), "not an npy file");
    let wide = *bytes.get(6).context("cut off")? > 1;
    let (from, size) = if wide { (12, 4) } else { (10, 2) };
    let field = bytes.get(8..8 + size).context("cut off")?;
    let length = field.iter().rev().fold(0_usize, |sum, b| (sum << 8) | usize::from(*b));
    let header = std::str::from_utf8(bytes.get(from..from + length).context("cut off header")?)?;
    ensure!(header.contains("'<f8'"), "entries are not little-endian float64");
    ensure!(header.contains("'fortran_order': False"), "not in C order");
    let shape = header.split("'shape':").nth(1).context("no shape")?;
    let inner = shape.split(['(', ')']).nth(1).context("no shape")?;
    let sizes: Vec<usize> = inner
        .split(',')
        .map(str::trim)
        .filter(|s| !s.is_empty())
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    let &[rows, columns] = sizes.as_slice() else { anyhow::bail!("shape {sizes:?} is not a matrix") };
    let values: Vec<f64> = bytes[from + length..]
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
        .collect();
    ensure!(
        rows.checked_mul(columns) == Some(values.len()),
        "{} entries for {rows} × {columns}",
        values.len()
    );
    Ok((rows, columns, values))
}

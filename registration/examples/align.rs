//! Aligns pairs of point files: the contender's side of the registration benchmark.
//!
//! Reads lines `case dim source target reps max_corr init...` on stdin, where `init` is `target_from_source` as
//! 9 (`dim` 2) or 16 (`dim` 3) row-major numbers, or `global T_HALF_WIDTH_M R_HALF_WIDTH_DEG` for a search
//! without a start. Answers a line each: `case iterations ms_total ms_align T(9|16) [cov(9|36)]`, times being
//! medians over `reps`. One default preset a dimension; nothing is chosen by case. A line that cannot be answered
//! gets one line on stderr, the others are answered all the same, and the exit code is 1.

use std::io::{BufRead, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, anyhow, bail};
use draco_registration::global::{
    NearStartParams, Pivot, SearchParams, align_near_start, branch_and_bound_2d,
};
use draco_registration::{
    Cloud, Error, IcpParams, Registration, RigidMotion, Target, io::read_points, mean_downsample,
};
use nalgebra::{Isometry2, Isometry3, Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

const USAGE: &str = "usage: align < CASES\n  a line of CASES: case dim source target reps max_corr init(9|16 numbers) | global T_HALF_WIDTH_M R_HALF_WIDTH_DEG";

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("--help" | "-h") => {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        None if !std::io::stdin().is_terminal() => {}
        _ => return wrong_usage(),
    }
    match run() {
        Ok(Lines { read: 0, .. }) => wrong_usage(),
        Ok(Lines { failed: 0, .. }) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn wrong_usage() -> ExitCode {
    eprintln!("{USAGE}");
    ExitCode::from(2)
}

struct Lines {
    read: usize,
    failed: usize,
}

/// Answers every line that can be answered and tells of every other on stderr.
fn run() -> anyhow::Result<Lines> {
    let (mut output, mut input) = (std::io::stdout().lock(), std::io::stdin().lock());
    let mut lines = Lines { read: 0, failed: 0 };
    let mut raw = Vec::new();
    for number in 1.. {
        raw.clear();
        if input.read_until(b'\n', &mut raw)? == 0 {
            break;
        }
        if raw.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        lines.read += 1;
        match std::str::from_utf8(&raw).context("not text").and_then(answer) {
            Ok(answer) => writeln!(output, "{answer}")?,
            Err(error) => {
                lines.failed += 1;
                eprintln!("input line {number}: {error:#}");
            }
        }
    }
    Ok(lines)
}

fn answer(line: &str) -> anyhow::Result<String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [case, dim, source, target, reps, max_corr, start @ ..] = words.as_slice() else {
        bail!("{} words, at least 9 are needed", words.len());
    };
    let reps: usize = reps.parse().with_context(|| format!("reps `{reps}`"))?;
    if reps == 0 {
        bail!("reps is 0, at least 1 is needed");
    }
    let max_distance: f64 = max_corr.parse().with_context(|| format!("max_corr `{max_corr}`"))?;
    let outcome = match *dim {
        "2" => {
            let (s, t) = (read::<2>(source)?, read::<2>(target)?);
            if let ["global", translation, degrees] = start {
                let box_of = SearchParams {
                    translation: translation.parse().context("half width")?,
                    rotation: degrees.parse::<f64>().context("half width")?.to_radians(),
                    pivot: Pivot::Origin,
                    ..SearchParams::default()
                };
                let outcome = repeat(reps, || search_2d(&s, &t, &Isometry2::identity(), &box_of))?;
                return Ok(format!("{case} {outcome}"));
            }
            let m = numbers::<9>(start)?;
            let rotation = rotation(Matrix2::new(m[0], m[1], m[3], m[4]))?;
            let initial = Isometry2::from_matrix(&rotation, &Vector2::new(m[2], m[5]));
            repeat(reps, || align_2d(&s, &t, &initial, max_distance))?
        }
        "3" => {
            let (s, t) = (read::<3>(source)?, read::<3>(target)?);
            let m = numbers::<16>(start)?;
            let rotation = rotation(Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]))?;
            let initial = Isometry3::from_matrix(&rotation, &Vector3::new(m[3], m[7], m[11]));
            repeat(reps, || align_3d(&s, &t, &initial, max_distance))?
        }
        other => bail!("dim {other} is neither 2 nor 3"),
    };
    Ok(format!("{case} {outcome}"))
}

fn read<const D: usize>(path: &str) -> anyhow::Result<Vec<SVector<f64, D>>> {
    read_points(Path::new(path)).map_err(|error| match error {
        Error::Io { .. } => error.into(),
        _ => anyhow!("{path}: {error}"),
    })
}

/// The rotation of a start, which must be one.
fn rotation<const D: usize>(matrix: SMatrix<f64, D, D>) -> anyhow::Result<SMatrix<f64, D, D>> {
    let off = (matrix.transpose() * matrix - SMatrix::identity()).norm();
    // the shared cases are written with nine digits
    if off.is_nan() || off > 1e-6 {
        bail!("the start is not a rotation and a translation");
    }
    Ok(matrix)
}

fn numbers<const K: usize>(words: &[&str]) -> anyhow::Result<[f64; K]> {
    if words.len() != K {
        bail!("{} numbers for the start, {K} are needed", words.len());
    }
    let mut values = [0.0; K];
    for (value, word) in values.iter_mut().zip(words) {
        *value = word.parse().with_context(|| format!("`{word}` is not a number"))?;
    }
    Ok(values)
}

/// What one run gives: the answer as text, its iterations, seconds before and during the alignment.
type Timed = (String, usize, f64, f64);

fn repeat(reps: usize, mut run: impl FnMut() -> anyhow::Result<Timed>) -> anyhow::Result<String> {
    let (mut preparing, mut aligning, mut last) = (Vec::new(), Vec::new(), None);
    for _ in 0..reps.max(1) {
        let timed = run()?;
        preparing.push(timed.2 * 1e3);
        aligning.push(timed.3 * 1e3);
        last = Some(timed);
    }
    let Some((text, iterations, ..)) = last else { bail!("no run") };
    let align = median(&mut aligning);
    Ok(format!("{iterations} {:.6} {align:.6} {text}", median(&mut preparing) + align))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn align_2d(
    source: &[SVector<f64, 2>],
    target: &[SVector<f64, 2>],
    initial: &Isometry2<f64>,
    max_distance: f64,
) -> anyhow::Result<Timed> {
    let begin = Instant::now();
    let target = Target::new(&Cloud::new(target.to_vec())?.estimate_normals(8, &Vector2::zeros())?)?;
    let source = Cloud::new(source.to_vec())?.estimate_normals(8, &Vector2::zeros())?;
    let prepared = begin.elapsed().as_secs_f64();
    let params = NearStartParams::laser_2d(max_distance);
    let found = align_near_start(&target, &source, initial, &params)?;
    Ok(timed(&found, prepared, begin.elapsed().as_secs_f64()))
}

fn search_2d(
    source: &[SVector<f64, 2>],
    target: &[SVector<f64, 2>],
    centre: &Isometry2<f64>,
    window: &SearchParams,
) -> anyhow::Result<Timed> {
    let begin = Instant::now();
    let target = Target::new(&Cloud::new(target.to_vec())?.estimate_normals(8, &Vector2::zeros())?)?;
    let source = Cloud::new(source.to_vec())?.estimate_normals(8, &Vector2::zeros())?;
    let prepared = begin.elapsed().as_secs_f64();
    let coarse = branch_and_bound_2d(&target, &source, centre, window)?;
    let params = IcpParams { max_distance: 0.5, ..IcpParams::laser_2d() };
    let mut found = target.align(&source, &coarse.best().target_from_source, &params)?;
    found.iterations = coarse.best().nodes;
    Ok(timed(&found, prepared, begin.elapsed().as_secs_f64()))
}

fn align_3d(
    source: &[SVector<f64, 3>],
    target: &[SVector<f64, 3>],
    initial: &Isometry3<f64>,
    max_distance: f64,
) -> anyhow::Result<Timed> {
    let begin = Instant::now();
    let cell = max_distance / 4.0;
    let view = Vector3::zeros();
    let source = Cloud::new(mean_downsample(source, cell)?)?.estimate_normals(10, &view)?;
    let target = Target::new(&Cloud::new(mean_downsample(target, cell)?)?.estimate_normals(10, &view)?)?;
    let prepared = begin.elapsed().as_secs_f64();
    let params = IcpParams { max_distance, ..IcpParams::lidar_3d() };
    let found = target.align(&source, initial, &params)?;
    Ok(timed(&found, prepared, begin.elapsed().as_secs_f64()))
}

fn timed<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    found: &Registration<G, N>,
    prepared: f64,
    total: f64,
) -> Timed {
    let mut text = String::new();
    for value in found.target_from_source.to_row_major() {
        text.push_str(&format!("{value:.12e} "));
    }
    for i in 0..N {
        for j in 0..N {
            text.push_str(&format!("{:.6e} ", found.covariance[(i, j)]));
        }
    }
    (text, found.iterations, prepared, total - prepared)
}

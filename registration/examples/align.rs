//! Aligns pairs of point files: the contender's side of the registration benchmark.
//!
//! Reads lines `case dim source target reps max_corr init...` on stdin, where `init` is `target_from_source` as
//! 9 (`dim` 2) or 16 (`dim` 3) row-major numbers, or `global T_HALF_WIDTH_M R_HALF_WIDTH_DEG` for a search
//! without a start. Answers a line each: `case iterations ms_total ms_align T(9|16) [cov(9|36)]`, times being
//! medians over `reps`. One default preset a dimension; nothing is chosen by case.

use std::io::{BufRead, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, bail};
use draco_registration::global::{SearchParams, branch_and_bound_2d};
use draco_registration::{
    Cloud, IcpParams, Registration, RigidMotion, Target, io::read_points, mean_downsample,
};
use nalgebra::{Isometry2, Isometry3, Matrix2, Matrix3, SVector, Vector2, Vector3};

const USAGE: &str = "usage: align < CASES\n  a line of CASES: case dim source target reps max_corr init(9|16 numbers) | global T_HALF_WIDTH_M R_HALF_WIDTH_DEG";

fn main() -> ExitCode {
    if std::env::args().len() > 1 || std::io::stdin().is_terminal() {
        let help = std::env::args().nth(1).is_some_and(|a| a == "--help" || a == "-h");
        if help {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    }
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<()> {
    let mut output = std::io::stdout().lock();
    for (number, line) in std::io::stdin().lock().lines().enumerate() {
        let line = line?;
        if line.trim().is_empty() {
            continue;
        }
        let answer = answer(&line).with_context(|| format!("input line {}", number + 1))?;
        writeln!(output, "{answer}")?;
    }
    Ok(())
}

fn answer(line: &str) -> anyhow::Result<String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [case, dim, source, target, reps, max_corr, start @ ..] = words.as_slice() else {
        bail!("{} words, at least 9 are needed", words.len());
    };
    let reps: usize = reps.parse().context("reps")?;
    let max_distance: f64 = max_corr.parse().context("max_corr")?;
    let (source, target) = (Path::new(source), Path::new(target));
    let outcome = match *dim {
        "2" => {
            let (s, t) = (read_points::<2>(source)?, read_points::<2>(target)?);
            if let ["global", translation, degrees] = start {
                let box_of = SearchParams {
                    translation: translation.parse().context("half width")?,
                    rotation: degrees.parse::<f64>().context("half width")?.to_radians(),
                    ..SearchParams::default()
                };
                let outcome = repeat(reps, || search_2d(&s, &t, &Isometry2::identity(), &box_of))?;
                return Ok(format!("{case} {outcome}"));
            }
            let m = numbers::<9>(start)?;
            let rotation = Matrix2::new(m[0], m[1], m[3], m[4]);
            let initial = Isometry2::from_matrix(&rotation, &Vector2::new(m[2], m[5]));
            repeat(reps, || align_2d(&s, &t, &initial, max_distance))?
        }
        "3" => {
            let (s, t) = (read_points::<3>(source)?, read_points::<3>(target)?);
            let m = numbers::<16>(start)?;
            let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
            let initial = Isometry3::from_matrix(&rotation, &Vector3::new(m[3], m[7], m[11]));
            repeat(reps, || align_3d(&s, &t, &initial, max_distance))?
        }
        other => bail!("dim {other} is neither 2 nor 3"),
    };
    Ok(format!("{case} {outcome}"))
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
    let params = IcpParams { max_distance: 0.5, ..IcpParams::laser_2d() };
    let window = SearchParams::near_start(max_distance);
    let coarse = branch_and_bound_2d(&target, &source, initial, &window)?;
    let found = target.align(&source, &coarse.best().target_from_source, &params)?;
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

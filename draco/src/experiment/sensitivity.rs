use std::path::PathBuf;

use nalgebra::UnitComplex;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;

use super::{Cell, Figure, Outcome, Settings, Table};
use crate::dataset::read_keyframe_folder;
use crate::error::Error;
use crate::keyframe::MissionData;
use crate::mission::{self, MissionParams};
use crate::report::RunReport;
use crate::robot::RobotParams;

/// Yaw drift added to the dead reckoning, a random walk, radians a keyframe.
const DRIFT: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Seeds of that drift.
const DRIFT_SEEDS: u64 = 5;

/// A default and what multiplies it.
type Knob = (&'static str, fn(&mut RobotParams, f64));

/// Every default that decides about matches, alignments and closures on points, one at a time.
const KNOBS: &[Knob] = &[
    ("local.window", |p, f| count(&mut p.local.window, f)),
    ("local.voxel", |p, f| p.local.voxel *= f),
    ("local.min_points", |p, f| count(&mut p.local.min_points, f)),
    ("local.odometry_sigma", |p, f| p.local.odometry_sigma *= f),
    ("local.odometry_spread", |p, f| p.local.odometry_spread *= f),
    ("local.bias_sigma", |p, f| p.local.bias_sigma *= f),
    ("local.odometry_sigma_angle", |p, f| p.local.odometry_sigma_angle *= f),
    ("local.scale_sigma", |p, f| p.local.scale_sigma *= f),
    ("local.step_min_score", |p, f| p.local.step_min_score *= f),
    ("local.step_cauchy", |p, f| p.local.step_cauchy *= f),
    ("local.step.kernel_sigma", |p, f| p.local.step.kernel_sigma *= f),
    ("local.step.step", |p, f| p.local.step.step *= f),
    ("local.step.radius", |p, f| p.local.step.radius *= f),
    ("local.step.angle", |p, f| p.local.step.angle *= f),
    ("local.step.effective_points", |p, f| p.local.step.effective_points *= f),
    ("local.step.floor", |p, f| p.local.step.floor *= f),
    ("local.step_refinement.kernel_sigma", |p, f| p.local.step_refinement.kernel_sigma *= f),
    ("local.step_refinement.step", |p, f| p.local.step_refinement.step *= f),
    ("local.step_refinement.radius", |p, f| p.local.step_refinement.radius *= f),
    ("local.step_refinement.angle", |p, f| p.local.step_refinement.angle *= f),
    ("local.step_refinement.effective_points", |p, f| p.local.step_refinement.effective_points *= f),
    ("local.step_refinement.floor", |p, f| p.local.step_refinement.floor *= f),
    ("local.step_refinement.far_distance", |p, f| p.local.step_refinement.far_distance *= f),
    ("local.step_refinement.extra_sigma", |p, f| p.local.step_refinement.extra_sigma *= f),
    ("local.loops.source_half", |p, f| count(&mut p.local.loops.source_half, f)),
    ("local.loops.target_half", |p, f| count(&mut p.local.loops.target_half, f)),
    ("local.loops.min_separation", |p, f| count(&mut p.local.loops.min_separation, f)),
    ("local.loops.submaps_before", |p, f| count(&mut p.local.loops.submaps_before, f)),
    ("local.loops.max_distance", |p, f| p.local.loops.max_distance *= f),
    ("local.loops.per_keyframe", |p, f| count(&mut p.local.loops.per_keyframe, f)),
    ("local.loops.sigmas", |p, f| p.local.loops.sigmas *= f),
    ("local.loops.radius", |p, f| {
        p.local.loops.radius = (f * p.local.loops.radius.0, f * p.local.loops.radius.1);
    }),
    ("local.loops.max_angle", |p, f| p.local.loops.max_angle *= f),
    ("local.loops.min_score", |p, f| p.local.loops.min_score *= f),
    ("local.loops.cauchy", |p, f| p.local.loops.cauchy *= f),
    ("local.loops.matching.kernel_sigma", |p, f| p.local.loops.matching.kernel_sigma *= f),
    ("local.loops.matching.effective_points", |p, f| p.local.loops.matching.effective_points *= f),
    ("cells.size", |p, f| p.cells.size *= f),
    ("cells.min_keyframes", |p, f| count(&mut p.cells.min_keyframes, f)),
    ("alignment.min_cells", |p, f| count(&mut p.alignment.min_cells, f)),
    ("alignment.conflict_weight", |p, f| p.alignment.conflict_weight *= f),
    ("alignment.max_ratio", |p, f| p.alignment.max_ratio *= f),
    ("alignment.min_streak", |p, f| count(&mut p.alignment.min_streak, f)),
    ("alignment.same_distance", |p, f| p.alignment.same_distance *= f),
    ("alignment.same_angle", |p, f| p.alignment.same_angle *= f),
    ("alignment.min_tested", |p, f| count(&mut p.alignment.min_tested, f)),
    ("alignment.min_share", |p, f| p.alignment.min_share *= f),
    ("closure.max_distance", |p, f| p.closure.max_distance *= f),
    ("closure.metres_per_radian", |p, f| p.closure.metres_per_radian *= f),
    ("closure.per_keyframe", |p, f| count(&mut p.closure.per_keyframe, f)),
    ("closure.separation", |p, f| count(&mut p.closure.separation, f)),
    ("closure.source_half", |p, f| halves(&mut p.closure.source_half, f)),
    ("closure.target_half", |p, f| halves(&mut p.closure.target_half, f)),
    ("closure.min_points", |p, f| count(&mut p.closure.min_points, f)),
    ("closure.matching.radius", |p, f| p.closure.matching.radius *= f),
    ("closure.matching.angle", |p, f| p.closure.matching.angle *= f),
    ("closure.matching.kernel_sigma", |p, f| p.closure.matching.kernel_sigma *= f),
    ("closure.matching.effective_points", |p, f| p.closure.matching.effective_points *= f),
    ("closure.refinement.kernel_sigma", |p, f| p.closure.refinement.kernel_sigma *= f),
    ("closure.min_score", |p, f| p.closure.min_score *= f),
    ("closure.max_far_ratio", |p, f| p.closure.max_far_ratio *= f),
    ("closure.covariance_factor", |p, f| p.closure.covariance_factor *= f),
    ("closure.cauchy", |p, f| p.closure.cauchy *= f),
    ("closure.cauchy_believed", |p, f| p.closure.cauchy_believed *= f),
    ("closure.max_residual", |p, f| p.closure.max_residual *= f),
    ("closure.max_residual_angle", |p, f| p.closure.max_residual_angle *= f),
    ("closure.max_residual_medians", |p, f| p.closure.max_residual_medians *= f),
    ("closure.witnesses", |p, f| count(&mut p.closure.witnesses, f)),
    ("exchange.map_interval", |p, f| count(&mut p.exchange.map_interval, f)),
    ("exchange.object_interval", |p, f| count(&mut p.exchange.object_interval, f)),
];

fn count(value: &mut usize, factor: f64) {
    *value = ((*value as f64 * factor).round() as usize).max(1);
}

fn halves(value: &mut u32, factor: f64) {
    *value = ((f64::from(*value) * factor).round() as u32).max(1);
}

/// One run: what is changed, and how.
#[derive(Clone, Copy)]
enum Change {
    Nothing,
    Factor(Knob, f64),
    Drift(u64),
}

impl Change {
    /// All runs in order; seed `n` of the experiment is the `n`-th.
    fn all() -> Vec<Change> {
        let factors = KNOBS.iter().flat_map(|&knob| [0.5, 2.0].map(|factor| Change::Factor(knob, factor)));
        let drifts = (0..DRIFT_SEEDS).map(Change::Drift);
        std::iter::once(Change::Nothing).chain(drifts).chain(factors).collect()
    }

    fn name(self) -> String {
        match self {
            Change::Nothing => "as it is".into(),
            Change::Factor((name, _), factor) => format!("{name} x {factor}"),
            Change::Drift(seed) => format!("yaw drift 0.5 deg a keyframe, seed {seed}"),
        }
    }

    fn fly(self, data: &MissionData) -> Result<RunReport, Error> {
        let mut params = MissionParams::default();
        match self {
            Change::Nothing => mission::run(data, &params, |_| {}),
            Change::Factor((_, set), factor) => {
                set(&mut params.robot, factor);
                mission::run(data, &params, |_| {})
            }
            Change::Drift(seed) => mission::run(&drifting(data, seed)?, &params, |_| {}),
        }
    }
}

/// The recording with a random walk added to the heading of its dead reckoning.
fn drifting(data: &MissionData, seed: u64) -> Result<MissionData, Error> {
    let refused = |_| Error::Parameter { name: "drift", value: DRIFT, reason: "has to be positive" };
    let normal = Normal::new(0.0, DRIFT).map_err(refused)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut data = data.clone();
    for recording in &mut data.recordings {
        let old: Vec<_> = recording.keyframes.iter().map(|k| k.odometry).collect();
        let mut turned = old.first().copied().unwrap_or_default();
        for (keyframe, pair) in recording.keyframes[1..].iter_mut().zip(old.windows(2)) {
            turned *= pair[0].inv_mul(&pair[1]) * UnitComplex::new(normal.sample(&mut rng));
            keyframe.odometry = turned;
        }
    }
    Ok(data)
}

/// A recorded mission with each default at half and at double its value, one at a time, and with yaw drift.
///
/// The runs are numbered, so that `--first-seed` and `--seeds` choose some of them.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let Some(folder) = &settings.data else {
        let path = PathBuf::from("--data");
        let reason = "names no folder of a recorded mission";
        return Err(Error::Io {
            path,
            source: std::io::Error::new(std::io::ErrorKind::InvalidInput, reason),
        });
    };
    let data = read_keyframe_folder(folder)?;
    let changes = Change::all();
    let chosen = settings.seeds_or(changes.len() as u64);
    let runs: Vec<(usize, RunReport)> = changes
        .par_iter()
        .enumerate()
        .filter(|(index, _)| chosen.contains(&(*index as u64)))
        .map(|(index, change)| {
            let report = change.fly(&data)?;
            let ate = report.summary().team.ate_m.map_or("none".into(), |ate| format!("{ate:.2} m"));
            (settings.progress)(&format!("run {index}, {}: team {ate}", change.name()));
            Ok((index, report))
        })
        .collect::<Result<_, Error>>()?;
    let columns = ["run", "change", "merged", "alone m", "team m", "precision %", "recall %"];
    let mut table = Table::new(columns);
    let mut figure = Figure {
        title: format!("Sensitivity on {}", data.name),
        y: "team ATE, m".into(),
        categories: runs.iter().map(|(index, _)| index.to_string()).collect(),
        ..Figure::default()
    };
    let mut teams = Vec::new();
    for (at, (index, report)) in runs.iter().enumerate() {
        let team = report.summary().team;
        let alone = report.robots.iter().filter_map(|robot| Some(robot.local_error()?.rmse_m));
        table.push([
            (*index).into(),
            changes[*index].name().into(),
            team.merged_robots.into(),
            Cell::number(alone.reduce(f64::max), 2),
            Cell::number(team.ate_m, 2),
            Cell::percent(team.precision),
            Cell::percent(team.recall),
        ]);
        teams.extend(team.ate_m.map(|ate| [at as f64, ate]));
    }
    figure.dots("team", teams);
    let notes = vec!["alone: the worst of the robots' own maps".into()];
    Ok(Outcome { table, runs: None, figure, notes })
}

use std::time::Instant;

use draco_registration::global::Draco1Params;
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::pairs::{Surveyed, survey};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::closure::{ClosureParams, register};
use crate::draco1::{self, Composition};
use crate::error::Error;
use crate::simulate::{ImageParams, Scenario, SimulationParams, polar_image};
use crate::sonar::{Cfar, CfarParams, FrontEnd};

/// Pairs of a mission whose registration is timed, at most.
const PAIRS: usize = 40;

/// Milliseconds of a local registration from an alignment, and of the baseline's global one, on the same pairs; one
/// after the other on one thread, alternating.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let mut table =
        Table::new(["scenario", "registration", "pairs", "median ms", "mean ms", "points: target", "source"]);
    let mut figure = Figure {
        title: "Time of a registration".into(),
        y: "ms".into(),
        categories: vec!["local".into(), "global (DRACo1)".into()],
        ..Figure::default()
    };
    let mut notes = Vec::new();
    let range = settings.seeds_or(3);
    for scenario in Scenario::ALL {
        let params = ClosureParams::default();
        let (mut local, mut global, mut sizes) = (Vec::new(), Vec::new(), [0, 0, 0, 0]);
        for seed in range.clone() {
            let robots = survey(scenario, seed, settings)?;
            let (target, source) = (&robots[0], &robots[1]);
            for (i, j) in nearest_pairs(target, source).take(PAIRS) {
                let submaps = [
                    target.submap(i, params.target_half as usize),
                    source.submap(j, params.source_half as usize),
                    target.submap(i, 1),
                    source.submap(j, 1),
                ];
                let start = target.truth[i].inv_mul(&source.truth[j]);
                let begin = Instant::now();
                let ours = register(&submaps[0], &submaps[1], &start, &params)?;
                let between = Instant::now();
                let theirs = draco1::register(
                    &submaps[2],
                    &submaps[3],
                    Composition::Corrected,
                    &Draco1Params::default(),
                )?;
                let end = Instant::now();
                if ours.is_some() && theirs.is_some() {
                    local.push(1000.0 * (between - begin).as_secs_f64());
                    global.push(1000.0 * (end - between).as_secs_f64());
                    sizes.iter_mut().zip(&submaps).for_each(|(sum, submap)| *sum += submap.len());
                }
            }
        }
        let mut row = |name: &str, times: &mut Vec<f64>, points: [usize; 2]| {
            times.sort_by(f64::total_cmp);
            let median = times.get(times.len() / 2).copied();
            let count = times.len().max(1);
            table.push([
                scenario.name().into(),
                name.into(),
                times.len().into(),
                Cell::number(median, 2),
                Cell::number(times.iter().sum::<f64>() / count as f64, 2),
                (points[0] / count).into(),
                (points[1] / count).into(),
            ]);
            median.unwrap_or(f64::NAN)
        };
        let a = row("local, correlative", &mut local, [sizes[0], sizes[1]]);
        let b = row("global, DRACo1", &mut global, [sizes[2], sizes[3]]);
        figure.dots(scenario.name(), [[0.0, a], [1.0, b]]);
        notes.push(if local.is_empty() {
            format!("{}: no pair that both register", scenario.name())
        } else {
            format!("{}: the local one is {:.1} times as fast", scenario.name(), b / a)
        });
    }
    let mut times = front_end_times(settings.first_seed)?;
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    table.push([
        "harbor".into(),
        "(image of 512 x 512 to points)".into(),
        times.len().into(),
        Cell::number(median, 2),
        Cell::number(mean, 2),
    ]);
    Ok(Outcome { table, runs: None, figure, notes })
}

/// Each keyframe of `source` with the one of `target` that truly lies nearest.
fn nearest_pairs<'a>(
    target: &'a Surveyed,
    source: &'a Surveyed,
) -> impl Iterator<Item = (usize, usize)> + 'a {
    (0..source.len()).map(|j| {
        let distance =
            |i: &usize| (target.truth[*i].translation.vector - source.truth[j].translation.vector).norm();
        let nearest = (0..target.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
        (nearest, j)
    })
}

/// Milliseconds from an image to the points of a keyframe.
fn front_end_times(seed: u64) -> Result<Vec<f64>, Error> {
    let params = ImageParams::default();
    let front_end = FrontEnd {
        cfar: Cfar::new(CfarParams::default())?,
        fan: params.fan,
        filter: SimulationParams::default().filter,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let image =
        polar_image(&Scenario::Harbor.world(seed), &Isometry2::translation(5.0, 4.0), &params, &mut rng)?;
    let time = |_| {
        let begin = Instant::now();
        let points = front_end.points(&image)?;
        let end = Instant::now();
        Ok(if points.is_empty() { f64::NAN } else { 1000.0 * (end - begin).as_secs_f64() })
    };
    (0..20).map(time).collect()
}

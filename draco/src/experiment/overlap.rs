use draco_lie::LieGroup;
use draco_registration::global::Draco1Params;
use draco_registration::{Cloud, IcpParams, Target};
use nalgebra::{Isometry2, Point2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::pairs::{Surveyed, grade, survey};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::closure::{ClosureParams, candidates, register};
use crate::draco1::{self, Composition, nearest_keys, ring_key};
use crate::error::Error;
use crate::simulate::Scenario;

/// Error of the map alignment that local registrations start from: metres and radians, standard deviation.
const START_SIGMA: [f64; 2] = [0.7, 0.02];

/// A registered pair: the value its method gates by, and whether it is right.
#[derive(Debug, Clone, Copy)]
struct Graded {
    gate: f64,
    correct: bool,
    strict: bool,
}

/// Every method with the thresholds its gate is swept over.
const METHODS: [(&str, [f64; 6]); 4] = [
    ("correlative (score)", [0.35, 0.40, 0.45, 0.50, 0.55, 0.60]),
    ("window ICP (overlap)", [0.50, 0.60, 0.70, 0.80, 0.85, 0.90]),
    ("DRACo1 corrected (overlap)", [0.50, 0.60, 0.70, 0.80, 0.85, 0.90]),
    ("DRACo1 as coded (overlap)", [0.50, 0.60, 0.70, 0.80, 0.85, 0.90]),
];

/// Precision and number of right closures against the threshold of the gate, before any consistency test.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(3);
    let mut table =
        Table::new(["scenario", "method", "gate", "accepted", "right", "precision %", "strict %"]);
    let mut figure = Figure {
        title: "Right closures against precision".into(),
        x: "precision, %".into(),
        y: "right closures a mission".into(),
        ..Figure::default()
    };
    let mut notes = Vec::new();
    for scenario in Scenario::ALL {
        let mut graded: Vec<Vec<Graded>> = vec![Vec::new(); METHODS.len()];
        for seed in range.clone() {
            let robots = survey(scenario, seed, settings)?;
            for (all, new) in graded.iter_mut().zip(all_pairs(&robots, seed)?) {
                all.extend(new);
            }
        }
        let missions = (range.end - range.start) as f64;
        let mut at_default = Vec::new();
        for ((name, gates), graded) in METHODS.iter().zip(&graded) {
            let mut points = Vec::new();
            for (index, &gate) in gates.iter().enumerate() {
                let kept: Vec<&Graded> = graded.iter().filter(|g| g.gate >= gate).collect();
                let right = kept.iter().filter(|g| g.correct).count();
                let strict = kept.iter().filter(|g| g.strict).count();
                let precision = right as f64 / kept.len() as f64;
                points.push([100.0 * precision, right as f64 / missions]);
                table.push([
                    scenario.name().into(),
                    (*name).into(),
                    Cell::number(gate, 2),
                    kept.len().into(),
                    right.into(),
                    Cell::percent(precision),
                    Cell::percent(strict as f64 / kept.len() as f64),
                ]);
                // the first method at its default, the others at the gates their papers use in simulation
                if index == if *name == METHODS[0].0 { 2 } else { 4 } {
                    at_default.push(right);
                }
            }
            figure.line(format!("{} {name}", scenario.name()), points);
        }
        notes.push(format!(
            "{}: at the default gate {} right closures, the corrected DRACo1 at 0.85 has {} ({:.1} times as many)",
            scenario.name(),
            at_default[0],
            at_default[2],
            at_default[0] as f64 / at_default[2] as f64
        ));
    }
    Ok(Outcome { table, runs: None, figure, notes })
}

/// All pairs that each method would try, registered and graded.
fn all_pairs(robots: &[Surveyed], seed: u64) -> Result<Vec<Vec<Graded>>, Error> {
    let mut graded = vec![Vec::new(); METHODS.len()];
    for a in 0..robots.len() {
        for b in (0..robots.len()).filter(|b| *b != a) {
            let (target, source) = (&robots[a], &robots[b]);
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream((10 * a + b) as u64);
            let mut off = |sigma: f64| {
                sigma * (rng.random::<f64>() + rng.random::<f64>() + rng.random::<f64>() - 1.5) * 2.0
            };
            let error = Vector3::new(off(START_SIGMA[0]), off(START_SIGMA[0]), off(START_SIGMA[1]));
            // the alignment is right up to that at the middle keyframe
            let (i, j) = (target.len() / 2, source.len() / 2);
            let target_from_source = target.slam.poses()[i]
                * target.truth[i].inv_mul(&source.truth[j]).plus(&error)
                * source.slam.poses()[j].inverse();
            let placed: Vec<_> = source.slam.poses().iter().map(|pose| target_from_source * pose).collect();
            let params = ClosureParams::default();
            let pairs: Vec<_> = candidates(target.slam.poses(), &placed, &params)
                .into_iter()
                .filter(|c| (c.own + c.partner).is_multiple_of(2) == (a < b))
                .collect();
            let local: Vec<[Option<Graded>; 2]> = pairs
                .par_iter()
                .map(|pair| {
                    let (i, j) = (pair.own as usize, pair.partner as usize);
                    let start = target.slam.poses()[i].inv_mul(&placed[j]);
                    Ok([
                        correlative((target, i), (source, j), &start, &params)?,
                        window_icp((target, i), (source, j), &start)?,
                    ])
                })
                .collect::<Result<_, Error>>()?;
            for [ours, icp] in local {
                graded[0].extend(ours);
                graded[1].extend(icp);
            }
            let global = global_pairs(target, source)?;
            graded[2].extend(global.iter().flatten().map(|pair| pair[0]));
            graded[3].extend(global.iter().flatten().map(|pair| pair[1]));
        }
    }
    Ok(graded)
}

fn judged(
    target: (&Surveyed, usize),
    source: (&Surveyed, usize),
    found: &Isometry2<f64>,
    gate: f64,
) -> Graded {
    let grade = grade(target, source, found);
    Graded { gate, correct: grade.correct, strict: grade.strict }
}

fn correlative(
    target: (&Surveyed, usize),
    source: (&Surveyed, usize),
    start: &Isometry2<f64>,
    params: &ClosureParams,
) -> Result<Option<Graded>, Error> {
    let (map, scan) = (
        target.0.submap(target.1, params.target_half as usize),
        source.0.submap(source.1, params.source_half as usize),
    );
    let found = register(&map, &scan, start, params)?;
    // what fails the other gates has no score
    Ok(found.map(|found| {
        let clear = found.far_ratio <= params.max_far_ratio;
        judged(target, source, &found.target_from_source, if clear { found.score } else { 0.0 })
    }))
}

/// The published system's registration: one scan against seven, from the alignment.
fn window_icp(
    target: (&Surveyed, usize),
    source: (&Surveyed, usize),
    start: &Isometry2<f64>,
) -> Result<Option<Graded>, Error> {
    let cloud = |points: Vec<Point2<f64>>| Cloud::new(points.into_iter().map(|p| p.coords).collect());
    let (map, scan) = (target.0.submap(target.1, 3), source.0.submap(source.1, 0));
    if map.len().min(scan.len()) < 30 {
        return Ok(None);
    }
    let params = IcpParams { overlap_radius: 0.5, ..IcpParams::libpointmatcher_like() };
    let found = Target::new(&cloud(map)?)?.align(&cloud(scan)?, start, &params)?;
    Ok(Some(judged(target, source, &found.target_from_source, found.overlap)))
}

/// The first DRACo-SLAM: for each source keyframe the five target keyframes with the nearest ring keys.
fn global_pairs(target: &Surveyed, source: &Surveyed) -> Result<Vec<Option<[Graded; 2]>>, Error> {
    let keys: Vec<_> = (0..target.len()).map(|i| ring_key(&target.submap(i, 1))).collect();
    let mut pairs = Vec::new();
    for j in 0..source.len() {
        let key = ring_key(&source.submap(j, 1));
        pairs.extend(nearest_keys(&keys, &key, 5, 20.0).into_iter().map(|i| (i, j)));
    }
    pairs
        .par_iter()
        .map(|&(i, j)| {
            let (map, scan) = (target.submap(i, 1), source.submap(j, 1));
            let params = Draco1Params::default();
            let Some(right) = draco1::register(&map, &scan, Composition::Corrected, &params)? else {
                return Ok(None);
            };
            // the wrong order only matters where the pair would be used at all
            let coded = if right.overlap >= 0.5 {
                draco1::register(&map, &scan, Composition::AsCoded, &params)?.unwrap_or(right)
            } else {
                right
            };
            let graded =
                |c: draco1::Draco1Closure| judged((target, i), (source, j), &c.target_from_source, c.overlap);
            Ok(Some([graded(right), graded(coded)]))
        })
        .collect()
}

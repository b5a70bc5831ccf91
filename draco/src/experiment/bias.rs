use std::collections::BTreeMap;

use draco_consistency::PoseKey;
use draco_consistency::simulate::{Harbor, Label, SimulatedTeam, harbor};
use draco_pgo::Kernel;
use nalgebra::{Isometry2, Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::missions::mean;
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::closure::ClosureParams;
use crate::consistency::{Evidence, Method, select};
use crate::error::Error;
use crate::message::{ClosureEntry, FactorEntry, KeyframeId};
use crate::robot_graph::RobotGraph;
use crate::two_step::TeamProblem;

/// Errors of the map alignment that are tried, metres.
const PRIOR_SIGMAS: [f64; 5] = [0.05, 0.3, 0.5, 1.0, 2.0];

/// Noise of a step at a share of 1 of the generator's odometry: metres, metres, radians.
const STEP_SIGMAS: [f64; 3] = [0.12, 0.12, 0.0136];

/// Counts over one team, and where its estimate puts the robots.
#[derive(Debug, Default, Clone)]
struct Counts {
    good: usize,
    good_kept: usize,
    biased: usize,
    biased_kept: usize,
    kept: usize,
    kept_right: usize,
    /// How far off each of the other robots' starts lie in the map of the first, metres.
    start_errors: Vec<f64>,
}

/// Correlated groups of wrong closures among good ones, from the generator of `draco-consistency`: a third of the
/// groups is biased. Which of both does each test accept, by the error of the map alignment it is given, and where does
/// the team's estimate from the accepted ones put the robots?
///
/// The estimate is of all poses at once, with the kernel of missions. A robot that no accepted closure joins stays
/// where the map alignment has it.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(100);
    let seeds = range.end - range.start;
    let mut table = Table::new([
        "consistency",
        "alignment error m",
        "biased accepted %",
        "good kept %",
        "precision %",
        "robot 2 off m",
        "robot 3 off m",
        "worst of 20 off m",
    ]);
    let mut figure = Figure {
        title: format!("Biased closures accepted, {seeds} teams"),
        x: "error of the map alignment, m".into(),
        y: "biased accepted, %".into(),
        ..Figure::default()
    };
    let tests = Method::ALL.into_iter().map(|(method, name)| (Some(method), name));
    for (method, name) in tests.chain([(None, "truth")]) {
        let mut points = Vec::new();
        for sigma in PRIOR_SIGMAS {
            let teams: Vec<Counts> = range
                .clone()
                .into_par_iter()
                .map(|seed| judge(method, sigma, seed))
                .collect::<Result<_, _>>()?;
            let share = |part: fn(&Counts) -> usize, whole: fn(&Counts) -> usize| {
                let (part, whole): (usize, usize) =
                    (teams.iter().map(part).sum(), teams.iter().map(whole).sum());
                part as f64 / whole as f64
            };
            let biased = share(|c| c.biased_kept, |c| c.biased);
            points.push([sigma, 100.0 * biased]);
            table.push([
                name.into(),
                Cell::number(sigma, 2),
                Cell::percent(biased),
                Cell::percent(share(|c| c.good_kept, |c| c.good)),
                Cell::percent(share(|c| c.kept_right, |c| c.kept)),
                Cell::number(mean(teams.iter().map(|t| t.start_errors.first().copied())), 3),
                Cell::number(mean(teams.iter().map(|t| t.start_errors.get(1).copied())), 3),
                Cell::number(worst_of_twenty(&teams), 2),
            ]);
        }
        figure.line(name, points);
        (settings.progress)(name);
    }
    let notes = vec![
        "three robots, eleven groups of 3 to 12 closures, 30 % of them biased, 5 % gross outliers".into(),
    ];
    Ok(Outcome { table, runs: None, figure, notes })
}

/// * `method` – `None` to accept what is truly good.
fn judge(method: Option<Method>, prior_sigma: f64, seed: u64) -> Result<Counts, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let team: SimulatedTeam<Isometry2<f64>, 3> =
        harbor(&Harbor { prior_sigma, ..Harbor::default() }, &mut rng)?;
    let labels = team.labels;
    let evidence = Evidence {
        reference: 0,
        trajectories: team.trajectories,
        closures: team.closures,
        map_transforms: team.priors,
    };
    let (accepted, noise_scale) = match method {
        Some(method) => {
            let judgement = select(method, &evidence)?;
            (judgement.selection.accepted, judgement.noise_scale)
        }
        None => ((0..labels.len()).filter(|&at| labels[at] == Label::Good).collect(), 1.0),
    };
    let starts = starts(&evidence, &accepted, noise_scale)?;
    let off = |(&robot, start): (&u32, &Isometry2<f64>)| {
        let truth = &team.reference_from_robot[robot as usize];
        (start.translation.vector - truth.translation.vector).norm()
    };
    let mut counts = Counts { start_errors: starts.iter().map(off).collect(), ..Counts::default() };
    for (index, label) in labels.iter().enumerate() {
        let kept = usize::from(accepted.contains(&index));
        let (good, biased) = (usize::from(*label == Label::Good), usize::from(*label == Label::Biased));
        counts.good += good;
        counts.biased += biased;
        counts.good_kept += good * kept;
        counts.biased_kept += biased * kept;
        // slightly biased closures are neither
        let judged = usize::from(*label != Label::Slight);
        counts.kept += judged * kept;
        counts.kept_right += good * kept;
    }
    Ok(counts)
}

/// Where the first keyframes of the other robots lie in the map of the first, by the accepted closures.
fn starts(
    evidence: &Evidence,
    accepted: &[usize],
    noise_scale: f64,
) -> Result<BTreeMap<u32, Isometry2<f64>>, Error> {
    let id = |key: PoseKey| KeyframeId { robot: key.robot, index: key.index as u32 };
    let closures: Vec<ClosureEntry> = accepted
        .iter()
        .map(|&at| &evidence.closures[at])
        .map(|closure| ClosureEntry {
            source: id(closure.source),
            target: id(closure.target),
            measured: closure.target_from_source,
            covariance: closure.covariance * noise_scale,
        })
        .collect();
    let share = Harbor::default().odometry;
    let covariance = Matrix3::from_diagonal(&Vector3::from(STEP_SIGMAS).map(|s| (share * s).powi(2)));
    let chain = |poses: &[Isometry2<f64>]| {
        let step = |(from, pair): (u32, &[Isometry2<f64>])| FactorEntry {
            from,
            to: from + 1,
            measured: pair[0].inv_mul(&pair[1]),
            covariance,
        };
        RobotGraph::from_map((0..).zip(poses.windows(2)).map(step).collect(), poses.to_vec())
    };
    let trajectories = &evidence.trajectories;
    let graphs: BTreeMap<u32, RobotGraph> = trajectories
        .robots()
        .filter_map(|robot| Some((robot, chain(trajectories.get(robot)?.poses()))))
        .collect();
    let reference = evidence.reference;
    let graphs = graphs.iter().map(|(&robot, graph)| (robot, graph)).collect();
    // one kernel for all tests: what they choose is compared here, and nothing else
    let kernel = Kernel::Cauchy(ClosureParams::default().cauchy);
    let (doubtful, doubtful_kernel) = (&[], kernel);
    let problem = TeamProblem { reference, graphs, closures: &closures, kernel, doubtful, doubtful_kernel };
    let team = problem.solve_full()?;
    let aligned = evidence.map_transforms.iter().filter(|place| place.target == reference);
    let mut starts: BTreeMap<u32, Isometry2<f64>> =
        aligned.map(|place| (place.source, place.target_from_source)).collect();
    for robot in team.robots().filter(|robot| *robot != reference) {
        starts.extend(team.pose(KeyframeId { robot, index: 0 }).map(|pose| (robot, *pose)));
    }
    Ok(starts)
}

/// The error that one robot in twenty exceeds, metres.
fn worst_of_twenty(teams: &[Counts]) -> Option<f64> {
    let mut all: Vec<f64> = teams.iter().flat_map(|team| team.start_errors.iter().copied()).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() * 19 / 20).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robots_start_where_unbiased_closures_put_them() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let clean = Harbor { biased_share: 0.0, gross_share: 0.0, prior_sigma: 10.0, ..Harbor::default() };
        let team: SimulatedTeam<Isometry2<f64>, 3> = harbor(&clean, &mut rng).unwrap();
        let (reference, map_transforms) = (0, team.priors);
        let all: Vec<usize> = (0..team.closures.len()).collect();
        let evidence =
            Evidence { reference, trajectories: team.trajectories, closures: team.closures, map_transforms };
        let off = |accepted: &[usize]| {
            let starts = starts(&evidence, accepted, 1.0).unwrap();
            assert_eq!(starts.keys().copied().collect::<Vec<_>>(), [1, 2]);
            let error = |(&robot, start): (&u32, &Isometry2<f64>)| {
                let truth = &team.reference_from_robot[robot as usize];
                (start.translation.vector - truth.translation.vector).norm()
            };
            starts.iter().map(error).fold(0.0, f64::max)
        };
        // without closures the alignment is all there is
        let (with, without) = (off(&all), off(&[]));
        assert!(with < 1.5 && without > 3.0, "{with} m with closures, {without} m without");
    }
}

use nalgebra::Isometry2;

use super::plan::Plan;
use crate::Error;
use crate::keyframe::{MissionData, Recording};
use crate::simulate::{SimulationParams, simulate};

/// Robots of a team that has a path each; the next ones follow the same paths again.
const PATHS: usize = 3;

/// The recordings of a plan: from every robot's path a stretch of a few keyframes. The first robot's begins where the plan
/// says. Those that are to be near follow the same path, each with errors of its own, and begin so that they come as near
/// to the first as they can; the others have paths of their own and begin where they like.
pub(super) fn record(plan: &Plan) -> Result<MissionData, Error> {
    let robots = plan.simulation.robots;
    let fleet = if plan.near { PATHS * (robots - 1) + 1 } else { robots };
    let mut data = simulate(&SimulationParams { robots: fleet, ..plan.simulation.clone() })?;
    if plan.near {
        data.recordings = data.recordings.into_iter().step_by(PATHS).collect();
        for (recording, robot) in data.recordings.iter_mut().zip(1..) {
            recording.robot = robot;
        }
    }
    let length = |recording: &Recording| plan.keyframes.min(recording.keyframes.len());
    let mut first: Option<Vec<Isometry2<f64>>> = None;
    for recording in &mut data.recordings {
        let starts = recording.keyframes.len() - length(recording) + 1;
        let begin = match &first {
            Some(path) if plan.near => nearest_stretch(recording, length(recording), path),
            _ => ((plan.begin * starts as f64) as usize).min(starts - 1),
        };
        let end = begin + length(recording);
        recording.keyframes = recording.keyframes[begin..end].to_vec();
        recording.truth = recording.truth[begin..end].to_vec();
        for (keyframe, index) in recording.keyframes.iter_mut().zip(0..) {
            keyframe.index = index;
        }
        first.get_or_insert_with(|| recording.truth.iter().copied().flatten().collect());
    }
    Ok(data)
}

/// Start of the stretch of `length` keyframes whose poses are on average nearest to those of `path`, each to the nearest.
fn nearest_stretch(recording: &Recording, length: usize, path: &[Isometry2<f64>]) -> usize {
    let distance = |pose: &Isometry2<f64>| {
        let to = |other: &Isometry2<f64>| (other.translation.vector - pose.translation.vector).norm();
        path.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    let distances: Vec<f64> = recording.truth.iter().map(|t| t.as_ref().map_or(0.0, distance)).collect();
    let sums = distances.windows(length).map(|window| window.iter().sum::<f64>());
    let best = sums.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(0, |(begin, _)| begin)
}

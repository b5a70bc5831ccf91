//! Submaps of simulated robots and the pairs of them that could be registered.

use nalgebra::{Isometry2, Point2};

use super::Settings;
use crate::error::Error;
use crate::evaluate::{ClosureGrade, HeadingTruth, grade_closure};
use crate::local_slam::LocalSlam;
use crate::robot::RobotParams;
use crate::simulate::{Scenario, SimulationParams, simulate};

/// One robot's own map and where it truly was.
pub(super) struct Surveyed {
    pub(super) slam: LocalSlam,
    pub(super) truth: Vec<Isometry2<f64>>,
}

/// The robots of a scenario, each mapped by itself.
pub(super) fn survey(scenario: Scenario, seed: u64, settings: &Settings<'_>) -> Result<Vec<Surveyed>, Error> {
    let data = simulate(&SimulationParams { scenario, seed, ..SimulationParams::default() })?;
    let mut all = Vec::new();
    for recording in data.recordings {
        let mut slam = LocalSlam::new(RobotParams::default().local);
        for keyframe in &recording.keyframes {
            slam.add(keyframe.clone())?;
        }
        all.push(Surveyed { slam, truth: recording.truth.into_iter().flatten().collect() });
    }
    (settings.progress)(&format!("{} {seed} mapped", scenario.name()));
    Ok(all)
}

impl Surveyed {
    /// Keyframe `k` and `half` on both sides, in its frame.
    pub(super) fn submap(&self, k: usize, half: usize) -> Vec<Point2<f64>> {
        self.slam.submap(k.saturating_sub(half), k + half, k)
    }

    pub(super) fn len(&self) -> usize {
        self.truth.len()
    }
}

/// Grades a registration of keyframe `j` of `source` in keyframe `i` of `target`.
pub(super) fn grade(
    (target, i): (&Surveyed, usize),
    (source, j): (&Surveyed, usize),
    target_from_source: &Isometry2<f64>,
) -> ClosureGrade {
    grade_closure(target_from_source, (&target.truth[i], &source.truth[j]), HeadingTruth::Independent)
}

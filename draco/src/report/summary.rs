use std::collections::BTreeMap;

use serde::Serialize;

use super::{ClosureReport, RunReport};
use crate::evaluate::{ClosureCounts, Decision, TrajectoryError};
use crate::keyframe::RobotId;

/// Version of the layout of `summary.json`.
const SCHEMA: u32 = 1;

/// `summary.json`: what a program needs to judge a run. `null` stands where there is no truth to judge by.
///
/// The same run gives the same bytes, `timing` apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Version of this layout.
    pub schema: u32,
    /// Name of the scenario or of the data set's folder.
    pub scenario: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Name of the consistency test.
    pub consistency: String,
    /// Other settings by name.
    pub settings: BTreeMap<String, String>,
    /// Whether headings of closures were judged.
    pub truth_has_heading: bool,
    /// One entry a robot.
    pub robots: Vec<RobotSummary>,
    /// The robots together.
    pub team: TeamSummary,
    /// Closures between robots, in the order they were proposed.
    pub closures: Vec<ClosureSummary>,
    /// Seconds of computing by stage: the only field that differs between two equal runs.
    pub timing: BTreeMap<String, f64>,
}

/// One robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RobotSummary {
    /// The robot's number.
    pub id: RobotId,
    /// How many keyframes it recorded.
    pub keyframes: usize,
    /// Whether it is in the common frame.
    pub merged: bool,
    /// Length of its final trajectory, metres.
    pub path_m: f64,
    /// Position RMSE of its dead reckoning after one alignment, metres.
    pub ate_dead_reckoning_m: Option<f64>,
    /// The same for its local SLAM alone.
    pub ate_local_m: Option<f64>,
    /// The same for its final trajectory.
    pub ate_m: Option<f64>,
    /// Position RMSE of its final trajectory after the one alignment of the whole team, metres; `null` if it is not merged.
    pub ate_in_team_m: Option<f64>,
    /// Closures it proposed.
    pub closures: CountSummary,
    /// Bits it sent, by type of message; `repeat` are packets sent again, `status` what keeps the link going.
    pub sent_bits: BTreeMap<String, u64>,
    /// Packets and messages it did not take in, by reason.
    pub refused: BTreeMap<String, u64>,
}

/// Closures of one robot or of the team.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CountSummary {
    /// How many were proposed.
    pub proposed: usize,
    /// How many were accepted.
    pub accepted: usize,
    /// How many wait for more evidence.
    pub undecided: usize,
    /// How many of the accepted are right; `null` where there is no truth.
    pub true_accepted: Option<usize>,
    /// How many of the proposed are right; `null` where there is no truth.
    pub true_proposed: Option<usize>,
}

/// The robots together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TeamSummary {
    /// Robots in the common frame.
    pub merged_robots: usize,
    /// Position RMSE of all of them after one alignment, metres.
    pub ate_m: Option<f64>,
    /// Share of the accepted closures that are right (2.5 m, 2.5°).
    pub precision: Option<f64>,
    /// Share of the right closures that were accepted.
    pub recall: Option<f64>,
    /// Share of the accepted closures that are right within 0.5 m and 2°.
    pub precision_strict: Option<f64>,
    /// Mean normalised error squared of the accepted closures, a degree of freedom; 1 when covariances are honest.
    pub closure_nees: Option<f64>,
    /// Closures of the team.
    pub closures: CountSummary,
    /// Bits sent by all.
    pub sent_bits: u64,
    /// Bits sent by all for each accepted closure.
    pub bits_per_accepted_closure: Option<f64>,
}

/// One closure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClosureSummary {
    /// Robot and keyframe that proposed it.
    pub a: (RobotId, u32),
    /// The partner's robot and keyframe.
    pub b: (RobotId, u32),
    /// Seconds into the mission.
    pub time: f64,
    /// `accepted`, `rejected` or `undecided`.
    pub decision: &'static str,
    /// Why.
    pub reason: String,
    /// Within 2.5 m (and 2.5°) of the truth.
    pub correct: Option<bool>,
    /// Distance from the true relative position, metres.
    pub position_error_m: Option<f64>,
    /// Heading error, degrees.
    pub heading_error_deg: Option<f64>,
}

impl Decision {
    /// The word for it in tables and files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Rejected => "rejected",
            Self::Undecided => "undecided",
        }
    }
}

impl RunReport {
    /// The run judged and condensed.
    pub fn summary(&self) -> Summary {
        Summary {
            schema: SCHEMA,
            scenario: self.scenario.clone(),
            seed: self.seed,
            consistency: self.consistency.clone(),
            settings: self.settings.iter().cloned().collect(),
            truth_has_heading: self.truth_has_heading,
            robots: self.robots.iter().map(|robot| self.robot_summary(robot)).collect(),
            team: self.team_summary(),
            closures: self.closures.iter().map(|closure| self.closure_summary(closure)).collect(),
            timing: self.timing.clone(),
        }
    }

    fn robot_summary(&self, robot: &super::RobotReport) -> RobotSummary {
        RobotSummary {
            id: robot.id,
            keyframes: robot.trajectory.len(),
            merged: robot.merged,
            path_m: robot.path_length(),
            ate_dead_reckoning_m: robot.dead_reckoning_error().map(rmse),
            ate_local_m: robot.local_error().map(rmse),
            ate_m: robot.error().map(rmse),
            ate_in_team_m: self.error_in_team(robot).map(rmse),
            closures: self.count(|closure| closure.a.robot == robot.id),
            sent_bits: self.sent_bits(robot.id),
            refused: robot.refused.clone(),
        }
    }

    fn team_summary(&self) -> TeamSummary {
        let closures = self.counts(|_| true);
        let sent_bits: u64 = self.traffic.iter().map(|message| message.bits).sum();
        let accepted = || self.closures.iter().filter(|closure| closure.decision == Decision::Accepted);
        let strict: Vec<_> = accepted().filter_map(|closure| Some(self.grade(closure)?.strict)).collect();
        let nees: Vec<_> = accepted().filter_map(|closure| self.nees(closure)).collect();
        TeamSummary {
            merged_robots: self.merged().count(),
            ate_m: self.team_error().map(rmse),
            precision: closures.precision(),
            recall: closures.recall(),
            precision_strict: mean(strict.iter().map(|&right| f64::from(u8::from(right)))),
            closure_nees: mean(nees.iter().copied()),
            closures: self.count(|_| true),
            sent_bits,
            bits_per_accepted_closure: (closures.accepted > 0)
                .then(|| sent_bits as f64 / closures.accepted as f64),
        }
    }

    fn counts(&self, select: impl Fn(&ClosureReport) -> bool) -> ClosureCounts {
        let mut counts = ClosureCounts::default();
        for closure in self.closures.iter().filter(|closure| select(closure)) {
            counts.add(closure.decision, self.grade(closure).map(|grade| grade.correct));
        }
        counts
    }

    fn count(&self, select: impl Fn(&ClosureReport) -> bool) -> CountSummary {
        let counts = self.counts(&select);
        let waits = |closure: &&ClosureReport| closure.decision == Decision::Undecided && select(closure);
        let mut selected = self.closures.iter().filter(|closure| select(closure)).peekable();
        let has_truth = self.robots.iter().any(|robot| robot.truth.iter().any(Option::is_some))
            && (selected.peek().is_none() || selected.any(|closure| self.grade(closure).is_some()));
        CountSummary {
            proposed: counts.proposed,
            accepted: counts.accepted,
            undecided: self.closures.iter().filter(waits).count(),
            true_accepted: has_truth.then_some(counts.true_accepted),
            true_proposed: has_truth.then_some(counts.true_proposed),
        }
    }

    fn closure_summary(&self, closure: &ClosureReport) -> ClosureSummary {
        let grade = self.grade(closure);
        ClosureSummary {
            a: (closure.a.robot, closure.a.index),
            b: (closure.b.robot, closure.b.index),
            time: closure.time,
            decision: closure.decision.as_str(),
            reason: closure.reason.clone(),
            correct: grade.map(|grade| grade.correct),
            position_error_m: grade.map(|grade| grade.position_error_m),
            heading_error_deg: grade.and_then(|grade| grade.heading_error_rad).map(f64::to_degrees),
        }
    }
}

fn rmse(error: TrajectoryError) -> f64 {
    error.rmse_m
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = values.len();
    (count > 0).then(|| values.sum::<f64>() / count as f64)
}

use std::collections::BTreeMap;

use nalgebra::{Isometry2, Matrix3, Point2, Vector2};

use crate::evaluate::{ClosureGrade, Decision, HeadingTruth, TrajectoryError, absolute_trajectory_error};
use crate::evaluate::{aligned_trajectory_error, closure_nees, grade_closure};
use crate::keyframe::RobotId;

/// All that a run has to say.
#[derive(Debug, Clone, Default)]
pub struct RunReport {
    /// Name of the scenario or of the data set's folder.
    pub scenario: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Name of the consistency test.
    pub consistency: String,
    /// Whether the truth can judge headings.
    pub truth_has_heading: bool,
    /// Other settings worth telling, as name and value.
    pub settings: Vec<(String, String)>,
    /// One entry a robot, ascending in id.
    pub robots: Vec<RobotReport>,
    /// Closures between robots, in the order they were proposed.
    pub closures: Vec<ClosureReport>,
    /// Every message sent, in order of time.
    pub traffic: Vec<Traffic>,
    /// Bits a second the link carries, where it has a limit.
    pub link_bits_per_second: Option<f64>,
    /// The joint pose graph of the merged robots as g2o text; empty writes no file.
    pub graph_g2o: String,
    /// Seconds of computing by stage.
    pub timing: BTreeMap<String, f64>,
}

/// One robot at the end of a run.
#[derive(Debug, Clone, Default)]
pub struct RobotReport {
    /// The robot's number.
    pub id: RobotId,
    /// Whether its trajectory is in the common frame of a team of at least two.
    pub merged: bool,
    /// Times of its keyframes, seconds.
    pub times: Vec<f64>,
    /// Dead reckoning, one pose a keyframe, in a frame of the robot's own.
    pub dead_reckoning: Vec<Isometry2<f64>>,
    /// Local SLAM without any other robot's help, in a frame of the robot's own; may be empty.
    pub local: Vec<Isometry2<f64>>,
    /// The final estimate, in the common frame if `merged`, else in a frame of the robot's own.
    pub trajectory: Vec<Isometry2<f64>>,
    /// True poses, where known.
    pub truth: Vec<Option<Isometry2<f64>>>,
    /// Feature points in the sensor frame, one set a keyframe.
    pub points: Vec<Vec<Point2<f64>>>,
    /// Closures inside the robot's own trajectory, as pairs of keyframe indices.
    pub own_closures: Vec<(u32, u32)>,
    /// Objects of its map, in the frame of `trajectory`.
    pub objects: Vec<ObjectReport>,
    /// How its map was matched to partners' maps.
    pub matched: Vec<Matched>,
    /// Packets and messages it did not take in, by reason.
    pub refused: BTreeMap<String, u64>,
}

/// A robot's map placed by map-to-map alignment.
#[derive(Debug, Clone, PartialEq)]
pub struct Matched {
    /// The partner.
    pub partner: RobotId,
    /// When, seconds.
    pub time: f64,
    /// Verdict of the alignment in a word or a sentence.
    pub verdict: String,
}

/// An object as the map shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectReport {
    /// Stable number within the robot.
    pub id: u32,
    /// Centroid, metres.
    pub centroid: Point2<f64>,
    /// Corners of its rectangle.
    pub corners: [Point2<f64>; 4],
}

/// A keyframe of some robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct KeyframeRef {
    /// The robot's number.
    pub robot: RobotId,
    /// Index of the keyframe within the robot.
    pub index: u32,
}

/// A proposed closure between two robots.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosureReport {
    /// Keyframe of the robot that proposed the closure.
    pub a: KeyframeRef,
    /// Keyframe of the partner.
    pub b: KeyframeRef,
    /// Pose of keyframe b seen from keyframe a, as registered.
    pub a_from_b: Isometry2<f64>,
    /// Its covariance, order x, y, θ, in the frame of b.
    pub covariance: Option<Matrix3<f64>>,
    /// When it was proposed, seconds.
    pub time: f64,
    /// What became of it.
    pub decision: Decision,
    /// Why, in a few words; the same words for the same cause.
    pub reason: String,
}

/// One message on the link.
#[derive(Debug, Clone, PartialEq)]
pub struct Traffic {
    /// When it was sent, seconds.
    pub time: f64,
    /// Who sent it.
    pub robot: RobotId,
    /// Type of message.
    pub kind: String,
    /// Its size on the link, headers included.
    pub bits: u64,
}

impl RobotReport {
    /// Error of the dead reckoning over the robot's own keyframes.
    pub fn dead_reckoning_error(&self) -> Option<TrajectoryError> {
        absolute_trajectory_error(&self.dead_reckoning, &self.truth)
    }

    /// Error of local SLAM over the robot's own keyframes.
    pub fn local_error(&self) -> Option<TrajectoryError> {
        absolute_trajectory_error(&self.local, &self.truth)
    }

    /// Error of the final estimate over the robot's own keyframes.
    pub fn error(&self) -> Option<TrajectoryError> {
        absolute_trajectory_error(&self.trajectory, &self.truth)
    }

    /// Length of the final trajectory, metres.
    pub fn path_length(&self) -> f64 {
        let position = |pose: &Isometry2<f64>| pose.translation.vector;
        self.trajectory.windows(2).map(|pair| (position(&pair[1]) - position(&pair[0])).norm()).sum()
    }
}

impl RunReport {
    /// The robot of number `id`.
    pub fn robot(&self, id: RobotId) -> Option<&RobotReport> {
        self.robots.iter().find(|robot| robot.id == id)
    }

    /// Robots whose trajectories share the common frame.
    pub fn merged(&self) -> impl Iterator<Item = &RobotReport> {
        self.robots.iter().filter(|robot| robot.merged)
    }

    /// Error of all merged robots in the common frame after one alignment for all.
    pub fn team_error(&self) -> Option<TrajectoryError> {
        let estimate = self.merged().flat_map(|robot| &robot.trajectory);
        absolute_trajectory_error(estimate, self.merged().flat_map(|robot| &robot.truth))
    }

    /// Error of one merged robot in the common frame, under the one alignment of [`RunReport::team_error`]; `None` for one
    /// that is not merged. Beside the error by its own alignment it shows whether the robot's map lies at its place.
    pub fn error_in_team(&self, robot: &RobotReport) -> Option<TrajectoryError> {
        let team = self.team_error().filter(|_| robot.merged)?;
        aligned_trajectory_error(&team.truth_from_estimate, &robot.trajectory, &robot.truth)
    }

    fn heading(&self) -> HeadingTruth {
        HeadingTruth::of(self.truth_has_heading)
    }

    fn truth_of(&self, keyframe: KeyframeRef) -> Option<&Isometry2<f64>> {
        self.robot(keyframe.robot)?.truth.get(keyframe.index as usize)?.as_ref()
    }

    /// `closure` judged by the truth, where both keyframes have one.
    pub fn grade(&self, closure: &ClosureReport) -> Option<ClosureGrade> {
        let truth = (self.truth_of(closure.a)?, self.truth_of(closure.b)?);
        Some(grade_closure(&closure.a_from_b, truth, self.heading()))
    }

    /// Normalised error squared of `closure`, a degree of freedom; `None` without truth or covariance.
    pub fn nees(&self, closure: &ClosureReport) -> Option<f64> {
        let truth = (self.truth_of(closure.a)?, self.truth_of(closure.b)?);
        closure_nees(&closure.a_from_b, closure.covariance.as_ref()?, truth, self.heading())
    }

    /// Position of a keyframe in the frame of its robot's final trajectory.
    pub fn position_of(&self, keyframe: KeyframeRef) -> Option<Vector2<f64>> {
        Some(self.robot(keyframe.robot)?.trajectory.get(keyframe.index as usize)?.translation.vector)
    }

    /// Bits sent by `robot`, by type of message.
    pub fn sent_bits(&self, robot: RobotId) -> BTreeMap<String, u64> {
        let mut sent = BTreeMap::new();
        for message in self.traffic.iter().filter(|message| message.robot == robot) {
            *sent.entry(message.kind.clone()).or_default() += message.bits;
        }
        sent
    }

    /// Types of message that were sent, in order of name.
    pub fn message_kinds(&self) -> Vec<String> {
        let kinds: std::collections::BTreeSet<_> = self.traffic.iter().map(|m| m.kind.clone()).collect();
        kinds.into_iter().collect()
    }
}

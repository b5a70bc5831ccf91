//! Keyframes: what every later stage consumes.

use nalgebra::{Isometry2, Point2};
use serde::{Deserialize, Serialize};

/// Number of a robot as its data names it.
pub type RobotId = u32;

/// One keyframe of one robot: the points its sonar saw and where dead reckoning put it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Keyframe {
    /// Counts from 0 within its robot, without gaps.
    pub index: u32,
    /// Seconds from the start of the mission.
    pub time: f64,
    /// Pose of the vehicle by dead reckoning, in any frame fixed for this robot: only the relative motion between
    /// keyframes of one robot means anything.
    pub odometry: Isometry2<f64>,
    /// Feature points in the sensor frame, metres, x forward and y to port. May be empty.
    pub points: Vec<Point2<f64>>,
}

/// Everything one robot records on a mission, with the truth beside it where it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The robot's number.
    pub robot: RobotId,
    /// Its keyframes in order of time; `keyframes[i].index == i`.
    pub keyframes: Vec<Keyframe>,
    /// True poses in one world frame, one a keyframe, `None` where unknown. Used for evaluation only.
    pub truth: Vec<Option<Isometry2<f64>>>,
}

/// The recordings of all robots of a mission.
#[derive(Debug, Clone, PartialEq)]
pub struct MissionData {
    /// Name of the scenario or of the data set's folder.
    pub name: String,
    /// One entry a robot, ascending in `robot`.
    pub recordings: Vec<Recording>,
    /// Whether the headings of the truth come from an independent source; if not, only positions are graded.
    pub truth_has_heading: bool,
}

//! What robots say to each other, to the byte.
//!
//! A [`Frame`] is one [`Message`] and whom it is for. Lengths are metres, angles radians and points metres on this side;
//! on the wire everything is a whole number (see [`Resolution`]) in the compact variable-length coding of the `postcard`
//! crate, so a decoded message is the quantised one. Bytes that do not parse, are left over or say what cannot be are
//! refused with a [`WireError`] that says which. The packets that carry a frame, their version, numbers and tags, are in
//! [`transport`](crate::transport).

mod frame;
mod quadtree;
mod quantise;

pub use frame::{BROADCAST, Frame, WireError};
pub use quantise::Resolution;

use nalgebra::{Isometry2, Matrix3, Point2, Vector2};
use serde::{Deserialize, Serialize};

use crate::keyframe::RobotId;

/// One keyframe of one robot, as messages name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct KeyframeId {
    /// The robot.
    pub robot: RobotId,
    /// The keyframe's index within the robot.
    pub index: u32,
}

/// An object of the sender's map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectEntry {
    /// The sender's number of the object.
    pub id: u32,
    /// Centre in the sender's map frame, metres.
    pub centroid: Point2<f64>,
    /// Longer side of the object's rectangle, metres.
    pub length: f64,
    /// Shorter side, metres.
    pub breadth: f64,
}

/// Persistent cells of the sender's map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellMap {
    /// Edge of a cell, metres; sent in centimetres.
    pub size: f64,
    /// Number of the sender's keyframes that the map is made of.
    pub keyframes: u32,
    /// Column and row of each occupied cell, ascending; cell `(i, j)` covers `[i, i + 1) x [j, j + 1)` times `size`.
    pub cells: Vec<[i32; 2]>,
}

impl CellMap {
    /// Centres of the cells in the map's frame, metres.
    pub fn centres(&self) -> Vec<Point2<f64>> {
        let centre = |[i, j]: &[i32; 2]| Point2::new(f64::from(*i) + 0.5, f64::from(*j) + 0.5) * self.size;
        self.cells.iter().map(centre).collect()
    }

    /// Mean of the cells' centres, the origin when there are none.
    pub fn middle(&self) -> Point2<f64> {
        let sum: Vector2<f64> = self.centres().iter().map(|c| c.coords).sum();
        Point2::from(sum / self.cells.len().max(1) as f64)
    }
}

/// What changed in the sender's object map since its last version.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectUpdate {
    /// Counts the sender's updates; applies to the version before this one.
    pub version: u32,
    /// Whether this is the whole map, which applies to any version.
    pub whole: bool,
    /// New objects, and ones that have moved or changed their size.
    pub changed: Vec<ObjectEntry>,
    /// Numbers of objects that are no more.
    pub removed: Vec<u32>,
}

/// What changed in the sender's persistent cells since its last version.
#[derive(Debug, Clone, PartialEq)]
pub struct CellUpdate {
    /// Counts the sender's updates; applies to the version before this one.
    pub version: u32,
    /// Whether this is the whole map, which applies to any version.
    pub whole: bool,
    /// Edge of a cell, metres; sent in centimetres.
    pub size: f64,
    /// Number of the sender's keyframes that the map is made of.
    pub keyframes: u32,
    /// Cells that were not occupied before.
    pub added: Vec<[i32; 2]>,
    /// Cells that no longer are.
    pub removed: Vec<[i32; 2]>,
}

/// A relative-pose measurement inside the sender's own pose graph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FactorEntry {
    /// Keyframe the measurement is expressed in.
    pub from: u32,
    /// Keyframe that is measured.
    pub to: u32,
    /// `from_from_to`.
    pub measured: Isometry2<f64>,
    /// Covariance in the frame of `to`, order x, y, theta.
    pub covariance: Matrix3<f64>,
}

/// What changed in the sender's own pose graph since its last update.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GraphUpdate {
    /// Number of keyframes the sender now has.
    pub keyframes: u32,
    /// New factors, and changed ones: a factor with the same `from` and `to` is replaced.
    pub factors: Vec<FactorEntry>,
    /// Factors that are no longer believed, as `(from, to)`.
    pub removed: Vec<(u32, u32)>,
}

/// A loop closure between two robots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClosureEntry {
    /// The keyframe that is measured.
    pub source: KeyframeId,
    /// The keyframe the measurement is expressed in.
    pub target: KeyframeId,
    /// `target_from_source`.
    pub measured: Isometry2<f64>,
    /// Covariance in the frame of `source`, order x, y, theta.
    pub covariance: Matrix3<f64>,
}

impl ClosureEntry {
    /// The two robots, the smaller number first.
    pub fn robots(&self) -> (RobotId, RobotId) {
        let (a, b) = (self.source.robot, self.target.robot);
        (a.min(b), a.max(b))
    }

    /// The closure as whoever hears of it has it.
    ///
    /// # Errors
    /// Those of sending it.
    pub fn as_sent(&self) -> Result<Self, WireError> {
        quantise::closure_as_sent(self)
    }
}

/// Where another robot's map lies in the sender's, from comparing the two maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapPlace {
    /// The other's map in the sender's.
    pub sender_from_other: Isometry2<f64>,
    /// Covariance in the frame of the other's map, order x, y, theta.
    pub covariance: Matrix3<f64>,
}

impl MapPlace {
    /// The place as whoever hears of it has it.
    ///
    /// # Errors
    /// Those of sending it.
    pub fn as_sent(&self) -> Result<Self, WireError> {
        quantise::place_as_sent(self)
    }
}

/// The contents of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// What is new in the sender's object map.
    Objects(ObjectUpdate),
    /// What is new in the sender's persistent cells.
    Cells(CellUpdate),
    /// What changed in the sender's pose graph.
    Graph(GraphUpdate),
    /// "Send me these keyframes' points."
    ScanRequest(Vec<u32>),
    /// The points of one keyframe, in its sensor frame.
    Scan {
        /// The keyframe.
        keyframe: u32,
        /// Its points, quantised to the scan resolution; equal points are sent once.
        points: Vec<Point2<f64>>,
    },
    /// Closures the sender has registered under an alignment it believes, and ones whose alignment it has given up.
    ///
    /// They are evidence and not verdicts: every robot judges all of them by itself, so that no verdict rests on another
    /// robot's verdict about the same closures.
    Closures {
        /// New closures.
        found: Vec<ClosureEntry>,
        /// Closures withdrawn, by source and target.
        withdrawn: Vec<(KeyframeId, KeyframeId)>,
    },
    /// "Your map updates do not fit together; send me the whole maps."
    MapRequest,
    /// Where the map of another robot lies in the sender's, once the sender believes it, and `None` when no longer.
    ///
    /// Closures alone do not tell which of two groups that contradict each other is right. With everybody's places
    /// every robot judges them by the same evidence.
    Alignment {
        /// The other robot.
        partner: RobotId,
        /// Where its map lies.
        place: Option<MapPlace>,
    },
}

impl Message {
    /// Name of the message type, as it stands in tables and in `summary.json`.
    pub fn kind(&self) -> &'static str {
        match self {
            Message::Objects(_) => "objects",
            Message::Cells(_) => "cells",
            Message::Graph(_) => "graph",
            Message::ScanRequest(_) => "scan_request",
            Message::Scan { .. } => "scan",
            Message::Closures { .. } => "closures",
            Message::MapRequest => "map_request",
            Message::Alignment { .. } => "alignment",
        }
    }
}

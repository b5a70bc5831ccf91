//! What a robot knows of one other robot, all of it received over the link.

use std::collections::{BTreeMap, BTreeSet};

use draco_registration::correlative::MapMode;
use nalgebra::{Isometry2, Matrix3, Point2};
use serde::{Deserialize, Serialize};

use super::maps::ReceivedMaps;
use crate::keyframe::RobotId;
use crate::message::{ClosureEntry, KeyframeId, MapPlace};
use crate::robot_graph::RobotGraph;

/// How a [`MapMode`] is saved.
#[derive(Serialize, Deserialize)]
#[serde(remote = "MapMode")]
struct SavedMode {
    target_from_source: Isometry2<f64>,
    covariance: Matrix3<f64>,
    score: f64,
}

/// Where the partner's map lies in this robot's, as far as is known.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) enum Alignment {
    /// Nobody knows yet.
    #[default]
    Unknown,
    /// The maps fitted in this one clear way at the last attempts.
    Candidate {
        /// The latest of them.
        #[serde(with = "SavedMode")]
        mode: MapMode,
        /// Attempts in a row that agreed.
        streak: usize,
    },
    /// The maps fit in one clear way; closures have to confirm it before it is believed.
    Tentative(#[serde(with = "SavedMode")] MapMode),
    /// Confirmed.
    Accepted(#[serde(with = "SavedMode")] MapMode),
}

/// Another robot.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Partner {
    /// Its own pose graph and local map.
    pub(super) graph: RobotGraph,
    /// Whether factors have come that its poses do not follow yet.
    pub(super) graph_has_news: bool,
    /// Its persistent cells and its objects.
    pub(super) maps: ReceivedMaps,
    /// Scans received, by keyframe.
    pub(super) scans: BTreeMap<u32, Vec<Point2<f64>>>,
    /// Keyframes whose scans have been asked for.
    pub(super) requested: BTreeSet<u32>,
    /// Closures it found under alignments it believes, by source and target.
    pub(super) closures: BTreeMap<(KeyframeId, KeyframeId), ClosureEntry>,
    /// Where it believes other robots' maps to lie in its own.
    pub(super) places: BTreeMap<RobotId, MapPlace>,
    /// Where its map lies.
    pub(super) alignment: Alignment,
    /// Keyframes of both maps at the last attempt to align them for which both had grown.
    pub(super) compared: (usize, u32),
    /// Attempts in a row that contradicted the alignment held.
    pub(super) contradictions: usize,
    /// Where its map lay when keyframe pairs were last registered.
    pub(super) searched: Option<Isometry2<f64>>,
    /// Keyframe pairs already registered there (own, partner's), and whether the result passed its gate; `None` where there
    /// were too few points to try.
    pub(super) tested: BTreeMap<(u32, u32), Option<bool>>,
}

impl Partner {
    /// The alignment under which closures may be looked for.
    pub(super) fn hypothesis(&self) -> Option<&MapMode> {
        match &self.alignment {
            Alignment::Unknown | Alignment::Candidate { .. } => None,
            Alignment::Tentative(mode) | Alignment::Accepted(mode) => Some(mode),
        }
    }

    /// The partner's scans `first..=last` with their local poses, as far as they have arrived.
    pub(super) fn scans_between(
        &self,
        first: u32,
        last: u32,
    ) -> impl Iterator<Item = (Isometry2<f64>, &[Point2<f64>])> {
        self.scans
            .range(first..=last)
            .filter_map(|(&k, points)| Some((*self.graph.poses().get(k as usize)?, points.as_slice())))
    }

    /// Forgets a hypothesis that closures did not confirm, and what was tested under it.
    pub(super) fn drop_hypothesis(&mut self) {
        self.alignment = Alignment::Unknown;
        self.contradictions = 0;
        self.tested.clear();
    }
}

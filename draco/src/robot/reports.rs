//! What a robot tells about itself after a mission.

use draco_pgo::io::g2o;

use super::Robot;
use crate::error::Error;
use crate::report::{ClosureReport, KeyframeRef, Matched, ObjectReport};
use crate::robot_graph::RobotGraph;
use crate::two_step::TeamProblem;

impl Robot {
    /// The closures this robot proposed, in order of source and target; measured keyframe is `b`.
    pub fn closure_reports(&self) -> Vec<ClosureReport> {
        let reference = |k: crate::message::KeyframeId| KeyframeRef { robot: k.robot, index: k.index };
        self.proposals
            .values()
            .map(|proposal| ClosureReport {
                a: reference(proposal.entry.target),
                b: reference(proposal.entry.source),
                a_from_b: proposal.entry.measured,
                covariance: Some(proposal.entry.covariance),
                time: proposal.time,
                decision: proposal.decision,
                reason: proposal.reason.clone(),
            })
            .collect()
    }

    /// Loop closures inside the robot's own map, as (earlier, later) keyframe.
    pub fn own_closures(&self) -> Vec<(u32, u32)> {
        let loops = self.own_factors().into_iter().filter(|f| f.to != f.from + 1);
        loops.map(|f| (f.from.min(f.to), f.from.max(f.to))).collect()
    }

    /// How the robot's attempts to align its map with its partners' went.
    pub fn alignment_reports(&self) -> Vec<Matched> {
        let matched = |e: &super::AlignmentEvent| Matched {
            partner: e.partner,
            time: e.time,
            verdict: e.verdict.clone(),
        };
        self.events.iter().map(matched).collect()
    }

    /// The objects of the robot's map in the frame of `trajectory`, its poses in the frame wanted.
    ///
    /// # Errors
    /// Those of object extraction.
    pub fn object_reports(
        &self,
        trajectory: &[nalgebra::Isometry2<f64>],
    ) -> Result<Vec<ObjectReport>, Error> {
        let objects = crate::objects::extract(self.local.keyframes(), trajectory, &self.params.objects)?;
        Ok(objects
            .into_iter()
            .map(|o| ObjectReport { id: o.id, centroid: o.centroid, corners: o.corners })
            .collect())
    }

    /// The graph of the team as this robot has it, as g2o text, at the estimated poses.
    ///
    /// # Errors
    /// Those of the graph.
    pub fn team_graph_g2o(&self) -> Result<String, Error> {
        let own = RobotGraph::from_map(self.own_factors(), self.local.poses().to_vec());
        let problem = self.team_problem(&own);
        let mut graph = problem.graph()?;
        for (key, pose) in self.team.keyed_poses() {
            graph.set_pose(key, pose)?;
        }
        Ok(g2o::to_text(&graph)?)
    }

    pub(super) fn team_problem<'a>(&'a self, own: &'a RobotGraph) -> TeamProblem<'a> {
        let mut graphs: std::collections::BTreeMap<_, _> =
            self.partners.iter().map(|(&id, p)| (id, &p.graph)).collect();
        graphs.insert(self.id, own);
        let placed = self.partners.iter().filter_map(|(&id, p)| Some((id, self.own_from_partner(id, p)?)));
        TeamProblem {
            reference: self.id,
            graphs,
            reference_from_map: placed.collect(),
            closures: &self.accepted,
        }
    }
}

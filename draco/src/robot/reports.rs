//! What a robot tells about itself after a mission.

use std::time::Instant;

use draco_pgo::io::g2o;
use draco_pgo::{Kernel, Key};

use nalgebra::Isometry2;

use super::Robot;
use crate::closure::ClosureParams;
use crate::consistency::Method;
use crate::error::Error;
use crate::keyframe::RobotId;
use crate::report::{ClosureReport, KeyframeRef, Matched, ObjectReport};
use crate::robot_graph::RobotGraph;
use crate::two_step::{Optimisation, TeamProblem};

/// What a robot has of another one; within an epoch all of it only grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KnownVersions {
    /// The other robot.
    pub robot: RobotId,
    /// Its epoch.
    pub epoch: u32,
    /// Packets of its stream that have arrived in order.
    pub packets: u32,
    /// Version of its cells.
    pub cells: u32,
    /// Version of its objects.
    pub objects: u32,
}

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

    /// What this robot has of every other one.
    pub fn known_versions(&self) -> Vec<KnownVersions> {
        let of = |(&robot, partner): (&RobotId, &super::partner::Partner)| {
            let (cells, objects) = partner.maps.versions();
            let (epoch, packets) = self.transport.progress_of(robot);
            KnownVersions { robot, epoch, packets, cells, objects }
        };
        self.partners.iter().map(of).collect()
    }

    /// A hash of every bit of the own map and of the estimate of the team.
    pub fn fingerprint(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut add = |poses: &[Isometry2<f64>]| {
            hasher.update(&(poses.len() as u64).to_le_bytes());
            for pose in poses {
                let values = [pose.translation.x, pose.translation.y, pose.rotation.re, pose.rotation.im];
                for value in values {
                    hasher.update(&value.to_le_bytes());
                }
            }
        };
        add(self.local_poses());
        self.team.robots().filter_map(|robot| self.team.trajectory(robot)).for_each(add);
        hasher.finalize().to_hex()[..16].to_owned()
    }

    /// Points of all keyframes of the own map.
    pub fn point_count(&self) -> usize {
        self.local.keyframes().iter().map(|keyframe| keyframe.points.len()).sum()
    }

    /// Where a partner's map lies in this robot's, if both are in one frame.
    pub fn places(&self, partner: RobotId) -> Option<Isometry2<f64>> {
        self.team.trajectory(partner)?;
        self.own_from_partner(partner, self.partners.get(&partner)?)
    }

    /// Loop closures inside the robot's own map, as (earlier, later) keyframe.
    pub fn own_closures(&self) -> Vec<(u32, u32)> {
        self.local.loop_closures()
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
    pub fn object_reports(&self, trajectory: &[Isometry2<f64>]) -> Result<Vec<ObjectReport>, Error> {
        let objects = crate::objects::extract(self.local.keyframes(), trajectory, &self.params.objects)?;
        Ok(objects
            .into_iter()
            .map(|o| ObjectReport { id: o.id, centroid: o.centroid, corners: o.corners })
            .collect())
    }

    /// The graph of the team as this robot has it, as g2o text, at the estimated poses. The id of keyframe `i` of robot
    /// `r` is `1 000 000 r + i`: the programs of g2o keep ids in 32 bits.
    ///
    /// # Errors
    /// Those of the graph.
    pub fn team_graph_g2o(&self) -> Result<String, Error> {
        let own = self.own_graph()?;
        let problem = self.team_problem(&own);
        let mut graph = problem.graph()?;
        for (key, pose) in self.team.keyed_poses() {
            graph.set_pose(key, pose)?;
        }
        Ok(with_small_ids(&g2o::to_text(&graph)?))
    }

    /// Seconds that estimating the team anew takes.
    ///
    /// # Errors
    /// Those of the graph and of the solver.
    pub(crate) fn time_of(&self, optimisation: Optimisation) -> Result<f64, Error> {
        let own = self.own_graph()?;
        let begin = Instant::now();
        self.team_problem(&own).solve(optimisation)?;
        Ok(begin.elapsed().as_secs_f64())
    }

    pub(super) fn team_problem<'a>(&'a self, own: &'a RobotGraph) -> TeamProblem<'a> {
        let mut graphs: std::collections::BTreeMap<_, _> =
            self.partners.iter().map(|(&id, p)| (id, &p.graph)).collect();
        graphs.insert(self.id, own);
        let ClosureParams { cauchy, cauchy_believed, .. } = self.params.closure;
        let kernel = if self.params.method == Method::Gcm { cauchy_believed } else { cauchy };
        TeamProblem {
            reference: self.id,
            graphs,
            closures: &self.accepted,
            kernel: Kernel::Cauchy(kernel),
            doubtful: &self.doubtful,
            doubtful_kernel: Kernel::Cauchy(cauchy),
        }
    }
}

/// Ids in which the robot has the upper of 64 bits, in decimal digits instead.
fn with_small_ids(text: &str) -> String {
    let mut small = String::new();
    for line in text.lines() {
        let ids = if line.starts_with("EDGE_SE2 ") { 2 } else { 1 };
        for (at, token) in line.split(' ').enumerate() {
            let id = token.parse::<u64>().ok().filter(|_| (1..=ids).contains(&at));
            small += if at == 0 { "" } else { " " };
            match id.map(Key::from_id) {
                Some(key) => small += &(u64::from(key.robot) * 1_000_000 + key.index).to_string(),
                None => small += token,
            }
        }
        small.push('\n');
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_fit_into_32_bits_and_nothing_else_changes() {
        let (a, b) = ((2_u64 << 56) | 7, (3_u64 << 56) | 12);
        let text = format!("VERTEX_SE2 {a} 1 2 3\nFIX {a}\nEDGE_SE2 {a} {b} 0.5 7 1 2 0 0 3 0 4\n");
        let small = "VERTEX_SE2 2000007 1 2 3\nFIX 2000007\nEDGE_SE2 2000007 3000012 0.5 7 1 2 0 0 3 0 4\n";
        assert_eq!(with_small_ids(&text), small);
    }
}

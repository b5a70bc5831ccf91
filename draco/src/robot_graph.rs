//! One robot's own pose graph, as its partners know it.
//!
//! Robots tell each other the factors of their own graphs, never the poses that others helped to estimate. Whoever
//! holds the factors can rebuild the sender's local map, the joint covariance of any of its poses, and can take the
//! factors into a graph of the whole team, each measurement exactly once.

use std::collections::BTreeMap;

use draco_consistency::Trajectory2;
use draco_pgo::{Gauge, Kernel, Key, Marginals, PoseGraph2, SolveParams, solve};
use nalgebra::Isometry2;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::RobotId;
use crate::message::{FactorEntry, GraphUpdate};

/// Kernel of loop closures inside a robot: steps are taken at their word, loops may still be wrong after PCM.
pub const LOOP_KERNEL: Kernel = Kernel::Cauchy(1.0);

/// The factors of one robot's own graph and the map they make; the first keyframe is the origin.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct RobotGraph {
    factors: BTreeMap<(u32, u32), FactorEntry>,
    poses: Vec<Isometry2<f64>>,
}

impl RobotGraph {
    /// A graph that has been solved already.
    pub fn from_map(factors: Vec<FactorEntry>, poses: Vec<Isometry2<f64>>) -> Self {
        let factors = factors.into_iter().map(|factor| ((factor.from, factor.to), factor)).collect();
        RobotGraph { factors, poses }
    }

    /// Takes in what changed. Returns whether anything did.
    pub fn apply(&mut self, update: &GraphUpdate) -> bool {
        let mut changed = false;
        for pair in &update.removed {
            changed |= self.factors.remove(pair).is_some();
        }
        for factor in &update.factors {
            let old = self.factors.insert((factor.from, factor.to), factor.clone());
            changed |= old.as_ref() != Some(factor);
        }
        changed
    }

    /// The poses of the local map, one a keyframe; as of the last [`RobotGraph::solve`].
    pub fn poses(&self) -> &[Isometry2<f64>] {
        &self.poses
    }

    /// The factors, ascending in `(from, to)`.
    pub fn factors(&self) -> impl Iterator<Item = &FactorEntry> {
        self.factors.values()
    }

    /// Number of keyframes, from the first, that steps from one to the next connect.
    pub fn connected(&self) -> usize {
        let mut count = 0;
        while self.factors.contains_key(&(count, count + 1)) {
            count += 1;
        }
        if self.factors.is_empty() { 0 } else { count as usize + 1 }
    }

    /// Rebuilds the local map from the factors, starting from the last one.
    ///
    /// # Errors
    /// Those of the solver; the old map stays.
    pub fn solve(&mut self) -> Result<(), Error> {
        let count = self.connected();
        let mut poses = self.poses.clone();
        poses.truncate(count);
        if poses.is_empty() && count > 0 {
            poses.push(Isometry2::identity());
        }
        while poses.len() < count {
            let last = poses.len() as u32 - 1;
            let step = self.factors[&(last, last + 1)].measured;
            poses.push(poses[last as usize] * step);
        }
        if count > 1 {
            let graph = self.graph(0, &poses)?;
            let solution = solve(&graph, &SolveParams::default())?;
            for (index, pose) in poses.iter_mut().enumerate() {
                if let Some(solved) = solution.pose(Key::new(0, index as u64)) {
                    *pose = *solved;
                }
            }
        }
        self.poses = poses;
        Ok(())
    }

    /// Adds this robot's poses, placed by `frame_from_map`, and its factors to a graph of the team.
    ///
    /// # Errors
    /// Those of the graph, for a key that is taken or a factor that cannot be.
    pub fn add_to(
        &self,
        graph: &mut PoseGraph2,
        robot: RobotId,
        frame_from_map: &Isometry2<f64>,
    ) -> Result<(), Error> {
        add(graph, robot, self.poses.iter().map(|pose| frame_from_map * pose), self.factors())
    }

    /// The trajectory with the joint covariance of the keyframes `touched`, for consistency tests.
    ///
    /// # Errors
    /// Those of the solver.
    pub fn trajectory(&self, touched: &[u32]) -> Result<Trajectory2, Error> {
        let marginals = Marginals::new(&self.graph(0, &self.poses)?, Gauge::HoldFirst)?;
        let keys: Vec<Key> = touched.iter().map(|&index| Key::new(0, index.into())).collect();
        let covariance = marginals.joint_of(&keys)?;
        let indices: Vec<usize> = touched.iter().map(|&index| index as usize).collect();
        Ok(Trajectory2::with_joint_covariance(self.poses.clone(), &indices, &covariance)?)
    }

    /// The robot's own graph at its local poses, the first keyframe held.
    ///
    /// # Errors
    /// A factor that cannot be added, which names it.
    pub fn pose_graph(&self, robot: RobotId) -> Result<PoseGraph2, Error> {
        self.graph(robot, &self.poses)
    }

    fn graph(&self, robot: RobotId, poses: &[Isometry2<f64>]) -> Result<PoseGraph2, Error> {
        let mut graph = PoseGraph2::new();
        add(&mut graph, robot, poses.iter().copied(), self.factors())?;
        graph.set_fixed(Key::new(robot, 0), true)?;
        Ok(graph)
    }
}

fn add<'a>(
    graph: &mut PoseGraph2,
    robot: RobotId,
    poses: impl Iterator<Item = Isometry2<f64>>,
    factors: impl Iterator<Item = &'a FactorEntry>,
) -> Result<(), Error> {
    let mut count = 0;
    for pose in poses {
        graph.add_pose(Key::new(robot, count), pose)?;
        count += 1;
    }
    for factor in factors.filter(|f| u64::from(f.from.max(f.to)) < count) {
        let information = factor.covariance.try_inverse().ok_or(Error::Covariance {
            robot,
            from: factor.from,
            to: factor.to,
        })?;
        let (from, to) = (Key::new(robot, factor.from.into()), Key::new(robot, factor.to.into()));
        let kernel = if factor.to == factor.from + 1 { Kernel::None } else { LOOP_KERNEL };
        graph.add_between(from, to, factor.measured, information, kernel)?;
    }
    Ok(())
}

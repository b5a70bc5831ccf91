//! The team's poses from everybody's own graphs and the closures between them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

use draco_lie::LieGroup;
use draco_pgo::distributed::{Link, Neighbour, TwoStepVariant, two_step};
use draco_pgo::{Kernel, Key, PoseGraph2, SolveParams, solve};
use nalgebra::{Isometry2, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::RobotId;
use crate::message::{ClosureEntry, KeyframeId};
use crate::placement::{Implied, medoid};
use crate::robot_graph::RobotGraph;

/// Kernel of closures between robots. A consistency test has passed them, but a test can be wrong.
pub const CLOSURE_KERNEL: Kernel = Kernel::Cauchy(1.0);

/// Poses of several robots in the map frame of one of them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TeamEstimate {
    trajectories: BTreeMap<RobotId, Vec<Isometry2<f64>>>,
}

impl TeamEstimate {
    /// The estimate of a robot that has met nobody.
    pub fn alone(robot: RobotId, poses: &[Isometry2<f64>]) -> Self {
        TeamEstimate { trajectories: BTreeMap::from([(robot, poses.to_vec())]) }
    }

    #[cfg(test)]
    pub(crate) fn from_trajectories(
        trajectories: impl IntoIterator<Item = (RobotId, Vec<Isometry2<f64>>)>,
    ) -> Self {
        TeamEstimate { trajectories: trajectories.into_iter().collect() }
    }

    /// The robots in the common frame, ascending.
    pub fn robots(&self) -> impl Iterator<Item = RobotId> + '_ {
        self.trajectories.keys().copied()
    }

    /// The poses of `robot`, one a keyframe, if it is in the common frame.
    pub fn trajectory(&self, robot: RobotId) -> Option<&[Isometry2<f64>]> {
        self.trajectories.get(&robot).map(Vec::as_slice)
    }

    /// One pose.
    pub fn pose(&self, keyframe: KeyframeId) -> Option<&Isometry2<f64>> {
        self.trajectories.get(&keyframe.robot)?.get(keyframe.index as usize)
    }
}

impl TeamEstimate {
    /// All poses with their keys in a pose graph.
    pub fn keyed_poses(&self) -> impl Iterator<Item = (Key, Isometry2<f64>)> + '_ {
        self.trajectories.iter().flat_map(|(&robot, poses)| {
            poses.iter().enumerate().map(move |(index, pose)| (Key::new(robot, index as u64), *pose))
        })
    }
}

/// How the team's poses are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Optimisation {
    /// First the own poses and those of the neighbours that closures touch, with everything else the neighbours
    /// measured condensed to these; then each neighbour's trajectory by itself.
    #[default]
    TwoStep,
    /// Two steps as in the published system's code: touched poses free of each other in the first, neighbours as
    /// chains of fixed sigmas in the second.
    AsCoded,
    /// All poses of all robots at once.
    Full,
}

impl Optimisation {
    /// All ways with their names on the command line.
    pub const ALL: [(Optimisation, &'static str); 3] = [
        (Optimisation::TwoStep, "two-step"),
        (Optimisation::AsCoded, "as-coded"),
        (Optimisation::Full, "full"),
    ];
}

impl fmt::Display for Optimisation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(Optimisation::ALL.iter().find(|(way, _)| way == self).map_or("", |(_, name)| name))
    }
}

impl FromStr for Optimisation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = Optimisation::ALL.map(|(_, name)| name).join(", ");
        let found = Optimisation::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(way, _)| *way).ok_or_else(|| format!("no such way; there are {names}"))
    }
}

/// Sigmas of a step of a neighbour's chain in the published system's code: metres, metres, radians.
const AS_CODED_STEP_SIGMAS: [f64; 3] = [0.1, 0.1, 0.01];

/// What the estimate is made of.
#[derive(Debug, Clone)]
pub struct TeamProblem<'a> {
    /// The robot in whose map frame the estimate is; its first keyframe is held.
    pub reference: RobotId,
    /// The robots' own graphs. Those that no chain of closures joins to the reference are left out.
    pub graphs: BTreeMap<RobotId, &'a RobotGraph>,
    /// Accepted closures.
    pub closures: &'a [ClosureEntry],
}

impl TeamProblem<'_> {
    /// The robots that closures join to the reference, each with the place of its map to start from.
    ///
    /// A robot joins where the middle one of its closures to those placed already puts it, the robot with most closures
    /// first. Nothing is started from an earlier estimate: two robots that believe the same closures start alike, and what
    /// was once believed and no longer is leaves no trace.
    pub fn placements(&self) -> BTreeMap<RobotId, Isometry2<f64>> {
        let mut placed = BTreeMap::from([(self.reference, Isometry2::identity())]);
        while let Some((robot, place)) = self.next_placement(&placed) {
            placed.insert(robot, place);
        }
        placed
    }

    fn next_placement(
        &self,
        placed: &BTreeMap<RobotId, Isometry2<f64>>,
    ) -> Option<(RobotId, Isometry2<f64>)> {
        let mut candidates: BTreeMap<RobotId, Vec<Implied>> = BTreeMap::new();
        for closure in self.closures {
            let (Some(target), Some(source)) = (self.local(closure.target), self.local(closure.source))
            else {
                continue;
            };
            let implied = Implied::by(&target, &closure.measured, &source);
            let ends = (placed.get(&closure.target.robot), placed.get(&closure.source.robot));
            let (robot, frame, implied) = match ends {
                (Some(frame), None) => (closure.source.robot, frame, implied),
                (None, Some(frame)) => (closure.target.robot, frame, implied.reversed()),
                _ => continue,
            };
            candidates
                .entry(robot)
                .or_default()
                .push(Implied { place: frame * implied.place, middle: implied.middle });
        }
        let (robot, implied) =
            candidates.into_iter().max_by_key(|(robot, implied)| (implied.len(), Reverse(*robot)))?;
        Some((robot, medoid(&implied)?.place))
    }

    fn local(&self, keyframe: KeyframeId) -> Option<Isometry2<f64>> {
        self.graphs.get(&keyframe.robot)?.poses().get(keyframe.index as usize).copied()
    }

    /// The graph of the whole team: every robot's own factors once, and the closures under [`CLOSURE_KERNEL`].
    ///
    /// # Errors
    /// A factor or closure that cannot be added, which names it.
    pub fn graph(&self) -> Result<PoseGraph2, Error> {
        let mut graph = PoseGraph2::new();
        let placements = self.placements();
        for (&robot, place) in &placements {
            if let Some(own) = self.graphs.get(&robot) {
                own.add_to(&mut graph, robot, place)?;
            }
        }
        for closure in self.closures {
            let known = |k: KeyframeId| placements.contains_key(&k.robot) && self.local(k).is_some();
            if !(known(closure.source) && known(closure.target)) {
                continue;
            }
            let (source, target) = (closure.source, closure.target);
            let information = closure.covariance.try_inverse().ok_or(Error::Covariance {
                robot: source.robot,
                from: target.index,
                to: source.index,
            })?;
            graph.add_between(key(target), key(source), closure.measured, information, CLOSURE_KERNEL)?;
        }
        graph.set_fixed(Key::new(self.reference, 0), true)?;
        Ok(graph)
    }

    /// The team's poses.
    ///
    /// # Errors
    /// Those of [`TeamProblem::graph`] and of the solver.
    pub fn solve(&self, optimisation: Optimisation) -> Result<TeamEstimate, Error> {
        match optimisation {
            Optimisation::Full => self.solve_full(),
            Optimisation::TwoStep => self.solve_two_step(&TwoStepVariant::Condensed),
            Optimisation::AsCoded => {
                let sigmas = Vector3::from(AS_CODED_STEP_SIGMAS);
                let chain_information = Matrix3::from_diagonal(&sigmas.map(|s| 1.0 / (s * s)));
                self.solve_two_step(&TwoStepVariant::AsCoded { chain_information })
            }
        }
    }

    /// The star around the reference, then each neighbour.
    fn solve_two_step(&self, variant: &TwoStepVariant<3>) -> Result<TeamEstimate, Error> {
        let known =
            self.closures.iter().filter(|c| self.local(c.source).is_some() && self.local(c.target).is_some());
        let links = known.map(|c| self.link(c)).collect::<Result<Vec<_>, _>>()?;
        let starts = self.placements();
        let mut neighbours = Vec::new();
        for (&robot, graph) in self.graphs.iter().filter(|(robot, _)| **robot != self.reference) {
            let touched: BTreeSet<Key> =
                links.iter().flat_map(|l| [l.own, l.neighbour]).filter(|k| k.robot == robot).collect();
            if !touched.is_empty() {
                let touched: Vec<Key> = touched.into_iter().collect();
                let start = starts.get(&robot).copied();
                neighbours.push(Neighbour { start, ..Neighbour::new(&graph.pose_graph(robot)?, &touched)? });
            }
        }
        let own = self.graphs.get(&self.reference).ok_or(Error::NoRobots)?.pose_graph(self.reference)?;
        let solution = two_step(&own, &links, &neighbours, variant, &SolveParams::default())?;
        let mut trajectories: BTreeMap<RobotId, Vec<Isometry2<f64>>> = BTreeMap::new();
        for (key, pose) in solution.own.iter().chain(&solution.neighbours) {
            trajectories.entry(key.robot).or_default().push(*pose);
        }
        Ok(TeamEstimate { trajectories })
    }

    /// A closure as a link; it starts at the reference if it touches it.
    fn link(&self, closure: &ClosureEntry) -> Result<Link<Isometry2<f64>, 3>, Error> {
        let (source, target) = (closure.source, closure.target);
        let error = || Error::Covariance { robot: source.robot, from: target.index, to: source.index };
        let (own, neighbour, measured, covariance) = if source.robot != self.reference {
            (target, source, closure.measured, closure.covariance)
        } else {
            let adjoint = closure.measured.adjoint();
            (source, target, closure.measured.inverse(), adjoint * closure.covariance * adjoint.transpose())
        };
        Ok(Link {
            own: key(own),
            neighbour: key(neighbour),
            measured,
            information: covariance.try_inverse().ok_or_else(error)?,
            kernel: CLOSURE_KERNEL,
        })
    }

    /// All poses of all joined robots in one optimisation.
    ///
    /// # Errors
    /// Those of [`TeamProblem::graph`] and of the solver.
    pub fn solve_full(&self) -> Result<TeamEstimate, Error> {
        let graph = self.graph()?;
        let solution = solve(&graph, &SolveParams::default())?;
        let mut trajectories: BTreeMap<RobotId, Vec<Isometry2<f64>>> = BTreeMap::new();
        for (key, pose) in solution.poses() {
            trajectories.entry(key.robot).or_default().push(*pose);
        }
        Ok(TeamEstimate { trajectories })
    }
}

fn key(keyframe: KeyframeId) -> Key {
    Key::new(keyframe.robot, keyframe.index.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::FactorEntry;

    #[test]
    fn maps_start_where_most_closures_put_them() {
        let step = |from| FactorEntry {
            from,
            to: from + 1,
            measured: Isometry2::translation(3.0, 0.0),
            covariance: Matrix3::identity() * 0.01,
        };
        let poses =
            |count: u32| (0..count).map(|k| Isometry2::translation(3.0 * f64::from(k), 0.0)).collect();
        let graph = RobotGraph::from_map((0..4).map(step).collect(), poses(5));
        let id = |robot, index| KeyframeId { robot, index };
        let closure = |target, source, x: f64| ClosureEntry {
            source,
            target,
            measured: Isometry2::translation(x, 0.0),
            covariance: Matrix3::identity() * 0.01,
        };
        // map 2 lies at 10 m, which the first closure denies; map 3 is seen by map 2 alone, 5 m behind it
        let closures = [
            closure(id(1, 0), id(2, 0), 16.0),
            closure(id(1, 1), id(2, 1), 10.0),
            closure(id(2, 2), id(1, 2), -10.1),
            closure(id(3, 4), id(2, 4), 5.0),
        ];
        let graphs = (1..=4).map(|robot| (robot, &graph)).collect();
        let problem = TeamProblem { reference: 1, graphs, closures: &closures };
        let placed = problem.placements();
        let x = |robot: RobotId| placed.get(&robot).map(|place| place.translation.x.round());
        assert_eq!([1, 2, 3, 4].map(x), [Some(0.0), Some(10.0), Some(5.0), None]);
        for optimisation in [Optimisation::TwoStep, Optimisation::Full] {
            let team = problem.solve(optimisation).expect("a sound graph");
            let pose = team.pose(id(2, 0)).expect("robot 2 is joined");
            assert!((pose.translation.x - 10.0).abs() < 0.1, "{optimisation}: {pose}");
        }
    }
}

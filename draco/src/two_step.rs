//! The team's poses from everybody's own graphs and the closures between them.

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
    /// Where to start: the last estimate of where each map lies in the reference's. A robot without an entry starts
    /// where its first closure puts it.
    pub reference_from_map: BTreeMap<RobotId, Isometry2<f64>>,
    /// Accepted closures.
    pub closures: &'a [ClosureEntry],
}

impl TeamProblem<'_> {
    /// The robots that closures join to the reference, each with the place of its map to start from.
    pub fn placements(&self) -> BTreeMap<RobotId, Isometry2<f64>> {
        let mut placed = BTreeMap::from([(self.reference, Isometry2::identity())]);
        loop {
            let before = placed.len();
            for closure in self.closures {
                for (known, new, new_from_known) in [
                    (closure.target, closure.source, closure.measured.inverse()),
                    (closure.source, closure.target, closure.measured),
                ] {
                    if placed.contains_key(&new.robot) {
                        continue;
                    }
                    let (Some(frame), Some(a), Some(b)) =
                        (placed.get(&known.robot).copied(), self.local(known), self.local(new))
                    else {
                        continue;
                    };
                    let implied = frame * a * new_from_known.inverse() * b.inverse();
                    let place = self.reference_from_map.get(&new.robot).copied().unwrap_or(implied);
                    placed.insert(new.robot, place);
                }
            }
            if placed.len() == before {
                return placed;
            }
        }
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
        let mut neighbours = Vec::new();
        for (&robot, graph) in self.graphs.iter().filter(|(robot, _)| **robot != self.reference) {
            let touched: BTreeSet<Key> =
                links.iter().flat_map(|l| [l.own, l.neighbour]).filter(|k| k.robot == robot).collect();
            if !touched.is_empty() {
                let touched: Vec<Key> = touched.into_iter().collect();
                let start = self.reference_from_map.get(&robot).copied();
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

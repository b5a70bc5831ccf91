//! The team's poses from everybody's own graphs and the closures between them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

use draco_lie::LieGroup;
use draco_pgo::distributed::{Link, Neighbour, TwoStepVariant, two_step};
use draco_pgo::{Kernel, Key, PoseGraph2, SolveParams, Start, solve};
use nalgebra::{Isometry2, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::RobotId;
use crate::message::{ClosureEntry, KeyframeId};
use crate::placement::{Implied, medoid};
use crate::robot_graph::RobotGraph;

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
    /// First the star of the robot and its neighbours, without the closures that others have among each other; from
    /// there everything, as far as the estimate is good for.
    #[default]
    TwoStep,
    /// Two steps as in the published system's code: touched poses free of each other in the first, neighbours as
    /// chains of fixed sigmas in the second.
    AsCoded,
    /// All poses of all robots at once, to the last digit.
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

/// Relative gain of cost at which each of the two steps ends. The first one only has to put the maps where the second
/// one starts well. After the second one, poses lie within centimetres of the optimum, an order less than closures tell
/// them to; the kernels' weights take twice as many iterations to settle to the last digit.
const STEP_TOLERANCES: [f64; 2] = [1e-2, 1e-4];

/// Sigmas of a step of a neighbour's chain in the published system's code: metres, metres, radians.
const AS_CODED_STEP_SIGMAS: [f64; 3] = [0.1, 0.1, 0.01];

/// What the estimate is made of.
#[derive(Debug, Clone)]
pub struct TeamProblem<'a> {
    /// The robot in whose map frame the estimate is; its first keyframe is held.
    pub reference: RobotId,
    /// The robots' own graphs. Those that no chain of closures joins to the reference are left out.
    pub graphs: BTreeMap<RobotId, &'a RobotGraph>,
    /// Closures to believe. They alone say which robots are in one frame and where their maps start from.
    pub closures: &'a [ClosureEntry],
    /// Kernel on those.
    pub kernel: Kernel,
    /// Closures that the others speak against, but not so much that they are wrong for certain. They pull, and join nobody.
    /// Left out of [`Optimisation::AsCoded`].
    pub doubtful: &'a [ClosureEntry],
    /// Kernel on those.
    pub doubtful_kernel: Kernel,
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

    /// Whether both ends of a closure are in the robots' graphs.
    fn knows(&self, closure: &ClosureEntry) -> bool {
        self.local(closure.source).is_some() && self.local(closure.target).is_some()
    }

    fn local(&self, keyframe: KeyframeId) -> Option<Isometry2<f64>> {
        self.graphs.get(&keyframe.robot)?.poses().get(keyframe.index as usize).copied()
    }

    /// The graph of the whole team: every robot's own factors once, and the closures, each under its kernel.
    ///
    /// # Errors
    /// A factor or closure that cannot be added, which names it.
    pub fn graph(&self) -> Result<PoseGraph2, Error> {
        self.graph_of(&self.placements(), |_| true)
    }

    /// The graph of the team with those of its closures that are `wanted`.
    fn graph_of(
        &self,
        placements: &BTreeMap<RobotId, Isometry2<f64>>,
        wanted: impl Fn(&ClosureEntry) -> bool,
    ) -> Result<PoseGraph2, Error> {
        let mut graph = PoseGraph2::new();
        for (&robot, place) in placements {
            if let Some(own) = self.graphs.get(&robot) {
                own.add_to(&mut graph, robot, place)?;
            }
        }
        let believed = self.closures.iter().map(|closure| (closure, self.kernel));
        let doubtful = self.doubtful.iter().map(|closure| (closure, self.doubtful_kernel));
        for (closure, kernel) in believed.chain(doubtful).filter(|(closure, _)| wanted(closure)) {
            let (a, b) = closure.robots();
            if !(self.knows(closure) && placements.contains_key(&a) && placements.contains_key(&b)) {
                continue;
            }
            let (source, target) = (closure.source, closure.target);
            let information = closure.covariance.try_inverse().ok_or(Error::Covariance {
                robot: source.robot,
                from: target.index,
                to: source.index,
            })?;
            graph.add_between(key(target), key(source), closure.measured, information, kernel)?;
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
            Optimisation::TwoStep => self.solve_two_step(),
            Optimisation::AsCoded => self.solve_as_coded(),
        }
    }

    /// The star around the reference, then everything from there.
    fn solve_two_step(&self) -> Result<TeamEstimate, Error> {
        let [first, second] = STEP_TOLERANCES.map(|relative_tolerance| SolveParams {
            relative_tolerance,
            start: Start::Given,
            ..SolveParams::default()
        });
        let placements = self.placements();
        let spokes = self.spokes();
        let mut graph = self.graph_of(&placements, |_| true)?;
        if self.closures.iter().any(|closure| !spokes.contains(&closure.robots())) {
            let star = self.graph_of(&placements, |closure| spokes.contains(&closure.robots()))?;
            graph.update(&solve(&star, &first)?);
        }
        Ok(estimate(solve(&graph, &second)?.poses()))
    }

    /// The pairs of robots whose closures make the star: those of the reference, and for each robot that it has not met
    /// the pair with most closures to one that is nearer to the reference.
    fn spokes(&self) -> BTreeSet<(RobotId, RobotId)> {
        let mut counts: BTreeMap<(RobotId, RobotId), usize> = BTreeMap::new();
        for closure in self.closures.iter().filter(|closure| self.knows(closure)) {
            *counts.entry(closure.robots()).or_default() += 1;
        }
        let (mut spokes, others): (BTreeSet<_>, BTreeSet<_>) =
            counts.keys().partition(|(a, b)| [a, b].contains(&&self.reference));
        let mut reached: BTreeSet<RobotId> = spokes.iter().flat_map(|&(a, b)| [a, b]).collect();
        reached.insert(self.reference);
        let widens = |reached: &BTreeSet<RobotId>, (a, b): &(RobotId, RobotId)| {
            reached.contains(a) != reached.contains(b)
        };
        while let Some(&next) = others
            .iter()
            .filter(|pair| widens(&reached, pair))
            .max_by_key(|pair| (counts[pair], Reverse(**pair)))
        {
            reached.extend([next.0, next.1]);
            spokes.insert(next);
        }
        spokes
    }

    /// As the published system's code does it.
    fn solve_as_coded(&self) -> Result<TeamEstimate, Error> {
        let sigmas = Vector3::from(AS_CODED_STEP_SIGMAS);
        let chain_information = Matrix3::from_diagonal(&sigmas.map(|s| 1.0 / (s * s)));
        let variant = TwoStepVariant::AsCoded { chain_information };
        let links = self
            .closures
            .iter()
            .filter(|c| self.knows(c))
            .map(|c| self.link(c))
            .collect::<Result<Vec<_>, _>>()?;
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
        let solution = two_step(&own, &links, &neighbours, &variant, &SolveParams::default())?;
        Ok(estimate(solution.own.iter().chain(&solution.neighbours).map(|(key, pose)| (*key, pose))))
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
            kernel: self.kernel,
        })
    }

    /// All poses of all joined robots in one optimisation.
    ///
    /// # Errors
    /// Those of [`TeamProblem::graph`] and of the solver.
    pub fn solve_full(&self) -> Result<TeamEstimate, Error> {
        Ok(estimate(solve(&self.graph()?, &SolveParams::default())?.poses()))
    }
}

/// The estimate of these poses, which ascend by key within each robot.
fn estimate<'a>(poses: impl Iterator<Item = (Key, &'a Isometry2<f64>)>) -> TeamEstimate {
    let mut trajectories: BTreeMap<RobotId, Vec<Isometry2<f64>>> = BTreeMap::new();
    for (key, pose) in poses {
        trajectories.entry(key.robot).or_default().push(*pose);
    }
    TeamEstimate { trajectories }
}

fn key(keyframe: KeyframeId) -> Key {
    Key::new(keyframe.robot, keyframe.index.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::FactorEntry;

    /// A robot with five keyframes in a row.
    fn row() -> RobotGraph {
        let step = |from| FactorEntry {
            from,
            to: from + 1,
            measured: Isometry2::translation(3.0, 0.0),
            covariance: Matrix3::identity() * 0.01,
        };
        let poses = (0..5).map(|k| Isometry2::translation(3.0 * f64::from(k), 0.0)).collect();
        RobotGraph::from_map((0..4).map(step).collect(), poses)
    }

    fn problem<'a>(
        graphs: BTreeMap<RobotId, &'a RobotGraph>,
        closures: &'a [ClosureEntry],
    ) -> TeamProblem<'a> {
        let kernel = Kernel::Cauchy(1.0);
        TeamProblem { reference: 1, graphs, closures, kernel, doubtful: &[], doubtful_kernel: kernel }
    }

    fn closure(target: (RobotId, u32), source: (RobotId, u32), x: f64) -> ClosureEntry {
        let id = |(robot, index)| KeyframeId { robot, index };
        ClosureEntry {
            source: id(source),
            target: id(target),
            measured: Isometry2::translation(x, 0.0),
            covariance: Matrix3::identity() * 0.01,
        }
    }

    #[test]
    fn the_star_reaches_every_robot_by_the_pair_with_most_closures() {
        let graph = row();
        let mut closures = Vec::new();
        for ((a, b), count) in
            [((1, 3), 1), ((2, 1), 2), ((3, 2), 5), ((4, 2), 2), ((3, 4), 3), ((4, 5), 1), ((7, 6), 4)]
        {
            closures.extend((0..count).map(|k| closure((a, k), (b, k), 0.0)));
        }
        // a keyframe that nobody has told of
        closures.extend((0..4).map(|k| closure((5, 9), (3, k), 0.0)));
        let graphs = (1..=7).map(|robot| (robot, &graph)).collect();
        let problem = problem(graphs, &closures);
        let reached = [(1, 2), (1, 3), (3, 4), (4, 5)];
        assert_eq!(problem.spokes(), BTreeSet::from(reached));
    }

    #[test]
    fn two_steps_lead_to_the_optimum_of_all_closures() {
        let graph = row();
        // what 2 and 3 see of each other denies, by half a metre, what 1 sees of both
        let closures: Vec<_> = (0..4)
            .flat_map(|k| {
                [closure((1, k), (2, k), 10.0), closure((3, k), (1, k), 5.0), closure((2, k), (3, k), -14.5)]
            })
            .collect();
        let graphs = (1..=3).map(|robot| (robot, &graph)).collect();
        let problem = problem(graphs, &closures);
        let [two, full] = [Optimisation::TwoStep, Optimisation::Full]
            .map(|way| problem.solve(way).expect("a sound graph").keyed_poses().collect::<Vec<_>>());
        assert_eq!(two.len(), 15);
        for ((key, pose), (_, best)) in two.iter().zip(&full) {
            assert!(
                (pose.translation.vector - best.translation.vector).norm() < 0.02,
                "{key:?}: {pose} {best}"
            );
        }
        let spread = (full[10].1.translation.x - full[5].1.translation.x + 14.5).abs();
        assert!(spread > 0.1, "the closures between 2 and 3 must matter: {spread}");
    }

    #[test]
    fn maps_start_where_most_closures_put_them() {
        let graph = row();
        let id = |robot, index| KeyframeId { robot, index };
        // map 2 lies at 10 m, which the first closure denies; map 3 is seen by map 2 alone, 5 m behind it
        let closures = [
            closure((1, 0), (2, 0), 16.0),
            closure((1, 1), (2, 1), 10.0),
            closure((2, 2), (1, 2), -10.1),
            closure((3, 4), (2, 4), 5.0),
        ];
        let graphs = (1..=4).map(|robot| (robot, &graph)).collect();
        let problem = problem(graphs, &closures);
        let placed = problem.placements();
        let x = |robot: RobotId| placed.get(&robot).map(|place| place.translation.x.round());
        assert_eq!([1, 2, 3, 4].map(x), [Some(0.0), Some(10.0), Some(5.0), None]);
        for optimisation in [Optimisation::TwoStep, Optimisation::Full] {
            let team = problem.solve(optimisation).expect("a sound graph");
            let pose = team.pose(id(2, 0)).expect("robot 2 is joined");
            assert!((pose.translation.x - 10.0).abs() < 0.1, "{optimisation}: {pose}");
        }
    }

    #[test]
    fn doubtful_closures_pull_but_join_nobody() {
        let graph = row();
        let closures: Vec<_> = (0..4).map(|k| closure((1, k), (2, k), 10.0)).collect();
        let doubtful: Vec<_> =
            (0..4).flat_map(|k| [closure((1, k), (2, k), 10.3), closure((1, k), (3, k), 5.0)]).collect();
        let graphs = || (1..=3).map(|robot| (robot, &graph)).collect();
        let x_of_2 = |doubtful: &[ClosureEntry]| {
            let team = TeamProblem { doubtful, ..problem(graphs(), &closures) }
                .solve(Optimisation::Full)
                .expect("a sound graph");
            assert_eq!(team.robots().collect::<Vec<_>>(), [1, 2]);
            team.pose(KeyframeId { robot: 2, index: 0 }).expect("robot 2 is joined").translation.x
        };
        let (without, with) = (x_of_2(&[]), x_of_2(&doubtful));
        assert!((without - 10.0).abs() < 1e-6, "{without}");
        assert!(10.01 < with && with < 10.15, "{with}");
    }
}

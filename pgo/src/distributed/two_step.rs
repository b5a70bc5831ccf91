use std::collections::BTreeMap;
use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::SMatrix;

use super::{Condensed, CondensedFactor};
use crate::{Error, Gauge, Kernel, Key, Marginals, Measurement, PoseGraph, Solution, SolveParams, solve};

/// A closure between a pose of one's own and a neighbour's.
#[derive(Debug, Clone, PartialEq)]
pub struct Link<G, const N: usize> {
    /// Own pose.
    pub own: Key,
    /// Neighbour's pose.
    pub neighbour: Key,
    /// `own_from_neighbour`.
    pub measured: G,
    /// Information in the frame of the neighbour's pose, order translation then rotation.
    pub information: SMatrix<f64, N, N>,
    /// Robust kernel; the published system uses `Cauchy(1)`.
    pub kernel: Kernel,
}

/// What a neighbour tells: its trajectory by its **own** measurements alone, so that nothing it learned from the
/// receiver comes back.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbour<G, const N: usize> {
    /// The poses closures touch, with everything else integrated out.
    pub touched: Condensed<G>,
    /// The trajectory in the frame of the sender's map, ascending by key.
    pub trajectory: Vec<(Key, G)>,
    /// Information of each step of the trajectory: entry `i` is of `x_i⁻¹ x_{i+1}`, in the frame of the latter,
    /// order translation then rotation.
    pub steps: Vec<SMatrix<f64, N, N>>,
    /// Where the sender's map lies in the receiver's, to start from; `None` starts where the first link puts it.
    /// Not part of the message.
    pub start: Option<G>,
}

impl<const N: usize, G: LieGroup<N>> Neighbour<G, N> {
    /// The message of a robot whose own, optimised graph is `graph`, about its poses `touched`.
    ///
    /// # Errors
    /// Those of [`Condensed::new`].
    pub fn new(graph: &PoseGraph<G, N>, touched: &[Key]) -> Result<Self, Error> {
        let marginals = Marginals::new(graph, Gauge::HoldFirst)?;
        let trajectory: Vec<(Key, G)> = graph.poses().map(|(key, pose)| (key, *pose)).collect();
        let steps = trajectory
            .windows(2)
            .map(|pair| {
                let covariance = marginals.relative(pair[0].0, pair[1].0)?;
                covariance.try_inverse().ok_or(Error::Indefinite { key: pair[1].0 })
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self { touched: Condensed::new(graph, touched)?, trajectory, steps, start: None })
    }

    /// Size on the wire in bytes: 8 a key and 8 a number, information matrices as upper triangles.
    pub fn bytes(&self) -> usize {
        let steps = self.steps.len() * N * (N + 1) / 2 * 8;
        self.touched.bytes::<N>() + self.trajectory.len() * 8 * (1 + N) + steps
    }
}

/// Which of the two-step schemes.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum TwoStepVariant<const N: usize> {
    /// Step 1 joins the own factors, the closures and what each neighbour knows about its touched poses
    /// (condensed); step 2 moves the rest of each neighbour's trajectory with the touched poses held.
    #[default]
    Condensed,
    /// As the released system does it: step 1 leaves the touched poses free of each other; step 2 solves
    /// everything again with the neighbours' trajectories as chains of one fixed information matrix. It trusts
    /// a chain whatever its keyframes' spacing, and counts own measurements twice when a neighbour's trajectory
    /// holds them already.
    AsCoded {
        /// Information of each step of a neighbour's chain; the released system has sigmas 0.1 m, 0.1 m,
        /// 0.01 rad.
        chain_information: SMatrix<f64, N, N>,
    },
}

/// What [`two_step`] found, everything in the frame of the own map.
#[derive(Debug, Clone)]
pub struct TwoStepSolution<G> {
    /// Own poses, ascending by key.
    pub own: BTreeMap<Key, G>,
    /// Poses of the neighbours that closures reach.
    pub neighbours: BTreeMap<Key, G>,
    /// The star-shaped joint step.
    pub star: Solution<G>,
}

/// Where the map of each neighbour that links reach lies in the own one, to start from.
fn starts<const N: usize, G: LieGroup<N>>(
    own: &PoseGraph<G, N>,
    links: &[&Link<G, N>],
    known: &BTreeMap<Key, G>,
    neighbours: &[Neighbour<G, N>],
) -> BTreeMap<u32, G> {
    let given: BTreeMap<u32, G> =
        neighbours.iter().filter_map(|n| Some((n.trajectory.first()?.0.robot, n.start?))).collect();
    let mut starts: BTreeMap<u32, G> = BTreeMap::new();
    loop {
        let before = starts.len();
        for link in links {
            let place = |key: Key| match known.get(&key) {
                Some(pose) => starts.get(&key.robot).map(|start| start.compose(pose)),
                None => own.pose(key).copied(),
            };
            let (from, to) = (place(link.own), place(link.neighbour));
            let (key, implied) = match (from, to) {
                (Some(from), None) => (link.neighbour, from.compose(&link.measured)),
                (None, Some(to)) => (link.own, to.compose(&link.measured.inverse())),
                _ => continue,
            };
            if let Some(pose) = known.get(&key) {
                let start = given.get(&key.robot).copied().unwrap_or(implied.compose(&pose.inverse()));
                starts.insert(key.robot, start);
            }
        }
        if starts.len() == before {
            return starts;
        }
    }
}

/// The two-step scheme for one robot: a star-shaped joint step over the own poses and the neighbours' poses that
/// closures touch, then each neighbour's trajectory by itself.
///
/// * `own` – the own graph, own measurements only.
/// * `links` – accepted closures to the neighbours; those to poses in no message are left out. A closure between two
///   neighbours is a link too, with the pose of either as `own`; it counts once a chain of links joins the two to
///   the own poses.
/// * `neighbours` – one message a neighbour.
///
/// # Errors
/// [`Error::UnknownKey`] when a link names a pose that `own` does not hold; those of [`solve`].
pub fn two_step<const N: usize, G: LieGroup<N>>(
    own: &PoseGraph<G, N>,
    links: &[Link<G, N>],
    neighbours: &[Neighbour<G, N>],
    variant: &TwoStepVariant<N>,
    params: &SolveParams,
) -> Result<TwoStepSolution<G>, Error> {
    let mut graph = own.clone();
    for key in own.gauge_keys(params.gauge)? {
        graph.set_fixed(key, true)?;
    }
    let known: BTreeMap<Key, G> = neighbours.iter().flat_map(|n| n.trajectory.iter().copied()).collect();
    let known_or_own = |key: &Key| known.contains_key(key) || own.pose(*key).is_some();
    let links: Vec<&Link<G, N>> = links.iter().filter(|link| known.contains_key(&link.neighbour)).collect();
    if let Some(link) = links.iter().find(|link| !known_or_own(&link.own)) {
        return Err(Error::UnknownKey { key: link.own });
    }
    let starts = starts(own, &links, &known, neighbours);
    for link in links {
        for key in [link.own, link.neighbour] {
            if let (None, Some(start), Some(pose)) =
                (graph.pose(key), starts.get(&key.robot), known.get(&key))
            {
                graph.add_pose(key, start.compose(pose))?;
            }
        }
        if graph.pose(link.own).is_some() && graph.pose(link.neighbour).is_some() {
            graph.add_between(link.own, link.neighbour, link.measured, link.information, link.kernel)?;
        }
    }
    if *variant == TwoStepVariant::Condensed {
        for neighbour in neighbours {
            add_condensed(&mut graph, &neighbour.touched)?;
        }
    }
    let star = solve(&graph, params)?;
    graph.update(&star);
    let mut moved = BTreeMap::new();
    match variant {
        TwoStepVariant::Condensed => {
            for neighbour in neighbours {
                moved.extend(conditional(&graph, neighbour, params)?);
            }
        }
        TwoStepVariant::AsCoded { chain_information } => {
            for neighbour in neighbours {
                add_chain(&mut graph, neighbour, chain_information)?;
            }
            let joint = solve(&graph, params)?;
            graph.update(&joint);
        }
    }
    moved.extend(graph.poses().filter(|(key, _)| own.pose(*key).is_none()).map(|(key, pose)| (key, *pose)));
    let own = own.poses().filter_map(|(key, _)| graph.pose(key).map(|pose| (key, *pose))).collect();
    Ok(TwoStepSolution { own, neighbours: moved, star })
}

/// Adds a condensed neighbour as far as closures touch it.
fn add_condensed<const N: usize, G: LieGroup<N>>(
    graph: &mut PoseGraph<G, N>,
    condensed: &Condensed<G>,
) -> Result<(), Error> {
    let Some(frame) = frame_of(graph, &condensed.poses) else { return Ok(()) };
    if condensed.poses.len() < 2 {
        return Ok(());
    }
    for (key, pose) in &condensed.poses {
        if graph.pose(*key).is_none() {
            graph.add_pose(*key, frame.compose(pose))?;
        }
    }
    graph.add_custom(Arc::new(CondensedFactor::new(condensed)?), Kernel::None)?;
    Ok(())
}

/// The place of a neighbour's map by the first of its poses that the graph holds.
fn frame_of<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, poses: &[(Key, G)]) -> Option<G> {
    poses.iter().find_map(|(key, pose)| graph.pose(*key).map(|at| at.compose(&pose.inverse())))
}

/// A neighbour's trajectory given the poses the graph holds of it.
fn conditional<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    neighbour: &Neighbour<G, N>,
    params: &SolveParams,
) -> Result<BTreeMap<Key, G>, Error> {
    let Some(frame) = frame_of(graph, &neighbour.trajectory) else { return Ok(BTreeMap::new()) };
    let mut chain = PoseGraph::new();
    for (key, pose) in &neighbour.trajectory {
        match graph.pose(*key) {
            Some(held) => {
                chain.add_pose(*key, *held)?;
                chain.set_fixed(*key, true)?;
            }
            None => chain.add_pose(*key, frame.compose(pose))?,
        }
    }
    for (pair, information) in neighbour.trajectory.windows(2).zip(&neighbour.steps) {
        let measured = pair[0].1.between(&pair[1].1);
        chain.add_between(pair[0].0, pair[1].0, measured, symmetric(information), Kernel::None)?;
    }
    let solution = solve(&chain, params)?;
    Ok(solution.poses().map(|(key, pose)| (key, *pose)).collect())
}

fn add_chain<const N: usize, G: LieGroup<N>>(
    graph: &mut PoseGraph<G, N>,
    neighbour: &Neighbour<G, N>,
    information: &SMatrix<f64, N, N>,
) -> Result<(), Error> {
    let Some(frame) = frame_of(graph, &neighbour.trajectory) else { return Ok(()) };
    for (key, pose) in &neighbour.trajectory {
        if graph.pose(*key).is_none() {
            graph.add_pose(*key, frame.compose(pose))?;
        }
    }
    for pair in neighbour.trajectory.windows(2) {
        let measured = pair[0].1.between(&pair[1].1);
        graph.add_between(pair[0].0, pair[1].0, measured, *information, Kernel::None)?;
    }
    Ok(())
}

fn symmetric<const N: usize>(m: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

impl<const N: usize, G: LieGroup<N>> Link<G, N> {
    /// The links of `robot` to others among the factors of a joint graph.
    pub fn of_graph(graph: &PoseGraph<G, N>, robot: u32) -> Vec<Self> {
        let link = |factor: &crate::Factor<G, N>| {
            let Measurement::Between { from, to, measured } = &factor.measurement else { return None };
            let (information, kernel) = (factor.information, factor.kernel);
            if from.robot == robot && to.robot != robot {
                Some(Self { own: *from, neighbour: *to, measured: *measured, information, kernel })
            } else if to.robot == robot && from.robot != robot {
                // log((z⁻¹)⁻¹ b⁻¹ a) = -Ad(z) log(z⁻¹ a⁻¹ b) to first order
                let adjoint = measured.inverse().adjoint();
                let information = symmetric(&(adjoint.transpose() * information * adjoint));
                let measured = measured.inverse();
                Some(Self { own: *to, neighbour: *from, measured, information, kernel })
            } else {
                None
            }
        };
        graph.factors().filter_map(|(_, factor)| link(factor)).collect()
    }
}

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{DMatrix, DVector, SVector};

use crate::problem::{HELD, Problem};
use crate::{CustomFactor, Error, Gauge, Kernel, Key, Measurement, PoseGraph, SolveParams, Start, solve};

/// What one robot's measurements say about the poses it shares with others: the quadratic model of its cost with all
/// its other poses at their best.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelMessage<G> {
    /// Sender.
    pub robot: u32,
    /// Grows with every message of a sender, so that a receiver can drop what arrives late.
    pub sequence: u64,
    /// Where the model was made: the sender's poses that factors join to other robots, and the others' poses that
    /// the sender's factors name, in the common frame.
    pub poses: Vec<(Key, G)>,
    /// Hessian of the model by the right perturbations of the poses, order translation then rotation within each.
    pub information: DMatrix<f64>,
    /// Gradient of the model.
    pub gradient: DVector<f64>,
}

impl<G> ModelMessage<G> {
    /// Size on the wire in bytes: 4 for the robot, 8 for the sequence, 8 a key and 8 a number; of the Hessian the
    /// upper triangle.
    pub fn bytes<const N: usize>(&self) -> usize
    where
        G: LieGroup<N>,
    {
        let side = self.gradient.len();
        12 + 8 * (self.poses.len() * (1 + N) + side * (side + 1) / 2 + side)
    }
}

/// One robot of a team that minimises the common cost by exchanging condensed models: it solves for its own poses
/// and the shared poses of all together, with every other robot's measurements as the model it last heard, and tells
/// the others the model of its own.
///
/// A model is exact to second order where it was made, so once nothing moves any more the gradient of the common
/// cost is zero: the fixed points are those of the centralised problem, and near them each round is a step of
/// Gauss-Newton. That takes few rounds where [`super::Agent`] takes thousands, for messages that grow with the
/// square of the number of shared poses. Messages may be lost, repeated and reordered; agents may step in any order.
/// Every agent needs a common frame for the first guesses.
///
/// A factor between robots counts as the lower robot's.
///
/// **Source**: Cunningham, Paluri, Dellaert, *DDF-SAM: Fully distributed SAM using constrained factor graphs*, 2010,
/// for exchanging condensed maps. We differ in sending gradients and making models anew each round, so that nothing
/// is counted twice and the joint optimum is reached.
#[derive(Debug)]
pub struct CondensingAgent<G, const N: usize> {
    robot: u32,
    /// Own poses, the factors that count as one's own, and the others' poses those name.
    local: PoseGraph<G, N>,
    /// Poses of `local` that models are about.
    shared: Vec<Key>,
    /// The last model heard from each robot.
    models: BTreeMap<u32, ModelMessage<G>>,
    params: SolveParams,
    sequence: u64,
}

impl<const N: usize, G: LieGroup<N>> CondensingAgent<G, N> {
    /// The agent of `robot` with the part of the common graph it knows: its own poses, the factors on them and first
    /// guesses of the others' poses those name. Factors on no own pose are passed over.
    ///
    /// # Errors
    /// [`Error::EmptyGraph`] when the robot has no pose.
    pub fn new(graph: &PoseGraph<G, N>, robot: u32) -> Result<Self, Error> {
        let mut local = PoseGraph::new();
        for (key, pose) in graph.poses().filter(|(key, _)| key.robot == robot) {
            local.add_pose(key, *pose)?;
            local.set_fixed(key, graph.is_fixed(key))?;
        }
        if local.pose_count() == 0 {
            return Err(Error::EmptyGraph);
        }
        let mut shared = BTreeSet::new();
        for (_, factor) in graph.factors() {
            let keys = factor.keys();
            if !keys.iter().any(|key| key.robot == robot) {
                continue;
            }
            let across = keys.iter().any(|key| key.robot != robot);
            if across {
                shared.extend(keys.iter().copied().filter(|key| key.robot == robot));
            }
            if keys.iter().any(|key| key.robot < robot) {
                continue;
            }
            for key in &keys {
                if local.pose(*key).is_none() {
                    local.add_pose(*key, *graph.pose(*key).ok_or(Error::UnknownKey { key: *key })?)?;
                    local.set_fixed(*key, graph.is_fixed(*key))?;
                    shared.insert(*key);
                }
            }
            add(&mut local, &factor.measurement, factor.information, factor.kernel)?;
        }
        let shared = shared.into_iter().filter(|key| !local.is_fixed(*key)).collect();
        Ok(Self {
            robot,
            local,
            shared,
            models: BTreeMap::new(),
            // models know nothing of a relaxed start
            params: SolveParams { max_iterations: 1, start: Start::Given, ..SolveParams::default() },
            sequence: 0,
        })
    }

    /// Takes in a message; what is older than the last one heard from its sender, one's own, or not a model (sizes
    /// that do not match, numbers that are not finite) is dropped.
    pub fn receive(&mut self, message: &ModelMessage<G>) {
        let newest = self.models.get(&message.robot).is_none_or(|last| last.sequence < message.sequence);
        let side = message.poses.len() * N;
        let sound = message.information.shape() == (side, side)
            && message.gradient.len() == side
            && message.information.iter().chain(message.gradient.iter()).all(|x| x.is_finite())
            && message.poses.iter().all(|(_, pose)| pose.log().iter().all(|x| x.is_finite()));
        if message.robot != self.robot && newest && sound {
            self.models.insert(message.robot, message.clone());
        }
    }

    /// Solves for the own and the shared poses and returns what to tell the others.
    ///
    /// # Errors
    /// [`Error::Indefinite`] when the agent's factors do not determine one of its poses given the shared ones.
    pub fn step(&mut self) -> Result<ModelMessage<G>, Error> {
        let mut joint = self.local.clone();
        for model in self.models.values() {
            for (key, pose) in &model.poses {
                if joint.pose(*key).is_none() {
                    joint.add_pose(*key, *pose)?;
                }
            }
            if let Some(factor) = ModelFactor::new(model) {
                joint.add_custom(Arc::new(factor), Kernel::None)?;
            }
        }
        let solution = solve(&joint, &self.params)?;
        self.local.update(&solution);
        self.sequence += 1;
        let (information, gradient) = condense(&self.local, &self.shared)?;
        let poses = self.shared.iter().filter_map(|key| self.local.pose(*key).map(|pose| (*key, *pose)));
        Ok(ModelMessage {
            robot: self.robot,
            sequence: self.sequence,
            poses: poses.collect(),
            information,
            gradient,
        })
    }

    /// The agent's own poses, ascending by key.
    pub fn poses(&self) -> impl Iterator<Item = (Key, &G)> {
        self.local.poses().filter(|(key, _)| key.robot == self.robot)
    }
}

fn add<const N: usize, G: LieGroup<N>>(
    graph: &mut PoseGraph<G, N>,
    measurement: &Measurement<G, N>,
    information: nalgebra::SMatrix<f64, N, N>,
    kernel: Kernel,
) -> Result<(), Error> {
    match measurement {
        Measurement::Prior { key, measured } => graph.add_prior(*key, *measured, information, kernel)?,
        Measurement::Between { from, to, measured } => {
            graph.add_between(*from, *to, *measured, information, kernel)?
        }
        Measurement::Custom(custom) => graph.add_custom(custom.clone(), kernel)?,
    };
    Ok(())
}

/// Hessian and gradient of the cost of `graph` by the poses `shared`, with all others eliminated.
fn condense<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    shared: &[Key],
) -> Result<(DMatrix<f64>, DVector<f64>), Error> {
    let mut all = Problem::new(graph, &[])?;
    all.linearise(&graph.poses);
    let mut held = graph.clone();
    for key in shared {
        held.set_fixed(*key, true)?;
    }
    let gauge = held.gauge_keys(Gauge::HoldFirst)?;
    let mut inner = Problem::new(&held, &gauge)?;
    inner.linearise(&graph.poses);
    let mut place = vec![HELD; graph.pose_count()];
    for (index, key) in shared.iter().enumerate() {
        place[graph.slot(*key)?] = index as u32;
    }
    let side = shared.len() * N;
    let (mut information, mut gradient) = (DMatrix::<f64>::zeros(side, side), DVector::<f64>::zeros(side));
    for (column, slot) in all.slots.iter().enumerate() {
        let at = place[*slot as usize];
        if at != HELD {
            let at = at as usize * N;
            information.view_mut((at, at), (N, N)).copy_from(&all.hessian.diagonal[column]);
            gradient.rows_mut(at, N).copy_from(&all.gradient[column]);
        }
    }
    // blocks between eliminated and shared poses, by shared pose
    let mut mixed: Vec<Vec<(usize, nalgebra::SMatrix<f64, N, N>)>> = vec![Vec::new(); shared.len()];
    for (block, (row, column)) in all.hessian.off_diagonal.iter().zip(&all.pairs) {
        let slots = [*row, *column].map(|c| all.slots[c as usize] as usize);
        let places = slots.map(|s| place[s]);
        let columns = slots.map(|s| inner.columns[s]);
        match places {
            [HELD, HELD] => {}
            [HELD, at] if columns[0] != HELD => mixed[at as usize].push((columns[0] as usize, *block)),
            [at, HELD] if columns[1] != HELD => {
                mixed[at as usize].push((columns[1] as usize, block.transpose()));
            }
            [a, b] if a != HELD && b != HELD => {
                let (a, b) = (a as usize * N, b as usize * N);
                information.view_mut((a, b), (N, N)).copy_from(block);
                information.view_mut((b, a), (N, N)).copy_from(&block.transpose());
            }
            _ => {}
        }
    }
    if inner.free() > 0 {
        eliminate(graph, &inner, &mixed, &mut information, &mut gradient)?;
    }
    Ok((information, gradient))
}

/// Subtracts from the shared blocks what the poses of `inner` contribute once they are at their best.
fn eliminate<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    inner: &Problem<G, N>,
    mixed: &[Vec<(usize, nalgebra::SMatrix<f64, N, N>)>],
    information: &mut DMatrix<f64>,
    gradient: &mut DVector<f64>,
) -> Result<(), Error> {
    let mut cholesky = inner.cholesky();
    cholesky
        .factor(&inner.hessian, None)
        .map_err(|c| Error::Indefinite { key: graph.keys[inner.slots[c] as usize] })?;
    let zero = SVector::<f64, N>::zeros();
    let touching = |x: &[SVector<f64, N>], other: usize| -> SVector<f64, N> {
        mixed[other].iter().fold(zero, |sum, (at, block)| sum + block.tr_mul(&x[*at]))
    };
    let mut x = inner.gradient.clone();
    cholesky.solve(&mut x);
    for other in 0..mixed.len() {
        let mut rows = gradient.rows_mut(other * N, N);
        rows -= touching(&x, other);
    }
    for (shared, blocks) in mixed.iter().enumerate() {
        for c in 0..N {
            x.fill(zero);
            for (at, block) in blocks {
                x[*at] += block.column(c);
            }
            cholesky.solve(&mut x);
            for other in 0..mixed.len() {
                let mut column = information.view_mut((other * N, shared * N + c), (N, 1));
                column -= touching(&x, other);
            }
        }
    }
    let symmetric = (&*information + information.transpose()) * 0.5;
    information.copy_from(&symmetric);
    Ok(())
}

/// Added to the diagonal of a model, relative to its largest entry: models do not know where they lie together. It
/// pulls towards where the model was made, which at a fixed point is where the poses are.
const DAMPING: f64 = 1e-10;

/// A model as a factor: `½ |W δ + c|²` with `δ` the perturbations from where it was made, `WᵀW` the Hessian and
/// `Wᵀc` the gradient.
#[derive(Debug)]
struct ModelFactor<G> {
    keys: Vec<Key>,
    reference: Vec<G>,
    whitening: DMatrix<f64>,
    offset: DVector<f64>,
}

impl<G> ModelFactor<G> {
    fn new<const N: usize>(model: &ModelMessage<G>) -> Option<Self>
    where
        G: LieGroup<N>,
    {
        if model.poses.is_empty() {
            return None;
        }
        let mut damped = model.information.clone();
        let damping = DAMPING * damped.diagonal().max();
        (0..damped.nrows()).for_each(|k| damped[(k, k)] += damping);
        let lower = damped.cholesky()?.l();
        let offset = lower.solve_lower_triangular(&model.gradient)?;
        let (keys, reference) = model.poses.iter().copied().unzip();
        Some(Self { keys, reference, whitening: lower.transpose(), offset })
    }
}

impl<const N: usize, G: LieGroup<N>> CustomFactor<G, N> for ModelFactor<G> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        self.offset.len()
    }

    fn residual(&self, poses: &[G], residual: &mut [f64]) {
        residual.copy_from_slice(self.offset.as_slice());
        for (i, (reference, pose)) in self.reference.iter().zip(poses).enumerate() {
            let moved = reference.between(pose).log();
            // the whitening is upper triangular
            for (row, sum) in residual.iter_mut().enumerate().take((i + 1) * N) {
                *sum += (0..N).map(|c| self.whitening[(row, i * N + c)] * moved[c]).sum::<f64>();
            }
        }
    }

    fn jacobian(&self, poses: &[G], which: usize, jacobian: &mut [f64]) {
        let by_pose = G::right_jacobian_inverse(&self.reference[which].between(&poses[which]).log());
        jacobian.fill(0.0);
        for row in 0..(which + 1) * N {
            for c in 0..N {
                jacobian[row * N + c] =
                    (0..N).map(|k| self.whitening[(row, which * N + k)] * by_pose[(k, c)]).sum();
            }
        }
    }
}

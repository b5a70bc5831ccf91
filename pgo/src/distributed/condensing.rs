use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::SMatrix;

use crate::condense::{Model, condense};
use crate::quadratic::Quadratic;
use crate::{Error, Kernel, Key, Measurement, PoseGraph, SolveParams, Start, solve};

/// A relative pose as it was measured, between two poses that robots share.
#[derive(Debug, Clone, PartialEq)]
pub struct Relative<G, const N: usize> {
    /// The pose measured from.
    pub from: Key,
    /// The pose measured.
    pub to: Key,
    /// `from_from_to`.
    pub measured: G,
    /// Information in the frame of the measured `to`, order translation then rotation.
    pub information: SMatrix<f64, N, N>,
    /// Robust kernel.
    pub kernel: Kernel,
}

/// What one robot's measurements say about the poses it shares with others: relative poses between those as they
/// were measured, and quadratic models of all else with the robot's other poses at their best.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelMessage<G, const N: usize> {
    /// Sender.
    pub robot: u32,
    /// Grows with every message of a sender, so that a receiver can drop what arrives late.
    pub sequence: u64,
    /// Where the models were made: the sender's poses that factors join to other robots, and the others' poses that
    /// the sender's factors name, in the common frame.
    pub poses: Vec<(Key, G)>,
    /// The models; their keys are among those of `poses`.
    pub models: Vec<Model>,
    /// The relative poses; their keys are among those of `poses`.
    pub relatives: Vec<Relative<G, N>>,
}

impl<const N: usize, G: LieGroup<N>> ModelMessage<G, N> {
    /// Size on the wire in bytes: 4 for the robot, 8 for the sequence, 8 a key and 8 a number, 9 a kernel; of
    /// symmetric matrices the upper triangle.
    pub fn bytes(&self) -> usize {
        let triangle = |side: usize| side * (side + 1) / 2;
        let model = |m: &Model| {
            let side = m.gradient.len();
            8 * (m.keys.len() + triangle(side) + side)
        };
        let relative = 8 * (2 + N + triangle(N)) + 9;
        12 + 8 * self.poses.len() * (1 + N)
            + self.models.iter().map(model).sum::<usize>()
            + self.relatives.len() * relative
    }

    /// Adds to a graph what the message says, and the poses it lacks; `None` when it is not sound: sizes that do not
    /// match, keys it does not hold, numbers that are not finite.
    fn add_to(&self, graph: &mut PoseGraph<G, N>) -> Option<()> {
        let at: BTreeMap<Key, G> = self.poses.iter().copied().collect();
        for (key, pose) in &self.poses {
            if graph.pose(*key).is_none() {
                graph.add_pose(*key, *pose).ok()?;
            }
        }
        for r in &self.relatives {
            (at.contains_key(&r.from) && at.contains_key(&r.to)).then_some(())?;
            graph.add_between(r.from, r.to, r.measured, r.information, r.kernel).ok()?;
        }
        for model in &self.models {
            let side = model.keys.len() * N;
            let fits = model.information.shape() == (side, side) && model.gradient.len() == side;
            let finite = model.information.iter().chain(&model.gradient).all(|x| x.is_finite());
            (fits && finite).then_some(())?;
            let poses: Option<Vec<(Key, G)>> =
                model.keys.iter().map(|key| at.get(key).map(|pose| (*key, *pose))).collect();
            if let Some(factor) = Quadratic::new(&poses?, &model.information, &model.gradient) {
                graph.add_custom(Arc::new(factor), Kernel::None).ok()?;
            }
        }
        Some(())
    }
}

/// One robot of a team that minimises the common cost by exchanging condensed models: it solves for its own poses
/// and the shared poses of all together, with every other robot's measurements as the model it last heard, and tells
/// the others the model of its own.
///
/// A model is exact to second order where it was made, so once nothing moves any more the gradient of the common
/// cost is zero: the fixed points are those of the centralised problem, and near them each round is a step of
/// Gauss-Newton. That takes few rounds where [`super::Agent`] takes thousands, for larger messages: they grow with
/// the number of shared poses where a robot goes on without meeting its own path, and with its square where its own
/// loops join all of them. Messages may be lost, repeated and reordered; agents may step in any order.
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
    shared: BTreeSet<Key>,
    /// The last message heard from each robot.
    heard: BTreeMap<u32, ModelMessage<G, N>>,
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
        shared.retain(|key| !local.is_fixed(*key));
        Ok(Self {
            robot,
            local,
            shared,
            heard: BTreeMap::new(),
            // models know nothing of a relaxed start
            params: SolveParams { max_iterations: 1, start: Start::Given, ..SolveParams::default() },
            sequence: 0,
        })
    }

    /// Takes in a message; what is older than the last one heard from its sender, one's own, or not sound (sizes that
    /// do not match, keys that are missing, numbers that are not finite) is dropped.
    pub fn receive(&mut self, message: &ModelMessage<G, N>) {
        let newest = self.heard.get(&message.robot).is_none_or(|last| last.sequence < message.sequence);
        if message.robot != self.robot && newest && message.add_to(&mut PoseGraph::new()).is_some() {
            self.heard.insert(message.robot, message.clone());
        }
    }

    /// Solves for the own and the shared poses and returns what to tell the others.
    ///
    /// # Errors
    /// [`Error::Indefinite`] when the agent's factors do not determine one of its poses given the shared ones.
    pub fn step(&mut self) -> Result<ModelMessage<G, N>, Error> {
        let mut joint = self.local.clone();
        for message in self.heard.values() {
            message.add_to(&mut joint);
        }
        let solution = solve(&joint, &self.params)?;
        self.local.update(&solution);
        self.sequence += 1;
        self.message()
    }

    fn message(&self) -> Result<ModelMessage<G, N>, Error> {
        let mut relatives = Vec::new();
        let mut others = Vec::new();
        for (id, factor) in self.local.factors() {
            match &factor.measurement {
                Measurement::Between { from, to, measured }
                    if self.shared.contains(from) && self.shared.contains(to) =>
                {
                    let (from, to, measured) = (*from, *to, *measured);
                    let (information, kernel) = (factor.information, factor.kernel);
                    relatives.push(Relative { from, to, measured, information, kernel });
                }
                _ => others.push(id),
            }
        }
        let models = condense(&self.local, &self.shared, others.into_iter())?;
        let poses = self.shared.iter().filter_map(|key| self.local.pose(*key).map(|pose| (*key, *pose)));
        Ok(ModelMessage {
            robot: self.robot,
            sequence: self.sequence,
            poses: poses.collect(),
            models,
            relatives,
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
    information: SMatrix<f64, N, N>,
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

use std::collections::BTreeMap;

use draco_lie::LieGroup;

use crate::optimizer::Optimizer;
use crate::problem::Problem;
use crate::sparse::Cholesky;
use crate::{Error, Key, Measurement, PoseGraph, SolveParams};

/// Poses one robot tells the others.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseMessage<G> {
    /// Sender.
    pub robot: u32,
    /// Grows with every message of a sender, so that a receiver can drop what arrives late.
    pub sequence: u64,
    /// The sender's poses that factors join to other robots, in the common frame.
    pub poses: Vec<(Key, G)>,
}

impl<G> PoseMessage<G> {
    /// Size on the wire in bytes: 4 for the robot, 8 for the sequence, 8 a key and 8 a number.
    pub fn bytes<const N: usize>(&self) -> usize
    where
        G: LieGroup<N>,
    {
        12 + self.poses.len() * 8 * (1 + N)
    }
}

/// One robot of a team that minimises the common cost by block-coordinate descent: it moves its own poses with
/// the others' held where it last heard they were, and tells the others where its own are.
///
/// Every agent needs a common frame for the first guesses. With every pose told and nothing changing any more,
/// the gradient of the common cost is zero: the fixed points are those of the centralised problem. Messages may
/// be lost, repeated and reordered; agents may step in any order.
#[derive(Debug)]
pub struct Agent<G, const N: usize> {
    robot: u32,
    keys: Vec<Key>,
    poses: Vec<G>,
    slots: BTreeMap<Key, usize>,
    /// Own poses that the others need.
    public: Vec<usize>,
    problem: Problem<G, N>,
    cholesky: Option<Cholesky<N>>,
    params: SolveParams,
    /// Sequence of the last message heard from each robot.
    heard: BTreeMap<u32, u64>,
    sequence: u64,
}

impl<const N: usize, G: LieGroup<N>> Agent<G, N> {
    /// The agent of `robot` with the part of the common graph it knows: its own poses, the factors on them and
    /// first guesses of the others' poses those name. Factors on no own pose are passed over.
    ///
    /// # Errors
    /// [`Error::UnknownKey`] when a factor names a pose `graph` does not hold, [`Error::EmptyGraph`].
    pub fn new(graph: &PoseGraph<G, N>, robot: u32) -> Result<Self, Error> {
        let mut local = PoseGraph::new();
        let mut public = BTreeMap::new();
        let mut factors = Vec::new();
        for (_, factor) in graph.factors() {
            let keys = factor.keys();
            let own = keys.iter().filter(|k| k.robot == robot).count();
            if own > 0 {
                factors.push((factor, keys.clone()));
            }
            if own > 0 && own < keys.len() {
                public.extend(keys.iter().filter(|k| k.robot == robot).map(|k| (*k, ())));
            }
        }
        for (key, pose) in graph.poses() {
            let named = || factors.iter().any(|(_, keys)| keys.contains(&key));
            if key.robot == robot || named() {
                local.add_pose(key, *pose)?;
                local.set_fixed(key, key.robot != robot || graph.is_fixed(key))?;
            }
        }
        if local.pose_count() == 0 {
            return Err(Error::EmptyGraph);
        }
        for (factor, _) in factors {
            let (information, kernel) = (factor.information, factor.kernel);
            match &factor.measurement {
                Measurement::Prior { key, measured } => {
                    local.add_prior(*key, *measured, information, kernel)?
                }
                Measurement::Between { from, to, measured } => {
                    local.add_between(*from, *to, *measured, information, kernel)?
                }
                Measurement::Custom(custom) => local.add_custom(custom.clone(), kernel)?,
            };
        }
        let held = local.gauge_keys(crate::Gauge::HoldFirst)?;
        let problem = Problem::new(&local, &held)?;
        let slots: BTreeMap<Key, usize> = local.slots.iter().map(|(k, s)| (*k, *s as usize)).collect();
        Ok(Self {
            robot,
            public: public.keys().filter_map(|key| slots.get(key).copied()).collect(),
            cholesky: (problem.free() > 0).then(|| problem.cholesky(&local.elimination)),
            keys: local.keys,
            poses: local.poses,
            slots,
            problem,
            params: SolveParams { max_iterations: 1, ..SolveParams::default() },
            heard: BTreeMap::new(),
            sequence: 0,
        })
    }

    /// Takes in a message; what is older than the last one heard from its sender, or one's own, is dropped.
    /// Poses that no factor of this agent names, and poses that are not the sender's, are passed over.
    pub fn receive(&mut self, message: &PoseMessage<G>) {
        let newest = self.heard.get(&message.robot).is_none_or(|last| *last < message.sequence);
        if message.robot == self.robot || !newest {
            return;
        }
        self.heard.insert(message.robot, message.sequence);
        for (key, pose) in &message.poses {
            let finite = pose.log().iter().all(|x| x.is_finite());
            if let Some(slot) = self.slots.get(key).filter(|_| key.robot == message.robot && finite) {
                self.poses[*slot] = *pose;
            }
        }
    }

    /// Moves the own poses by one damped Gauss-Newton step and returns what to tell the others.
    ///
    /// # Errors
    /// [`Error::Indefinite`] when the agent's factors do not determine one of its poses.
    pub fn step(&mut self) -> Result<PoseMessage<G>, Error> {
        if let Some(cholesky) = &mut self.cholesky {
            Optimizer::new(&mut self.problem, cholesky, &self.params)
                .run(&mut self.poses)
                .map_err(|slot| Error::Indefinite { key: self.keys[slot] })?;
        }
        self.sequence += 1;
        let poses = self.public.iter().map(|slot| (self.keys[*slot], self.poses[*slot])).collect();
        Ok(PoseMessage { robot: self.robot, sequence: self.sequence, poses })
    }

    /// The agent's own poses, in the order its graph held them.
    pub fn poses(&self) -> impl Iterator<Item = (Key, &G)> {
        self.keys.iter().copied().zip(&self.poses).filter(|(key, _)| key.robot == self.robot)
    }
}

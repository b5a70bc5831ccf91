//! Distributed schemes against the centralised optimum.

mod common;

use std::collections::{BTreeMap, BTreeSet};

use draco_lie::LieGroup;
use draco_pgo::distributed::{
    Agent, CondensingAgent, Link, ModelMessage, Neighbour, PoseMessage, TwoStepVariant, two_step,
};
use draco_pgo::io::team;
use draco_pgo::{Kernel, Key, Measurement, PoseGraph, PoseGraph2, PoseGraph3, SolveParams, solve};
use nalgebra::{Isometry2, Isometry3, Matrix3, Vector3};
use rand::{RngExt, SeedableRng};

/// All robots' files of a folder as one graph, its first pose held.
fn joint(folder: &str) -> Option<PoseGraph3> {
    let folder = common::data(&format!("pgo/multi/{folder}"))?;
    let mut graph = team::read_as::<6, Isometry3<f64>>(folder).unwrap().graph;
    let first = graph.poses().map(|(key, _)| key).next().unwrap();
    graph.set_fixed(first, true).unwrap();
    Some(graph)
}

/// An agent of either scheme.
trait Robot<const N: usize, G: LieGroup<N>>: Sized {
    type Message: Clone;
    fn make(graph: &PoseGraph<G, N>, robot: u32) -> Self;
    fn hear(&mut self, message: &Self::Message);
    fn act(&mut self) -> (Self::Message, usize);
    fn at(&self) -> Vec<(Key, G)>;
}

impl<const N: usize, G: LieGroup<N>> Robot<N, G> for Agent<G, N> {
    type Message = PoseMessage<G>;
    fn make(graph: &PoseGraph<G, N>, robot: u32) -> Self {
        Agent::new(graph, robot).unwrap()
    }
    fn hear(&mut self, message: &Self::Message) {
        self.receive(message);
    }
    fn act(&mut self) -> (Self::Message, usize) {
        let message = self.step().unwrap();
        let bytes = message.bytes::<N>();
        (message, bytes)
    }
    fn at(&self) -> Vec<(Key, G)> {
        self.poses().map(|(key, pose)| (key, *pose)).collect()
    }
}

impl<const N: usize, G: LieGroup<N>> Robot<N, G> for CondensingAgent<G, N> {
    type Message = ModelMessage<G, N>;
    fn make(graph: &PoseGraph<G, N>, robot: u32) -> Self {
        CondensingAgent::new(graph, robot).unwrap()
    }
    fn hear(&mut self, message: &Self::Message) {
        self.receive(message);
    }
    fn act(&mut self) -> (Self::Message, usize) {
        let message = self.step().unwrap();
        let bytes = message.bytes();
        (message, bytes)
    }
    fn at(&self) -> Vec<(Key, G)> {
        self.poses().map(|(key, pose)| (key, *pose)).collect()
    }
}

/// What a run took.
#[derive(Debug)]
struct Outcome {
    cost: f64,
    rounds: usize,
    /// Bytes broadcast by all robots together.
    bytes: usize,
}

/// Runs the agents for some rounds; each message to each receiver is lost with a probability and may be overtaken
/// by others. Stops early once the cost of the common graph is below `goal`.
fn run<R: Robot<N, G>, const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    rounds: usize,
    loss: f64,
    goal: f64,
) -> Outcome {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let robots: BTreeSet<u32> = graph.poses().map(|(key, _)| key.robot).collect();
    let mut agents: Vec<R> = robots.iter().map(|r| R::make(graph, *r)).collect();
    let mut late: Vec<(usize, R::Message)> = Vec::new();
    let mut outcome = Outcome { cost: graph.cost(), rounds: 0, bytes: 0 };
    let every = if rounds > 500 { 50 } else { 1 };
    while outcome.rounds < rounds && outcome.cost > goal {
        outcome.rounds += 1;
        for sender in 0..agents.len() {
            let (message, bytes) = agents[sender].act();
            outcome.bytes += bytes;
            for receiver in (0..agents.len()).filter(|r| *r != sender) {
                if rng.random_range(0.0..1.0) < loss {
                    continue;
                }
                if rng.random_range(0.0..1.0) < loss {
                    late.push((receiver, message.clone()));
                } else {
                    agents[receiver].hear(&message);
                }
            }
            if late.len() > 5 {
                let (receiver, message) = late.swap_remove(rng.random_range(0..late.len()));
                agents[receiver].hear(&message);
            }
        }
        if outcome.rounds.is_multiple_of(every) || outcome.rounds == rounds {
            let mut result = graph.clone();
            for (key, pose) in agents.iter().flat_map(Robot::at) {
                result.set_pose(key, pose).unwrap();
            }
            outcome.cost = result.cost();
        }
    }
    outcome
}

#[test]
fn small_messages_reach_the_centralised_optimum_over_perfect_and_lossy_links() {
    for folder in ["dm4", "dm9"] {
        let Some(graph) = joint(folder) else { return };
        let best = solve(&graph, &SolveParams::default()).unwrap().final_cost;
        let perfect = run::<Agent<_, 6>, 6, _>(&graph, 6000, 0.0, best * (1.0 + 1e-6));
        assert!(perfect.cost <= best * (1.0 + 1e-6), "{folder}: {perfect:?} instead of {best}");
        let lossy = run::<Agent<_, 6>, 6, _>(&graph, 6000, 0.3, best * (1.0 + 1e-4));
        assert!(lossy.cost <= best * (1.0 + 1e-4), "{folder} with losses: {lossy:?} instead of {best}");
    }
}

#[test]
fn condensed_models_reach_the_centralised_optimum_in_few_rounds() {
    for folder in ["dm4", "dm9", "argos4_clean"] {
        let Some(graph) = joint(folder) else { return };
        let best = solve(&graph, &SolveParams::default()).unwrap().final_cost;
        let perfect = run::<CondensingAgent<_, 6>, 6, _>(&graph, 100, 0.0, best * (1.0 + 1e-6));
        println!("{folder}: {perfect:?}, best {best}");
        assert!(perfect.cost <= best * (1.0 + 1e-6), "{folder}: {perfect:?} instead of {best}");
        let lossy = run::<CondensingAgent<_, 6>, 6, _>(&graph, 300, 0.3, best * (1.0 + 1e-4));
        println!("{folder} with losses: {lossy:?}");
        assert!(lossy.cost <= best * (1.0 + 1e-4), "{folder} with losses: {lossy:?} instead of {best}");
    }
}

#[test]
fn what_is_not_a_model_is_dropped() {
    let (_, graph) = two_robots();
    let (mut one, mut two) =
        (CondensingAgent::new(&graph, 1).unwrap(), CondensingAgent::new(&graph, 2).unwrap());
    let sound = two.step().unwrap();
    let mut reference = CondensingAgent::new(&graph, 1).unwrap();
    let untouched = reference.step().unwrap();
    let mut bad = sound.clone();
    bad.models[0].information[(0, 0)] = f64::NAN;
    one.receive(&bad);
    let mut bad = sound.clone();
    bad.models[0].gradient = nalgebra::DVector::zeros(1);
    one.receive(&bad);
    let mut bad = sound.clone();
    bad.models[0].keys[0] = Key::new(7, 7);
    one.receive(&bad);
    assert_eq!(one.step().unwrap(), untouched);
    one.receive(&sound);
    assert_ne!(one.step().unwrap().poses, untouched.poses);
}

/// Two robots on circles that cross, each with its own noisy odometry and loops, and closures between them.
fn two_robots() -> (BTreeMap<u32, PoseGraph2>, PoseGraph2) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let sigma = Vector3::new(0.05, 0.05, 0.01);
    let omega = Matrix3::from_diagonal(&sigma.map(|s| 1.0 / (s * s)));
    let truth = |key: Key| {
        let angle = 0.3 * key.index as f64;
        let centre = if key.robot == 1 { 0.0 } else { 4.0 };
        let (x, y) = (centre + 5.0 * angle.cos(), 5.0 * angle.sin());
        Isometry2::new(nalgebra::Vector2::new(x, y), angle)
    };
    let mut measure = |a: Key, b: Key| {
        let noise = sigma.map(|s| s * rng.sample::<f64, _>(rand_distr::StandardNormal));
        truth(a).between(&truth(b)).plus(&noise)
    };
    let mut own = BTreeMap::new();
    let mut joint = PoseGraph2::new();
    for robot in [1, 2] {
        let mut graph = PoseGraph2::new();
        let key = |index| Key::new(robot, index);
        let mut at = Isometry2::identity();
        graph.add_pose(key(0), at).unwrap();
        for i in 1..40 {
            let step = measure(key(i - 1), key(i));
            at *= step;
            graph.add_pose(key(i), at).unwrap();
            graph.add_between(key(i - 1), key(i), step, omega, Kernel::None).unwrap();
        }
        for (i, j) in [(0, 21), (10, 31)] {
            graph.add_between(key(i), key(j), measure(key(i), key(j)), omega, Kernel::None).unwrap();
        }
        let solution = solve(&graph, &SolveParams::default()).unwrap();
        graph.update(&solution);
        let frame = truth(key(0));
        for (key, pose) in graph.poses() {
            joint.add_pose(key, frame * pose).unwrap();
        }
        for (_, factor) in graph.factors() {
            let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
            joint.add_between(*from, *to, *measured, omega, Kernel::None).unwrap();
        }
        own.insert(robot, graph);
    }
    for (i, j) in [(5, 3), (16, 18), (25, 24), (36, 39)] {
        let (a, b) = (Key::new(1, i), Key::new(2, j));
        joint.add_between(a, b, measure(a, b), omega, Kernel::Cauchy(1.0)).unwrap();
    }
    joint.set_fixed(Key::new(1, 0), true).unwrap();
    (own, joint)
}

/// Cost of the joint graph with every pose taken from a two-step solution.
fn cost_of(joint: &PoseGraph2, variant: &TwoStepVariant<3>, own: &BTreeMap<u32, PoseGraph2>) -> f64 {
    let links = Link::of_graph(joint, 1);
    let touched: Vec<Key> = links.iter().map(|l| l.neighbour).collect();
    let message = Neighbour::new(&own[&2], &touched).unwrap();
    assert!(message.bytes() > 40 * 8 * 4);
    let found = two_step(&own[&1], &links, &[message], variant, &SolveParams::default()).unwrap();
    let frame = joint.pose(Key::new(1, 0)).unwrap() * own[&1].pose(Key::new(1, 0)).unwrap().inverse();
    let mut result = joint.clone();
    for (key, pose) in found.own.iter().chain(&found.neighbours) {
        result.set_pose(*key, frame * pose).unwrap();
    }
    result.cost()
}

#[test]
fn condensed_two_step_is_near_the_joint_optimum_and_better_than_as_coded() {
    let (own, joint) = two_robots();
    let best = solve(&joint, &SolveParams::default()).unwrap().final_cost;
    let condensed = cost_of(&joint, &TwoStepVariant::Condensed, &own);
    let chain_information = Matrix3::from_diagonal(&Vector3::new(100.0, 100.0, 1e4));
    let as_coded = cost_of(&joint, &TwoStepVariant::AsCoded { chain_information }, &own);
    println!(
        "two-step cost over joint optimum: condensed {}, as coded {}",
        condensed / best,
        as_coded / best
    );
    // what is lost is the neighbour's loops, which a chain does not carry
    assert!(condensed <= 1.25 * best, "{condensed} instead of {best}");
    assert!(as_coded > 1.2 * condensed);
}

/// The two-step scheme as the first robot of a team runs it after one exchange: cost of everybody's poses over the
/// joint optimum.
fn two_step_ratio(graph: &PoseGraph3, variant: &TwoStepVariant<6>) -> f64 {
    let robots: BTreeSet<u32> = graph.poses().map(|(key, _)| key.robot).collect();
    let mut own: BTreeMap<u32, PoseGraph3> = robots.iter().map(|r| (*r, PoseGraph3::new())).collect();
    for (key, pose) in graph.poses() {
        own.get_mut(&key.robot).unwrap().add_pose(key, *pose).unwrap();
    }
    for (_, factor) in graph.factors() {
        let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
        if from.robot == to.robot {
            let part = own.get_mut(&from.robot).unwrap();
            part.add_between(*from, *to, *measured, factor.information, factor.kernel).unwrap();
        }
    }
    for part in own.values_mut() {
        let solution = solve(part, &SolveParams::default()).unwrap();
        part.update(&solution);
    }
    let links: Vec<Link<_, 6>> = robots
        .iter()
        .flat_map(|r| Link::of_graph(graph, *r).into_iter().filter(|l| l.own.robot < l.neighbour.robot))
        .collect();
    let first = *robots.first().unwrap();
    let neighbours: Vec<Neighbour<_, 6>> = robots
        .iter()
        .filter(|r| **r != first)
        .map(|r| {
            let ends = links.iter().flat_map(|l| [l.own, l.neighbour]);
            let touched: BTreeSet<Key> = ends.filter(|key| key.robot == *r).collect();
            Neighbour::new(&own[r], &touched.into_iter().collect::<Vec<_>>()).unwrap()
        })
        .collect();
    let found = two_step(&own[&first], &links, &neighbours, variant, &SolveParams::default()).unwrap();
    let mut result = graph.clone();
    for (key, pose) in found.own.iter().chain(&found.neighbours) {
        result.set_pose(*key, *pose).unwrap();
    }
    result.cost() / solve(graph, &SolveParams::default()).unwrap().final_cost
}

#[test]
fn the_condensed_two_step_scheme_is_near_the_joint_optimum_of_public_teams() {
    for folder in ["dm4", "dm9", "argos4_clean"] {
        let Some(graph) = joint(folder) else { return };
        let condensed = two_step_ratio(&graph, &TwoStepVariant::Condensed);
        let sigmas = nalgebra::Vector6::new(100.0, 100.0, 100.0, 1e4, 1e4, 1e4);
        let chain_information = nalgebra::Matrix6::from_diagonal(&sigmas);
        let as_coded = two_step_ratio(&graph, &TwoStepVariant::AsCoded { chain_information });
        println!(
            "{folder}: two-step cost over joint optimum: condensed {condensed:.4}, as coded {as_coded:.4}"
        );
        // chains without loops of their own, with the very noise the coded variant assumes: it is exact there
        let chains = folder == "argos4_clean";
        assert!(condensed <= 1.05 && (chains || condensed <= as_coded), "{folder}: {condensed} {as_coded}");
    }
}

#[test]
fn a_link_seen_from_the_other_side_is_the_same_measurement() {
    let mut graph = PoseGraph3::new();
    let (a, b) = (Key::new(1, 0), Key::new(2, 0));
    let z = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5));
    let small = nalgebra::Vector6::new(1e-4, -2e-4, 3e-4, 1e-4, 2e-4, -1e-4);
    graph.add_pose(a, Isometry3::identity()).unwrap();
    graph.add_pose(b, z.plus(&small)).unwrap();
    let omega = nalgebra::Matrix6::from_diagonal(&nalgebra::Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0));
    let id = graph.add_between(a, b, z, omega, Kernel::None).unwrap();
    let link = Link::of_graph(&graph, 2).remove(0);
    let other = graph.add_between(b, a, link.measured, link.information, link.kernel).unwrap();
    let (one, two) = (graph.chi2(id).unwrap(), graph.chi2(other).unwrap());
    assert!((one - two).abs() < 1e-3 * one, "{one} {two}");
}

//! Distributed schemes against the centralised optimum.

mod common;

use std::collections::{BTreeMap, BTreeSet};

use draco_lie::LieGroup;
use draco_pgo::distributed::{Agent, Link, Neighbour, PoseMessage, TwoStepVariant, two_step};
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Kernel, Key, Measurement, PoseGraph, PoseGraph2, PoseGraph3, SolveParams, solve};
use nalgebra::{Isometry2, Isometry3, Matrix3, Vector3};
use rand::{RngExt, SeedableRng};

/// All robots' files of a folder as one graph; an edge in two files is taken once.
fn team(folder: &str) -> Option<PoseGraph3> {
    let folder = common::data(&format!("pgo/multi/{folder}"))?;
    let mut graph = PoseGraph3::new();
    let mut parts = Vec::new();
    for k in 0.. {
        let path = folder.join(format!("{k}.g2o"));
        if !path.exists() {
            break;
        }
        let AnyGraph::Three(part) = g2o::read(path).unwrap() else { panic!("not in space") };
        parts.push(part);
    }
    // a file guesses other robots' poses too, but only a robot's own file declares its own
    for (k, part) in parts.iter().enumerate() {
        for (key, pose) in part.poses().filter(|(key, _)| key.robot as usize == 97 + k) {
            graph.add_pose(key, *pose).unwrap();
        }
    }
    let mut seen = BTreeSet::new();
    for part in &parts {
        for (_, factor) in part.factors() {
            let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
            let bits = measured.log().map(f64::to_bits);
            if seen.insert((*from, *to, bits.as_slice().to_vec())) {
                graph.add_between(*from, *to, *measured, factor.information, Kernel::None).unwrap();
            }
        }
    }
    let first = graph.poses().map(|(key, _)| key).next().unwrap();
    graph.set_fixed(first, true).unwrap();
    Some(graph)
}

/// Runs the agents for some rounds; each message to each receiver is lost with a probability and may overtake
/// others. Stops early once the cost of the common graph is below `goal`; returns that cost.
fn run<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, rounds: usize, loss: f64, goal: f64) -> f64 {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let robots: BTreeSet<u32> = graph.poses().map(|(key, _)| key.robot).collect();
    let mut agents: Vec<Agent<G, N>> = robots.iter().map(|r| Agent::new(graph, *r).unwrap()).collect();
    let mut late: Vec<(usize, PoseMessage<G>)> = Vec::new();
    let mut cost = graph.cost();
    for round in 1..=rounds {
        for sender in 0..agents.len() {
            let message = agents[sender].step().unwrap();
            for receiver in (0..agents.len()).filter(|r| *r != sender) {
                if rng.random_range(0.0..1.0) < loss {
                    continue;
                }
                if rng.random_range(0.0..1.0) < loss {
                    late.push((receiver, message.clone()));
                } else {
                    agents[receiver].receive(&message);
                }
            }
            if late.len() > 5 {
                let (receiver, message) = late.swap_remove(rng.random_range(0..late.len()));
                agents[receiver].receive(&message);
            }
        }
        if round % 50 == 0 || round == rounds {
            cost = team_cost(graph, &agents);
        }
        if cost <= goal {
            println!("done after {round} rounds");
            break;
        }
    }
    cost
}

fn team_cost<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, agents: &[Agent<G, N>]) -> f64 {
    let mut result = graph.clone();
    for agent in agents {
        for (key, pose) in agent.poses() {
            result.set_pose(key, *pose).unwrap();
        }
    }
    result.cost()
}

#[test]
fn agents_reach_the_centralised_optimum_over_perfect_and_lossy_links() {
    for (folder, rounds) in [("dm4", 6000), ("dm9", 6000)] {
        let Some(graph) = team(folder) else { return };
        let best = solve(&graph, &SolveParams::default()).unwrap().final_cost;
        let perfect = run(&graph, rounds, 0.0, best * (1.0 + 1e-6));
        assert!(perfect <= best * (1.0 + 1e-6), "{folder}: {perfect} instead of {best}");
        let lossy = run(&graph, rounds, 0.3, best * (1.0 + 1e-4));
        assert!(lossy <= best * (1.0 + 1e-4), "{folder} with losses: {lossy} instead of {best}");
    }
}

#[test]
#[ignore = "an experiment: rounds needed on the simulated team, printed"]
fn rounds_on_the_argos_team() {
    let Some(graph) = team("argos4_clean") else { return };
    let best = solve(&graph, &SolveParams::default()).unwrap().final_cost;
    for rounds in [100, 400, 1600] {
        let (perfect, lossy) = (run(&graph, rounds, 0.0, 0.0), run(&graph, rounds, 0.3, 0.0));
        println!("{rounds} rounds: {:.3e} and {:.3e} above {best}", perfect / best - 1.0, lossy / best - 1.0);
    }
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

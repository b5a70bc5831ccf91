//! The dual certificate on published sets.

mod common;

use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{
    ChordalPose, Key, PoseGraph, SolveParams, StaircaseParams, certify, chordal, chordal_objective, solve,
    staircase,
};
use nalgebra::{Isometry2, Matrix3, SVector, Vector2};
use rand::{RngExt, SeedableRng};

fn check<const N: usize, G: ChordalPose<N>>(mut graph: PoseGraph<G, N>, name: &str, objective: f64) {
    chordal(&mut graph).unwrap();
    let params = SolveParams { relative_tolerance: 1e-12, ..SolveParams::default() };
    let solution = solve(&chordal_objective(&graph).unwrap(), &params).unwrap();
    graph.update(&solution);
    let certificate = certify(&graph).unwrap();
    println!("{name}: {certificate:?} after {} iterations", solution.iterations);
    // 24227.0456 is our own figure, lower than the published 24227.215 and certified: by Gauss-Newton the chordal
    // objective of torus3D converges so slowly that six digits are what a hundred steps give
    let tolerance = if name == "torus3D" { 1e-6 } else { 1e-7 };
    assert!((certificate.objective - objective).abs() <= tolerance * objective, "{name}: {certificate:?}");
    assert!((certificate.objective - 2.0 * solution.final_cost).abs() <= 1e-9 * objective);
    assert!(certificate.slack.is_some_and(|slack| slack <= 1e-5), "{name}: {certificate:?}");
    // Newton's method gets all the digits
    chordal(&mut graph).unwrap();
    let found = staircase(&graph, &StaircaseParams::default()).unwrap();
    println!("{name}: {} steps, {:?}", found.solution.iterations, found.certificate);
    assert!((found.certificate.objective - objective).abs() <= 1e-7 * objective, "{name}: {found:?}");
    assert!(found.certificate.slack.is_some_and(|slack| slack <= 1e-7), "{name}: {:?}", found.certificate);
}

#[test]
fn optima_of_published_sets_are_certified() {
    for (name, objective) in [
        ("tinyGrid3D", 18.519366),
        ("smallGrid3D", 1025.3981),
        ("CSAIL", 31.703716),
        ("MIT", 61.154116),
        ("intel", 52.348227),
        ("parking-garage", 1.2625244),
    ] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => check(graph, name, objective),
            AnyGraph::Three(graph) => check(graph, name, objective),
        }
    }
}

#[test]
#[ignore = "the large sets take a minute in the dev profile"]
fn optima_of_the_large_published_sets_are_certified() {
    for (name, objective) in [("manhattan", 6431.3914), ("sphere2500", 1687.0058), ("torus3D", 24227.0456)] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => check(graph, name, objective),
            AnyGraph::Three(graph) => check(graph, name, objective),
        }
    }
}

/// Climbs from poses drawn at random.
fn climb<const N: usize, G: ChordalPose<N>>(mut graph: PoseGraph<G, N>, name: &str, objective: f64) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    for key in &keys {
        let xi = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-3.0..3.0));
        graph.set_pose(*key, G::exp(&xi)).unwrap();
    }
    let first = *graph.pose(keys[0]).unwrap();
    let found = staircase(&graph, &StaircaseParams::default()).unwrap();
    println!(
        "{name}: rank {}, {:?}, {:?}, {} steps",
        found.rank, found.certificate, found.lower_bound, found.solution.iterations
    );
    assert!((found.certificate.objective - objective).abs() <= 1e-7 * objective, "{name}: {found:?}");
    assert!(found.certificate.slack.is_some_and(|slack| slack <= 1e-6), "{name}");
    let bound = found.lower_bound.unwrap();
    assert!(bound <= found.certificate.objective && bound >= objective * (1.0 - 1e-4), "{name}: {bound}");
    graph.update(&found.solution);
    assert!(graph.pose(keys[0]).unwrap().between(&first).log().norm() < 1e-9);
    let again = certify(&graph).unwrap();
    assert!((again.objective - found.certificate.objective).abs() <= 1e-9 * objective);
}

#[test]
fn the_staircase_climbs_from_random_poses_to_the_certified_optimum() {
    for (name, objective) in
        [("tinyGrid3D", 18.519366), ("smallGrid3D", 1025.3981), ("CSAIL", 31.703716), ("intel", 52.348227)]
    {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => climb(graph, name, objective),
            AnyGraph::Three(graph) => climb(graph, name, objective),
        }
    }
}

#[test]
#[ignore = "minutes in the dev profile"]
fn the_staircase_climbs_on_the_large_sets() {
    for (name, objective) in [
        ("MIT", 61.154116),
        ("manhattan", 6431.3914),
        ("parking-garage", 1.2625244),
        ("sphere2500", 1687.0058),
        ("torus3D", 24227.0456),
    ] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => climb(graph, name, objective),
            AnyGraph::Three(graph) => climb(graph, name, objective),
        }
    }
}

#[test]
fn the_staircase_leaves_a_wound_ring() {
    let n = 30;
    let mut graph = PoseGraph::new();
    let turn = std::f64::consts::TAU / f64::from(n);
    for i in 0..n {
        let wound = Isometry2::new(Vector2::zeros(), turn * f64::from(i));
        graph.add_pose(Key::new(0, i as u64), wound).unwrap();
    }
    for i in 0..n {
        let (a, b) = (Key::new(0, i as u64), Key::new(0, ((i + 1) % n) as u64));
        graph.add_between(a, b, Isometry2::identity(), Matrix3::identity(), draco_pgo::Kernel::None).unwrap();
    }
    let wound = certify(&graph).unwrap();
    assert!(wound.stationarity < 1e-12 && wound.objective > 1.0);
    let found = staircase(&graph, &StaircaseParams::default()).unwrap();
    assert!(found.rank > 2 && found.certificate.objective < 1e-12, "{found:?}");
    assert_eq!(found.certificate.slack, Some(1e-8));
    let flat = StaircaseParams { max_rank: 2, ..StaircaseParams::default() };
    let stuck = staircase(&graph, &flat).unwrap();
    assert!(stuck.lower_bound.is_none() && (stuck.certificate.objective - wound.objective).abs() < 1e-9);
}

#[test]
fn a_local_minimum_is_not_certified() {
    // a ring whose headings wind once too often: stationary, but not the best
    let n = 12;
    let mut graph = PoseGraph::new();
    let turn = std::f64::consts::TAU / f64::from(n);
    for i in 0..n {
        let wound = Isometry2::new(Vector2::zeros(), turn * f64::from(i));
        graph.add_pose(Key::new(0, i as u64), wound).unwrap();
    }
    let omega = Matrix3::identity();
    for i in 0..n {
        let (a, b) = (Key::new(0, i as u64), Key::new(0, ((i + 1) % n) as u64));
        graph.add_between(a, b, Isometry2::identity(), omega, draco_pgo::Kernel::None).unwrap();
    }
    let wound = certify(&graph).unwrap();
    assert!(wound.stationarity < 1e-12 && wound.slack.is_none(), "{wound:?}");
    chordal(&mut graph).unwrap();
    let best = certify(&graph).unwrap();
    assert!(best.objective < 1e-20 && best.slack == Some(1e-8), "{best:?}");
}

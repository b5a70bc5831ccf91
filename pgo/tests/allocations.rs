//! Iterations of the solver reuse their memory.

mod common;

use std::sync::Arc;

use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Key, MaxMixture, Measurement, Method, PoseGraph, SolveParams, Start, chordal, solve};

/// Allocations of a solution that stops after `iterations` linearisations.
fn allocations<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    method: Method,
    iterations: usize,
) -> u64 {
    let params = SolveParams {
        method,
        start: Start::Given,
        max_iterations: iterations,
        relative_tolerance: 0.0,
        absolute_tolerance: 0.0,
        ..SolveParams::default()
    };
    let mut done = 0;
    let counted = allocation_counter::measure(|| done = solve(graph, &params).map_or(0, |s| s.iterations));
    assert!(done > 0);
    counted.count_total
}

fn iterations_are_free<const N: usize, G: LieGroup<N>>(name: &str, graph: &PoseGraph<G, N>) {
    // the first solution leaves the order of elimination to the others
    allocations(graph, Method::GaussNewton, 1);
    for method in [Method::GaussNewton, Method::LevenbergMarquardt, Method::Dogleg] {
        let (few, many) = (allocations(graph, method, 1), allocations(graph, method, 4));
        assert_eq!(few, many, "{name} by {method:?}: {many} allocations in four iterations, {few} in one");
    }
}

#[test]
fn no_iteration_after_the_first_allocates() {
    for name in ["intel", "sphere2500"] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => iterations_are_free(name, &graph),
            AnyGraph::Three(graph) => iterations_are_free(name, &graph),
        }
    }
}

#[test]
fn user_defined_factors_do_not_allocate_either() {
    let Some(path) = common::data("pgo/intel.g2o") else { return };
    let AnyGraph::Two(mut graph) = g2o::read(path).unwrap() else { unreachable!("a set in the plane") };
    for i in (10..500).step_by(10) {
        let [a, b] = [i, i + 300].map(|i| Key::new(0, i));
        let measured = graph.pose(a).unwrap().between(graph.pose(b).unwrap());
        let information = nalgebra::Matrix3::identity();
        let mixture = MaxMixture::or_outlier(a, b, measured, information, (0.1, 100.0)).unwrap();
        graph.add_custom(Arc::new(mixture), draco_pgo::Kernel::Cauchy(3.0)).unwrap();
    }
    iterations_are_free("intel with mixtures", &graph);
}

/// What GTSAM 4.3.0 takes above the graph by Gauss-Newton, in MiB (growth of the resident set).
const PEER: [(&str, f64); 2] = [("sphere2500", 30.7), ("torus3D", 82.5)];

/// A copy that does not know an order of elimination yet.
fn forgetful<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>) -> PoseGraph<G, N> {
    let mut copy = PoseGraph::new();
    for (key, pose) in graph.poses() {
        copy.add_pose(key, *pose).unwrap();
    }
    for (_, factor) in graph.factors() {
        let Measurement::Between { from, to, measured } = factor.measurement else {
            panic!("no relative pose")
        };
        copy.add_between(from, to, measured, factor.information, factor.kernel).unwrap();
    }
    copy
}

#[test]
fn less_memory_is_taken_above_the_graph_than_by_a_peer() {
    for (name, peer) in PEER {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let AnyGraph::Three(mut graph) = g2o::read(path).unwrap() else { unreachable!("a set in space") };
        chordal(&mut graph).unwrap();
        let graph = forgetful(&graph);
        let counted = allocation_counter::measure(|| drop(solve(&graph, &SolveParams::default())));
        let peak = counted.bytes_max as f64 / f64::from(1 << 20);
        println!("{name}: {peak:.1} MiB above the graph, {:.2} of the peer's", peak / peer);
        assert!(peak <= 0.5 * peer, "{name}: {peak} MiB");
    }
}

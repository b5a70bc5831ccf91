//! The feature `rayon` changes no bit: threads share the work in one fixed way.
#![cfg(feature = "rayon")]

mod common;

use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Method, PoseGraph, SolveParams, solve};

fn bits<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, threads: usize) -> Vec<u64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let params = SolveParams { method: Method::GaussNewton, max_iterations: 3, ..SolveParams::default() };
    let solution = pool.install(|| solve(graph, &params)).unwrap();
    let identity = G::identity();
    let coordinates =
        solution.poses().flat_map(|(_, p)| p.minus(&identity).iter().copied().collect::<Vec<f64>>());
    coordinates.chain([solution.final_cost]).map(f64::to_bits).collect()
}

#[test]
fn poses_are_the_same_on_any_number_of_threads() {
    for name in ["manhattan", "sphere2500"] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let graph = g2o::read(path).unwrap();
        let all: Vec<Vec<u64>> = [1, 2, 4]
            .into_iter()
            .map(|threads| match &graph {
                AnyGraph::Two(graph) => bits(graph, threads),
                AnyGraph::Three(graph) => bits(graph, threads),
            })
            .collect();
        assert!(all[0] == all[1] && all[0] == all[2], "{name}");
    }
}

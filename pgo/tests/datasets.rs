//! Published data sets against the best costs known for them.

mod common;

use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Method, PoseGraph, SolveParams, solve};

fn final_cost(name: &str, method: Method) -> Option<f64> {
    let path = common::data(&format!("pgo/{name}.g2o"))?;
    let params = SolveParams { method, ..SolveParams::default() };
    Some(match g2o::read(path).unwrap() {
        AnyGraph::Two(graph) => checked(graph, &params),
        AnyGraph::Three(graph) => checked(graph, &params),
    })
}

/// The cost as the solver reports it, after checking that the graph itself agrees.
fn checked<const N: usize, G: draco_lie::LieGroup<N>>(
    mut graph: PoseGraph<G, N>,
    params: &SolveParams,
) -> f64 {
    let solution = solve(&graph, params).unwrap();
    graph.update(&solution);
    assert!((graph.cost() - solution.final_cost).abs() <= 1e-9 * solution.final_cost);
    solution.final_cost
}

fn reaches(name: &str, best: f64) {
    for method in [Method::GaussNewton, Method::LevenbergMarquardt] {
        let Some(cost) = final_cost(name, method) else { return };
        assert!(cost <= best * (1.0 + 1e-6), "{name} by {method:?}: {cost} instead of {best}");
    }
}

#[test]
fn intel_is_solved_from_the_file() {
    reaches("intel", 22.502116);
}

#[test]
fn sphere2500_is_solved_from_the_file() {
    reaches("sphere2500", 675.70096);
}

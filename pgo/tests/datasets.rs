//! Published data sets against the best costs known for them.

mod common;

use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Method, PoseGraph, SolveParams, Start, solve};

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

/// Best costs known.
const BEST: [(&str, f64); 10] = [
    ("tinyGrid3D", 9.3139094),
    ("smallGrid3D", 517.92533),
    ("CSAIL", 20.275442),
    ("MIT", 20.603474),
    ("intel", 22.502116),
    ("manhattan", 1774.5205),
    ("parking-garage", 0.6341924),
    ("sphere2500", 675.70096),
    ("torus3D", 12117.637),
    ("sphere_bignoise_vertex3", 1494168.8),
];

#[test]
fn all_sets_are_solved_from_the_file() {
    for (name, best) in BEST {
        let small = ["tinyGrid3D", "smallGrid3D", "MIT", "intel"].contains(&name);
        let others: &[Method] = if small { &[Method::GaussNewton, Method::Dogleg] } else { &[] };
        for method in [&[Method::default()], others].concat() {
            let Some(cost) = final_cost(name, method) else { return };
            assert!(cost <= best * (1.0 + 1e-6), "{name} by {method:?}: {cost} instead of {best}");
        }
    }
}

#[test]
fn only_a_bad_start_is_left_for_the_relaxation() {
    for (name, restarted) in [("MIT", true), ("intel", false)] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let AnyGraph::Two(graph) = g2o::read(path).unwrap() else { unreachable!("a set in the plane") };
        let found = solve(&graph, &SolveParams::default()).unwrap();
        assert_eq!(found.restarted, restarted, "{name}");
        let given = solve(&graph, &SolveParams { start: Start::Given, ..SolveParams::default() }).unwrap();
        assert!(!given.restarted);
        assert_eq!(given.final_cost > 2.0 * found.final_cost, restarted, "{name}: {}", given.final_cost);
    }
}

#[test]
fn all_sets_are_solved_from_the_chordal_start() {
    for (name, best) in BEST {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let cost = match g2o::read(path).unwrap() {
            AnyGraph::Two(mut graph) => {
                draco_pgo::chordal(&mut graph).unwrap();
                checked(graph, &SolveParams::default())
            }
            AnyGraph::Three(mut graph) => {
                draco_pgo::chordal(&mut graph).unwrap();
                checked(graph, &SolveParams::default())
            }
        };
        assert!(cost <= best * (1.0 + 1e-6), "{name}: {cost} instead of {best}");
    }
}

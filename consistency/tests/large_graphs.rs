//! Graphs too large for the search end at the budget, with a clique and a bound.

mod common;

use std::time::Duration;

use common::rng;
use cpu_time::ProcessTime;
use draco_consistency::Error;
use draco_consistency::clique::{self, Budget, Incremental};
use draco_consistency::graph::{Adjacency, Graph, SparseGraph, random};
use rand::RngExt;

/// CPU time that a search may take with a budget of 0.2 s, in a slow build: the last step is not cut short.
const LONGEST: Duration = Duration::from_secs(8);

fn within_budget(graph: &Graph) {
    let budget = Budget::time(Duration::from_millis(200));
    let start = ProcessTime::now();
    let largest = clique::maximum(graph, &budget);
    assert!(start.elapsed() < LONGEST, "largest: {:?}", start.elapsed());
    assert!(graph.is_clique(&largest.vertices) && largest.value <= largest.upper_bound);
    let start = ProcessTime::now();
    let heaviest = clique::maximum_weight(graph, &budget);
    assert!(start.elapsed() < LONGEST, "heaviest: {:?}", start.elapsed());
    assert!(graph.is_clique(&heaviest.vertices) && heaviest.value <= heaviest.upper_bound);
}

#[test]
fn a_dense_random_graph_of_ten_thousand_keeps_its_budget() {
    within_budget(&random(10_000, 0.5, &mut rng(1)).unwrap());
}

#[test]
fn a_nearly_complete_graph_of_six_thousand_keeps_its_budget() {
    let mut graph = Graph::new(6_000).unwrap();
    for a in 0..graph.len() {
        (a + 1..graph.len()).filter(|b| b / 3 != a / 3).for_each(|b| drop(graph.add_edge(a, b)));
    }
    within_budget(&graph);
}

/// Vertices of which each lacks a few others, weights 1 to 200.
fn weighed_near_clique(n: usize) -> Graph {
    let mut rng = rng(2);
    let mut graph = Graph::new(n).unwrap();
    for a in 0..n {
        graph.set_weight(a, (a * 37 % 200 + 1) as f64).unwrap();
        (0..a).filter(|_| rng.random_bool(0.998)).for_each(|b| drop(graph.add_edge(a, b)));
    }
    graph
}

#[test]
fn weighed_near_cliques_of_thousands_keep_their_budget() {
    for n in [1_500, 4_400] {
        within_budget(&weighed_near_clique(n));
    }
}

#[test]
fn a_dense_graph_of_a_million_is_refused() {
    let too_many = Error::TooManyVertices { vertices: 1_000_000, limit: Graph::MAX_VERTICES };
    assert_eq!(Graph::new(1_000_000), Err(too_many.clone()));
    assert_eq!(random(1_000_000, 0.9, &mut rng(1)), Err(too_many.clone()));
    let sparse = SparseGraph::from_edges(1_000_000, [(0, 999_999)]).unwrap();
    assert_eq!(Graph::from_sparse(&sparse), Err(too_many));
}

#[test]
fn a_dense_core_in_a_million_vertices_is_found() {
    // A long ring, and among its first vertices a core of 400 in which each lacks two others.
    let n = 1_000_000;
    let core = (0..400).flat_map(|a| (a + 1..400).map(move |b| (a, b))).filter(|(a, b)| a / 3 != b / 3);
    let graph = SparseGraph::from_edges(n, core.chain((0..n).map(|v| (v, (v + 1) % n)))).unwrap();
    let found = clique::maximum(&graph, &Budget::UNLIMITED);
    assert!(found.optimal && graph.is_clique(&found.vertices));
    // Two of each triple, which the ring joins, and the odd vertex.
    assert_eq!(found.value, 133 * 2 + 1);
}

#[test]
fn a_graph_that_grows_too_large_is_refused_and_stays_sound() {
    let mut cliques = Incremental::new(Budget::nodes(10));
    for _ in 0..300 {
        cliques.insert(&[]).unwrap();
    }
    assert!(matches!(cliques.insert(&[300]), Err(Error::UnknownVertex { vertex: 300, .. })));
    assert_eq!((cliques.graph().len(), cliques.best().value), (300, 1));
}

#[test]
fn a_step_through_more_vertices_than_one_search_takes_is_exact() {
    let (core, mut cliques) = (4_100, Incremental::new(Budget::UNLIMITED));
    for v in 0..core {
        cliques.insert(&(0..v).collect::<Vec<_>>()).unwrap();
    }
    // Each of these could stand in for one vertex of the core, so none makes the clique larger.
    for apart in 0..3 {
        let near: Vec<usize> = (0..core + apart).filter(|&v| v != apart).collect();
        let best = cliques.insert(&near).unwrap();
        assert_eq!((best.value, best.optimal), (core, true));
    }
    let all: Vec<usize> = (3..core + 3).collect();
    assert_eq!(cliques.insert(&all).unwrap().value, core + 1);
}

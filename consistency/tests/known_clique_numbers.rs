//! The clique numbers of the DIMACS and Network Repository graphs, proved again.

mod common;

use common::data;
use draco_consistency::clique::{self, Budget};
use draco_consistency::graph::{Adjacency, Graph, read_dimacs, read_matrix_market};

/// Name, clique number, weight of the heaviest clique for weights `(i mod 200) + 1`, whether a debug build solves
/// both within seconds.
const KNOWN: [(&str, usize, u32, Speed); 31] = [
    ("johnson8-2-4", 4, 66, Speed::Both),
    ("johnson8-4-4", 14, 511, Speed::Both),
    ("johnson16-2-4", 8, 548, Speed::Both),
    ("MANN_a9", 16, 372, Speed::Both),
    ("MANN_a27", 126, 12283, Speed::Size),
    ("hamming6-2", 32, 1072, Speed::Both),
    ("hamming6-4", 4, 134, Speed::Both),
    ("hamming8-2", 128, 10976, Speed::Both),
    ("hamming8-4", 16, 1472, Speed::Both),
    ("c-fat200-1", 12, 1284, Speed::Both),
    ("c-fat200-5", 58, 5887, Speed::Both),
    ("c-fat500-10", 126, 11586, Speed::Both),
    ("C125.9", 34, 2529, Speed::Both),
    ("brock200_1", 21, 2821, Speed::Both),
    ("brock200_2", 12, 1428, Speed::Both),
    ("brock200_3", 15, 2062, Speed::Both),
    ("brock400_2", 29, 3350, Speed::Neither),
    ("p_hat300-1", 8, 1057, Speed::Both),
    ("p_hat300-2", 25, 2487, Speed::Both),
    ("p_hat300-3", 36, 3774, Speed::Both),
    ("p_hat500-1", 9, 1231, Speed::Both),
    ("p_hat500-2", 36, 3920, Speed::Both),
    ("p_hat700-1", 11, 1441, Speed::Both),
    ("san200_0.7_1", 30, 3370, Speed::Both),
    ("san200_0.7_2", 18, 2422, Speed::Both),
    ("san200_0.9_1", 70, 6825, Speed::Both),
    ("san200_0.9_2", 60, 6082, Speed::Both),
    ("sanr200_0.7", 18, 2325, Speed::Both),
    ("sanr400_0.5", 13, 1835, Speed::Both),
    ("gen200_p0.9_55", 55, 5416, Speed::Both),
    ("san400_0.5_1", 13, 1455, Speed::Both),
];

#[derive(Clone, Copy, PartialEq)]
enum Speed {
    Both,
    Size,
    Neither,
}

fn graph(name: &str) -> Option<Graph> {
    let path = data(&format!("maxclique/dimacs/{name}.clq"))?;
    let graph = Graph::from_sparse(&read_dimacs(&path).unwrap()).unwrap();
    let weights: Vec<f64> = (1..=graph.len()).map(|i| (i % 200 + 1) as f64).collect();
    Some(graph.with_weights(&weights).unwrap())
}

fn check_size(name: &str, expected: usize) {
    let Some(graph) = graph(name) else { return };
    let found = clique::maximum(&graph, &Budget::UNLIMITED);
    assert_eq!((found.value, found.optimal), (expected, true), "{name}");
    assert!(graph.is_clique(&found.vertices));
}

fn check_weight(name: &str, expected: u32) {
    let Some(graph) = graph(name) else { return };
    let found = clique::maximum_weight(&graph, &Budget::UNLIMITED);
    assert_eq!((found.value, found.optimal), (f64::from(expected), true), "{name}");
    assert!(graph.is_clique(&found.vertices));
}

#[test]
fn clique_numbers_are_proved() {
    KNOWN.iter().filter(|k| k.3 != Speed::Neither).for_each(|k| check_size(k.0, k.1));
}

#[test]
fn heaviest_cliques_are_proved() {
    KNOWN.iter().filter(|k| k.3 == Speed::Both).for_each(|k| check_weight(k.0, k.2));
}

#[test]
#[ignore = "minutes: all graphs, counted and weighed"]
fn all_graphs_are_proved() {
    for (name, size, weight, _) in KNOWN {
        check_size(name, size);
        check_weight(name, weight);
    }
}

#[test]
fn sparse_graphs_are_proved() {
    for (name, expected) in [("web-edu", 30), ("web-spam", 20)] {
        let Some(path) = data(&format!("maxclique/sparse/{name}.mtx")) else { return };
        let graph = read_matrix_market(&path).unwrap();
        let found = clique::maximum(&graph, &Budget::UNLIMITED);
        assert_eq!((found.value, found.optimal), (expected, true), "{name}");
        let dense = clique::maximum_weight(&Graph::from_sparse(&graph).unwrap(), &Budget::UNLIMITED);
        assert_eq!(dense.value, expected as f64, "{name}");
    }
}

#[test]
fn a_spent_budget_leaves_a_clique_and_an_upper_bound() {
    let Some(graph) = graph("brock400_2") else { return };
    let found = clique::maximum(&graph, &Budget::nodes(100));
    assert!(!found.optimal && found.value < found.upper_bound && found.upper_bound >= 29);
    assert!(found.value >= 20 && graph.is_clique(&found.vertices));
    let weighted = clique::maximum_weight(&graph, &Budget::nodes(100));
    assert!(!weighted.optimal && weighted.upper_bound >= 3350.0 && weighted.value > 2000.0);
}

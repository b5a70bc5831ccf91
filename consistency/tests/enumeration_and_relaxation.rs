//! All maximal cliques against a test of every subset; the relaxation and generators on planted graphs.

mod common;

use common::{random_graph, rng};
use draco_consistency::clique::{self, Budget};
use draco_consistency::graph::{Adjacency, Graph, PlantedParams, SparseGraph, planted};
use draco_consistency::relaxed::{Affinity, Params, densest};
use rand::RngExt;

fn maximal_subsets(graph: &Graph) -> Vec<Vec<usize>> {
    let n = graph.len();
    let members = |set: u32| (0..n).filter(|&v| set >> v & 1 == 1).collect::<Vec<_>>();
    let is_clique = |set: u32| graph.is_clique(&members(set));
    (1u32..1 << n)
        .filter(|&set| is_clique(set) && (0..n).all(|v| set >> v & 1 == 1 || !is_clique(set | 1 << v)))
        .map(members)
        .collect()
}

#[test]
fn all_maximal_and_all_maximum_cliques_are_found_once() {
    for seed in 0..200 {
        let mut rng = rng(seed);
        let n = rng.random_range(0..11);
        let density = rng.random_range(0.0..=1.0);
        let graph = random_graph(n, density, &mut rng);
        let mut expected = maximal_subsets(&graph);
        let mut found: Vec<Vec<usize>> = clique::maximal(&graph).collect();
        expected.sort();
        found.sort();
        assert_eq!(found, expected, "seed {seed}");
        let size = expected.iter().map(Vec::len).max().unwrap_or(0);
        let mut largest: Vec<Vec<usize>> = clique::all_maximum(&graph).collect();
        largest.sort();
        expected.retain(|c| c.len() == size);
        assert_eq!(largest, expected, "seed {seed}");
    }
}

#[test]
fn the_relaxation_recovers_a_planted_clique() {
    for seed in 0..10 {
        let mut rng = rng(seed);
        let params = PlantedParams { vertices: 150, planted: 30, inner: 1.0, outer: 0.15 };
        let sample = planted(&params, &mut rng).unwrap();
        let mut pairs = Vec::new();
        for a in 0..150 {
            for b in sample.graph.neighbors(a).filter(|&b| b > a) {
                let good = sample.is_planted_edge(a, b);
                pairs.push((
                    a,
                    b,
                    if good { rng.random_range(0.6..=1.0) } else { rng.random_range(0.01..0.9) },
                ));
            }
        }
        let found = densest(&Affinity::from_pairs(150, &pairs).unwrap(), &Params::default());
        let expected: Vec<usize> = (0..150).filter(|&v| sample.planted[v]).collect();
        let kept = found.clique.iter().filter(|v| expected.contains(v)).count();
        assert!(kept >= 29 && kept + 1 >= found.clique.len(), "seed {seed}: {kept}");
        assert!(found.support.len() >= 15);
    }
}

#[test]
fn near_clique_of_a_thousand_closures_is_solved() {
    let sample =
        planted(&PlantedParams { vertices: 600, planted: 150, ..PlantedParams::default() }, &mut rng(1));
    let sample = sample.unwrap();
    let found = clique::maximum(&sample.graph, &Budget::UNLIMITED);
    assert!(found.optimal && found.value > 60);
    assert!(found.vertices.iter().filter(|&&v| sample.planted[v]).count() + 1 >= found.value);
}

#[test]
fn a_million_vertices_are_no_trouble() {
    let n = 1_000_000;
    let ring = (0..n).map(|v| (v, (v + 1) % n));
    let graph = SparseGraph::from_edges(n, ring.chain([(5, 7), (5, 8), (6, 8)])).unwrap();
    let found = clique::maximum(&graph, &Budget::UNLIMITED);
    assert_eq!((found.vertices, found.optimal), (vec![5, 6, 7, 8], true));
    let weighted = clique::maximum_weight(&graph, &Budget::UNLIMITED);
    assert_eq!((weighted.vertices, weighted.optimal), (vec![5, 6, 7, 8], true));
    let empty = clique::maximum(&SparseGraph::from_edges(n, []).unwrap(), &Budget::UNLIMITED);
    assert_eq!(empty.value, 1);
}

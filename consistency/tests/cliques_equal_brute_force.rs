//! Cliques of random graphs against an enumeration that shares no code with the crate.

mod common;

use common::{brute_force_weight, random_graph, rng};
use draco_consistency::clique::{self, Budget};
use draco_consistency::graph::{Adjacency, Graph};
use rand::RngExt;

/// Random graphs a claim.
const TRIALS: u64 = 10_000;

fn sample(seed: u64) -> Graph {
    let mut rng = rng(seed);
    let n = rng.random_range(0..=40);
    let density = [0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0][rng.random_range(0..9)];
    random_graph(n, density, &mut rng)
}

#[test]
fn largest_cliques_equal_brute_force() {
    for seed in 0..TRIALS {
        let graph = sample(seed);
        let found = clique::maximum(&graph, &Budget::UNLIMITED);
        let expected = brute_force_weight(&graph, &vec![1; graph.len()]) as usize;
        assert_eq!(
            (found.value, found.upper_bound, found.optimal),
            (expected, expected, true),
            "seed {seed}"
        );
        assert!(found.vertices.len() == expected && graph.is_clique(&found.vertices));
    }
}

#[test]
fn heaviest_cliques_equal_brute_force() {
    for seed in 0..TRIALS {
        let graph = sample(seed);
        let mut rng = rng(seed ^ 0xabcdef);
        let largest = [1, 3, 20, 1000][rng.random_range(0..4)];
        let weights: Vec<u64> = (0..graph.len()).map(|_| rng.random_range(0..=largest)).collect();
        let scaled: Vec<f64> = weights.iter().map(|&w| w as f64 * 0.25).collect();
        let graph = graph.with_weights(&scaled).unwrap();
        let found = clique::maximum_weight(&graph, &Budget::UNLIMITED);
        let expected = brute_force_weight(&graph, &weights) as f64 * 0.25;
        assert_eq!(
            (found.value, found.upper_bound, found.optimal),
            (expected, expected, true),
            "seed {seed}"
        );
        assert!(graph.is_clique(&found.vertices));
        assert_eq!(graph.total_weight(&found.vertices), expected);
    }
}

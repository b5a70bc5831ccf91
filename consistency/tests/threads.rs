//! The feature `rayon` changes how long a search takes and nothing else.
#![cfg(feature = "rayon")]

mod common;

use common::{random_graph, rng};
use draco_consistency::clique::{self, Budget};
use draco_consistency::graph::{PlantedParams, planted};
use rand::RngExt;

/// The same on one, two and four threads, and on four again.
fn same<T: PartialEq + std::fmt::Debug + Send>(name: &str, search: impl Fn() -> T + Sync) {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(&search)
    };
    let one = on(1);
    for threads in [2, 4, 4] {
        assert_eq!(on(threads), one, "{name}, {threads} threads");
    }
}

#[test]
fn largest_cliques_are_the_same_on_any_number_of_threads() {
    for seed in 0..12 {
        let density = [0.3, 0.5, 0.7, 0.85][seed as usize % 4];
        let graph = random_graph(140, density, &mut rng(seed));
        same(&format!("seed {seed}"), || {
            let found = clique::maximum(&graph, &Budget::UNLIMITED);
            assert!(found.optimal);
            found.vertices
        });
    }
}

#[test]
fn heaviest_cliques_are_the_same_on_any_number_of_threads() {
    for seed in 0..12 {
        let mut rng = rng(seed);
        let density = [0.3, 0.5, 0.7, 0.85][seed as usize % 4];
        let graph = random_graph(120, density, &mut rng);
        // Small weights, so that many cliques are equally heavy.
        let weights: Vec<f64> = (0..120).map(|_| f64::from(rng.random_range(1..4))).collect();
        let graph = graph.with_weights(&weights).unwrap();
        same(&format!("seed {seed}"), || {
            let found = clique::maximum_weight(&graph, &Budget::UNLIMITED);
            assert!(found.optimal);
            found.vertices
        });
    }
}

#[test]
fn near_cliques_are_the_same_on_any_number_of_threads() {
    for seed in 0..4 {
        let params = PlantedParams { vertices: 300, planted: 120, inner: 0.96, outer: 0.1 };
        let graph = planted(&params, &mut rng(seed)).unwrap().graph;
        same(&format!("seed {seed}"), || {
            let found = clique::maximum(&graph, &Budget::UNLIMITED);
            assert!(found.optimal);
            found.vertices
        });
    }
}

#[test]
fn near_cliques_that_are_split_into_parts_are_the_same_on_any_number_of_threads() {
    for seed in 0..2 {
        let params = PlantedParams { vertices: 320, planted: 300, inner: 0.98, outer: 0.1 };
        let graph = planted(&params, &mut rng(seed)).unwrap().graph;
        // More nodes than a search that is not split may have.
        assert!(clique::maximum(&graph, &Budget::UNLIMITED).nodes > 2000, "seed {seed}");
        same(&format!("seed {seed}"), || clique::maximum(&graph, &Budget::UNLIMITED).vertices);
    }
}

#[test]
#[ignore = "a minute: millions of nodes"]
fn long_searches_are_the_same_on_any_number_of_threads() {
    let graph = random_graph(300, 0.72, &mut rng(3));
    same("long", || {
        let found = clique::maximum(&graph, &Budget::UNLIMITED);
        assert!(found.optimal && found.nodes > 500_000, "{}", found.nodes);
        found.vertices
    });
}

//! Hypercliques of random hypergraphs against plain enumeration.

mod common;

use common::rng;
use draco_consistency::clique::Budget;
use draco_consistency::graph::Hypergraph;
use draco_consistency::hyperclique::{self, Incremental};
use rand::{Rng, RngExt};

const TRIALS: u64 = 2_000;

/// Random edges, and on top all `k`-sets of a planted set.
fn sample(order: usize, most: usize, rng: &mut impl Rng) -> (usize, Vec<Vec<usize>>) {
    let n = rng.random_range(0..=most);
    let density = [0.0, 0.05, 0.1, 0.3, 0.6, 0.9, 1.0][rng.random_range(0..if n > 16 { 4 } else { 7 })];
    let planted: Vec<bool> = (0..n).map(|_| rng.random_bool(0.2)).collect();
    let mut edges = Vec::new();
    subsets(n, order, &mut Vec::new(), &mut |set| {
        if set.iter().all(|&v| planted[v]) || rng.random_bool(density) {
            edges.push(set.to_vec());
        }
    });
    (n, edges)
}

fn subsets(n: usize, size: usize, head: &mut Vec<usize>, each: &mut impl FnMut(&[usize])) {
    if size == 0 {
        return each(head);
    }
    for v in head.last().map_or(0, |&last| last + 1)..n {
        head.push(v);
        subsets(n, size - 1, head, each);
        head.pop();
    }
}

/// Grows sets vertex by vertex and tests every new subset against the list of edges.
fn brute_force(n: usize, order: usize, edges: &[Vec<usize>], holding: Option<usize>) -> usize {
    let edges: std::collections::BTreeSet<Vec<usize>> = edges.iter().cloned().collect();
    fn fits(edges: &std::collections::BTreeSet<Vec<usize>>, set: &[usize], v: usize, order: usize) -> bool {
        let mut ok = true;
        subsets(set.len(), order - 1, &mut Vec::new(), &mut |places| {
            let mut edge: Vec<usize> = places.iter().map(|&i| set[i]).collect();
            edge.push(v);
            ok &= edges.contains(&edge);
        });
        ok
    }
    fn go(
        edges: &std::collections::BTreeSet<Vec<usize>>,
        n: usize,
        order: usize,
        set: &mut Vec<usize>,
        best: &mut usize,
    ) {
        *best = (*best).max(set.len());
        for v in set.last().map_or(0, |&last| last + 1)..n {
            if set.len() + (n - v) <= *best {
                return;
            }
            if fits(edges, set, v, order) {
                set.push(v);
                go(edges, n, order, set, best);
                set.pop();
            }
        }
    }
    assert!(holding.is_none());
    let mut best = 0;
    go(&edges, n, order, &mut Vec::new(), &mut best);
    best
}

fn compare(order: usize, most: usize) {
    for seed in 0..TRIALS {
        let mut rng = rng(seed + 1_000_000 * order as u64);
        let (n, edges) = sample(order, most, &mut rng);
        let graph = Hypergraph::from_edges(n, order, &edges).unwrap();
        let found = hyperclique::maximum(&graph, &Budget::UNLIMITED);
        assert!(found.optimal && graph.is_clique(&found.vertices));
        assert_eq!(found.value, brute_force(n, order, &edges, None), "order {order}, seed {seed}");
        assert!(graph.is_clique(&hyperclique::greedy(&graph)));
    }
}

#[test]
fn largest_hypercliques_of_order_3_equal_brute_force() {
    compare(3, 24);
}

#[test]
fn largest_hypercliques_of_order_4_equal_brute_force() {
    compare(4, 16);
}

#[test]
fn largest_hypercliques_of_other_orders_equal_brute_force() {
    compare(2, 16);
    compare(5, 11);
}

#[test]
fn every_step_of_the_incremental_search_equals_the_batch() {
    for seed in 0..40 {
        for order in [3, 4] {
            let mut rng = rng(seed);
            let (n, edges) = sample(order, 16, &mut rng);
            let mut incremental = Incremental::new(order, Budget::UNLIMITED).unwrap();
            for v in 0..n {
                let new = edges.iter().filter(|e| e[order - 1] == v).map(|e| &e[..order - 1]);
                let found = incremental.insert(new).unwrap().clone();
                let batch = hyperclique::maximum(incremental.graph(), &Budget::UNLIMITED);
                assert_eq!((found.value, found.optimal), (batch.value, true));
            }
            let mut left: Vec<usize> = (0..n).collect();
            while !left.is_empty() {
                let v = left.swap_remove(rng.random_range(0..left.len()));
                let found = incremental.remove(v).unwrap().clone();
                let alive: Vec<Vec<usize>> =
                    edges.iter().filter(|e| e.iter().all(|u| left.contains(u))).cloned().collect();
                let expected = brute_force(n, order, &alive, None).max((order - 1).min(left.len()));
                let expected = if left.len() < order { left.len() } else { expected };
                assert_eq!(found.value, expected, "seed {seed}, order {order}");
                assert!(found.vertices.iter().all(|u| left.contains(u)));
            }
        }
    }
}

//! Hypercliques of random hypergraphs against plain enumeration.

mod common;

use common::rng;
use draco_consistency::clique::Budget;
use draco_consistency::graph::Hypergraph;
use draco_consistency::hyperclique::{self, Incremental};
use rand::{Rng, RngExt};

/// Random hypergraphs a claim; the ignored tests take ten thousand.
const TRIALS: u64 = 1_000;

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

/// Grows sets in ascending order by every vertex that forms an edge with each `k-1` of the set; no bound but the
/// number of vertices that are left.
struct BruteForce {
    n: usize,
    order: usize,
    /// For each ascending `k-1` vertices, read as a number of base `n`, the later vertices that complete them.
    later: Vec<u64>,
    best: usize,
}

impl BruteForce {
    fn run(n: usize, order: usize, edges: &[Vec<usize>]) -> usize {
        assert!(n <= 64);
        let mut later = vec![0u64; n.pow(order as u32 - 1)];
        for edge in edges {
            later[place(n, &edge[..order - 1])] |= 1 << edge[order - 1];
        }
        let mut force = Self { n, order, later, best: 0 };
        force.grow(&mut Vec::new(), if n == 64 { u64::MAX } else { (1 << n) - 1 });
        force.best
    }

    fn grow(&mut self, set: &mut Vec<usize>, open: u64) {
        self.best = self.best.max(set.len());
        let mut rest = open;
        while rest != 0 {
            if set.len() + rest.count_ones() as usize <= self.best {
                return;
            }
            let v = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let mut left = rest;
            subsets(set.len(), self.order - 2, &mut Vec::new(), &mut |places| {
                let mut part: Vec<usize> = places.iter().map(|&i| set[i]).collect();
                part.push(v);
                left &= self.later[place(self.n, &part)];
            });
            set.push(v);
            self.grow(set, left);
            set.pop();
        }
    }
}

fn place(n: usize, vertices: &[usize]) -> usize {
    vertices.iter().fold(0, |value, &v| value * n + v)
}

fn compare(order: usize, most: usize, trials: u64) {
    for seed in 0..trials {
        let mut rng = rng(seed + 1_000_000 * order as u64);
        let (n, edges) = sample(order, most, &mut rng);
        let graph = Hypergraph::from_edges(n, order, &edges).unwrap();
        let found = hyperclique::maximum(&graph, &Budget::UNLIMITED);
        assert!(found.optimal && graph.is_clique(&found.vertices));
        assert_eq!(found.value, BruteForce::run(n, order, &edges), "order {order}, seed {seed}");
        assert!(graph.is_clique(&hyperclique::greedy(&graph)));
    }
}

#[test]
#[ignore = "minutes: ten thousand hypergraphs of up to 40 vertices"]
fn ten_thousand_hypercliques_of_order_3_equal_brute_force() {
    compare(3, 40, 10_000);
}

#[test]
#[ignore = "minutes: ten thousand hypergraphs of up to 40 vertices"]
fn ten_thousand_hypercliques_of_order_4_equal_brute_force() {
    compare(4, 40, 10_000);
}

#[test]
fn largest_hypercliques_of_order_3_equal_brute_force() {
    compare(3, 24, TRIALS);
}

#[test]
fn largest_hypercliques_of_order_4_equal_brute_force() {
    compare(4, 16, TRIALS);
}

#[test]
fn largest_hypercliques_of_other_orders_equal_brute_force() {
    compare(2, 16, TRIALS);
    compare(5, 11, TRIALS);
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
                let expected = BruteForce::run(n, order, &alive).max((order - 1).min(left.len()));
                let expected = if left.len() < order { left.len() } else { expected };
                assert_eq!(found.value, expected, "seed {seed}, order {order}");
                assert!(found.vertices.iter().all(|u| left.contains(u)));
            }
        }
    }
}

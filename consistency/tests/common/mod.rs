//! Oracles and data that share no code with the crate.
#![allow(dead_code, unused_imports)]

use draco_consistency::graph::{Adjacency, Graph};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub(crate) fn random_graph(n: usize, density: f64, rng: &mut impl Rng) -> Graph {
    let mut graph = Graph::new(n).unwrap();
    for a in 0..n {
        for b in a + 1..n {
            if rng.random_bool(density) {
                graph.add_edge(a, b).unwrap();
            }
        }
    }
    graph
}

/// Heaviest clique by enumeration over 64-bit masks. `suffix[i]` is the answer for the vertices from `i` on; an open
/// set is left alone when its whole suffix could not improve (Östergård's rule, no colouring).
pub(crate) fn brute_force_weight(graph: &Graph, weights: &[u64]) -> u64 {
    let n = graph.len();
    assert!(n <= 64);
    let rows: Vec<u64> =
        (0..n).map(|a| (0..n).filter(|&b| graph.has_edge(a, b)).fold(0, |row, b| row | 1u64 << b)).collect();
    fn go(rows: &[u64], weights: &[u64], suffix: &[u64], mut open: u64, weight: u64, best: &mut u64) {
        *best = (*best).max(weight);
        while open != 0 {
            let v = open.trailing_zeros() as usize;
            if weight + suffix[v] <= *best {
                return;
            }
            open &= open - 1;
            go(rows, weights, suffix, open & rows[v], weight + weights[v], best);
        }
    }
    let mut suffix = vec![0; n + 1];
    for v in (0..n).rev() {
        let mut best = suffix[v + 1];
        let later = rows[v] & (u64::MAX << v);
        go(&rows, weights, &suffix, later, weights[v], &mut best);
        suffix[v] = best;
    }
    suffix[0]
}

/// A file of the shared data, or `None` with a word on why the test is skipped.
pub(crate) fn data(file: &str) -> Option<std::path::PathBuf> {
    let root = std::env::var_os("DRACO_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        std::path::PathBuf::from,
    );
    let path = root.join(file);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var_os("DRACO_REQUIRE_DATA").is_none(), "{} is missing", path.display());
    println!("skipped: {} is missing; set DRACO_DATA", path.display());
    None
}

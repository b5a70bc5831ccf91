use crate::graph::{Adjacency, degeneracy};

/// A maximal clique found in `O(n + m)` for sparse graphs: from the densest core outwards, each vertex that fits is
/// taken. No promise about its size; use it as a start or when microseconds count.
pub fn greedy<A: Adjacency>(graph: &A) -> Vec<usize> {
    let order = degeneracy(graph).order;
    let mut best = extend(graph, order.iter().rev().copied());
    best.sort_unstable();
    best
}

/// Takes each vertex in turn that is joined to all taken so far.
pub(super) fn extend<A: Adjacency>(graph: &A, order: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut clique: Vec<usize> = Vec::new();
    for v in order {
        if graph.degree(v) >= clique.len() && clique.iter().all(|&u| graph.has_edge(u, v)) {
            clique.push(v);
        }
    }
    clique
}

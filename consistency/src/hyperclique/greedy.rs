use crate::graph::{Hypergraph, bits, hypergraph::Combinations};

/// A maximal hyperclique: from each of the most promising vertices, the vertex that keeps most candidates is taken
/// again and again. No promise about its size.
///
/// Cost `O(s · n · C(s, k-2) · n/64)` a start for a result of `s` vertices, eight starts.
pub fn greedy(graph: &Hypergraph) -> Vec<usize> {
    let n = graph.len();
    let mut degree = vec![0usize; n];
    let mut sets = Combinations::new(n, graph.order() - 1);
    while let Some(set) = sets.next() {
        let edges = bits::count(graph.row(set));
        set.iter().for_each(|&v| degree[v] += edges);
    }
    let mut starts: Vec<usize> = (0..n).collect();
    starts.sort_by_key(|&v| std::cmp::Reverse(degree[v]));
    let mut best = Vec::new();
    for &start in starts.iter().take(STARTS) {
        let found = grow(graph, start, &degree);
        if found.len() > best.len() {
            best = found;
        }
    }
    best.sort_unstable();
    best
}

const STARTS: usize = 8;

fn grow(graph: &Hypergraph, start: usize, degree: &[usize]) -> Vec<usize> {
    let mut all = vec![0; graph.words()];
    (0..graph.len()).for_each(|v| bits::insert(&mut all, v));
    let mut open = narrowed(graph, &[], start, &all);
    let mut chosen = vec![start];
    loop {
        let next = bits::iter(&open)
            .map(|v| (narrowed(graph, &chosen, v, &open), v))
            .max_by_key(|(left, v)| (bits::count(left), degree[*v], std::cmp::Reverse(*v)));
        let Some((left, v)) = next else { return chosen };
        chosen.push(v);
        open = left;
    }
}

/// Candidates that stay when `v` joins `chosen`.
fn narrowed(graph: &Hypergraph, chosen: &[usize], v: usize, open: &[u64]) -> Vec<u64> {
    let mut left = open.to_vec();
    bits::remove(&mut left, v);
    let mut subsets = Combinations::new(chosen.len(), graph.order() - 2);
    let mut set = Vec::with_capacity(graph.order());
    while let Some(places) = subsets.next() {
        set.clear();
        set.extend(places.iter().map(|&i| chosen[i]));
        set.push(v);
        set.sort_unstable();
        left.iter_mut().zip(graph.row(&set)).for_each(|(a, b)| *a &= b);
    }
    left
}

use super::{greedy, search::Search};
use crate::clique::{Budget, Meter, Outcome};
use crate::graph::{Hypergraph, bits};

/// A largest set of vertices of which every `k` are an edge, proved largest unless the budget ends first.
///
/// Sets of fewer than `k` vertices hold no `k` to disagree, so a hypergraph without edges yields `min(n, k-1)`
/// vertices: a result below `k` carries no evidence.
///
/// # Panics
/// If the set found is not a hyperclique, which would be an error of this crate.
///
/// ```
/// use draco_consistency::{clique::Budget, graph::Hypergraph, hyperclique};
/// let edges = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3], [2, 3, 4]];
/// let best = hyperclique::maximum(&Hypergraph::from_edges(5, 3, edges)?, &Budget::UNLIMITED);
/// assert_eq!(best.vertices, [0, 1, 2, 3]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn maximum(graph: &Hypergraph, budget: &Budget) -> Outcome {
    let mut meter = Meter::new(budget);
    let start = greedy(graph);
    let mut all = vec![0; graph.words()];
    (0..graph.len()).for_each(|v| bits::insert(&mut all, v));
    let better = Search::new(graph, all, None, start.len(), &mut meter).run();
    finish(graph, better.unwrap_or(start), graph.len(), &meter)
}

pub(super) fn finish(graph: &Hypergraph, mut best: Vec<usize>, upper: usize, meter: &Meter) -> Outcome {
    best.sort_unstable();
    assert!(graph.is_clique(&best), "the set found is not a hyperclique");
    let value = best.len();
    let upper_bound = if meter.stopped { upper.max(value) } else { value };
    Outcome { value, upper_bound, optimal: upper_bound == value, vertices: best, nodes: meter.nodes }
}

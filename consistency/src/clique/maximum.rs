use super::budget::{Budget, Meter};
use super::fixed_point::FixedPoint;
use super::greedy::extend;
use super::ordering::core_first;
use super::outcome::Outcome;
use super::rows::{BitMatrix, MAX_WORDS, with_width};
use super::{search, weighted_search};
use crate::graph::{Adjacency, Degeneracy, degeneracy};

/// A largest clique, proved largest unless the budget ends first.
///
/// # Panics
/// If the set found is not a clique, which would be an error of this crate.
///
/// ```
/// use draco_consistency::{clique, graph::Graph};
/// let graph = Graph::from_edges(5, [(0, 1), (1, 2), (2, 0), (2, 3), (3, 4)])?;
/// let best = clique::maximum(&graph, &clique::Budget::UNLIMITED);
/// assert_eq!(best.vertices, [0, 1, 2]);
/// assert!(best.optimal && best.upper_bound == 3);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn maximum<A: Adjacency>(graph: &A, budget: &Budget) -> Outcome {
    let mut meter = Meter::new(budget);
    let cores = degeneracy(graph);
    let mut best = extend(graph, cores.order.iter().rev().copied());
    let upper = cores.core.iter().max().map_or(0, |core| core + 1);
    let improve = |vertices: &[usize], best: &mut Vec<usize>, meter: &mut Meter| {
        let matrix = BitMatrix::induced(graph, vertices);
        let order = core_first(&matrix);
        let sorted = matrix.select(&order);
        let lower = best.len();
        if let Some(found) = with_width!(sorted.words, size_search(&sorted, lower, meter)) {
            *best = found.into_iter().map(|v| vertices[order[v]]).collect();
        }
    };
    let kept: Vec<usize> = (0..graph.len()).filter(|&v| cores.core[v] >= best.len()).collect();
    if kept.len() <= 64 * MAX_WORDS {
        improve(&kept, &mut best, &mut meter);
    } else {
        by_vertex(graph, &cores, &mut best, &mut meter);
    }
    finish(graph, best, upper, &meter)
}

fn size_search<const W: usize>(matrix: &BitMatrix, lower: usize, meter: &mut Meter) -> Option<Vec<usize>> {
    search::search::<W>(matrix, lower, meter)
}

/// Splits a graph too large for one search: each vertex with its later neighbours in the degeneracy order.
fn by_vertex<A: Adjacency>(graph: &A, cores: &Degeneracy, best: &mut Vec<usize>, meter: &mut Meter) {
    let mut place = vec![0; graph.len()];
    cores.order.iter().enumerate().for_each(|(i, &v)| place[v] = i);
    for &v in cores.order.iter().rev() {
        if cores.core[v] < best.len() {
            continue;
        }
        if !meter.look() {
            return;
        }
        let later: Vec<usize> =
            graph.neighbors(v).filter(|&u| place[u] > place[v] && cores.core[u] >= best.len()).collect();
        if later.len() < best.len() {
            continue;
        }
        let matrix = BitMatrix::induced(graph, &later);
        let order = core_first(&matrix);
        let sorted = matrix.select(&order);
        if let Some(found) = with_width!(sorted.words, size_search(&sorted, best.len() - 1, meter)) {
            *best = found.into_iter().map(|u| later[order[u]]).chain([v]).collect();
        }
    }
}

fn finish<A: Adjacency>(graph: &A, mut best: Vec<usize>, upper: usize, meter: &Meter) -> Outcome {
    best.sort_unstable();
    assert!(graph.is_clique(&best), "the set found is not a clique");
    let value = best.len();
    let upper_bound = if meter.stopped { upper.max(value) } else { value };
    Outcome { value, upper_bound, optimal: upper_bound == value, vertices: best, nodes: meter.nodes }
}

/// A clique of largest total weight, proved heaviest unless the budget ends first.
///
/// Weights are the graph's vertex weights. The search counts in integers of a common power of two, so it is exact
/// for integers (and their halves, quarters, ...) whose sum stays below 2^52, and otherwise within
/// `n · 2^-51` of the total.
///
/// # Panics
/// If the set found is not a clique, which would be an error of this crate.
pub fn maximum_weight<A: Adjacency>(graph: &A, budget: &Budget) -> Outcome<f64> {
    let mut meter = Meter::new(budget);
    let scale = FixedPoint::for_weights((0..graph.len()).map(|v| graph.weight(v)));
    let vertices: Vec<usize> = (0..graph.len()).collect();
    let matrix = BitMatrix::induced(graph, &vertices);
    let mut order = core_first(&matrix);
    order.sort_by(|&a, &b| graph.weight(b).total_cmp(&graph.weight(a)));
    let sorted = matrix.select(&order);
    let weights: Vec<u64> = order.iter().map(|&v| scale.to_integer(graph.weight(v))).collect();
    let found =
        with_width!(sorted.words, weight_search(&sorted, &weights, 0, &mut meter)).unwrap_or_default();
    let mut best: Vec<usize> = found.into_iter().map(|v| order[v]).collect();
    best.sort_unstable();
    assert!(graph.is_clique(&best), "the set found is not a clique");
    let value = graph.total_weight(&best);
    let upper_bound = if meter.stopped { scale.to_weight(weights.iter().sum()) } else { value };
    Outcome { value, upper_bound, optimal: !meter.stopped, vertices: best, nodes: meter.nodes }
}

fn weight_search<const W: usize>(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    weighted_search::search::<W>(matrix, weights, lower, meter)
}

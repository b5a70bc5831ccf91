use std::cmp::Reverse;

use super::budget::{Budget, Meter};
use super::dense;
use super::fixed_point::FixedPoint;
use super::greedy::extend;
use super::later::Later;
use super::outcome::Outcome;
use super::rows::MAX_WORDS;
use crate::graph::{Adjacency, Degeneracy, bit_matrix::BitMatrix, degeneracy_while};

/// A largest clique, proved largest unless the budget ends first.
///
/// Vertices whose core number is too small go first; what is left is searched in bit rows, by colouring with
/// infra-chromatic bounds, or through its complement if few edges are missing.
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
    let cores = degeneracy_while(graph, || meter.look());
    let start = extend(graph, cores.order.iter().rev().copied());
    let upper = cores.core.iter().max().map_or(0, |core| core + 1);
    let better = larger(graph, &cores, start.len(), upper, &mut meter);
    let best = better.unwrap_or(start);
    let upper = if meter.stopped {
        // Larger cliques are among vertices of large core numbers.
        let kept: Vec<usize> = (0..graph.len()).filter(|&v| cores.core[v] >= best.len()).collect();
        upper
            .min(colour_bound(graph, &kept, &vec![1; kept.len()], upper as u64).max(best.len() as u64)
                as usize)
    } else {
        upper
    };
    finish(graph, best, upper, &meter)
}

/// Upper bound of the weight of cliques within `kept`, no more than `upper`.
fn colour_bound<A: Adjacency>(graph: &A, kept: &[usize], weights: &[u64], upper: u64) -> u64 {
    if kept.len() > DENSE_LIMIT {
        return upper;
    }
    dense::bound(&BitMatrix::induced(graph, kept), weights).min(upper)
}

/// Largest graph searched as a whole.
pub(super) const DENSE_LIMIT: usize = 64 * MAX_WORDS;

/// The same as [`larger`] for a graph whose cores are not known.
pub(super) fn larger_of<A: Adjacency>(
    graph: &A,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let cores = degeneracy_while(graph, || meter.look());
    larger(graph, &cores, lower, enough, meter)
}

/// A clique of more than `lower` vertices: the largest, or one of at least `enough`; or `None`.
fn larger<A: Adjacency>(
    graph: &A,
    cores: &Degeneracy,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let kept: Vec<usize> = cores.order.iter().rev().copied().filter(|&v| cores.core[v] >= lower).collect();
    if kept.len() <= DENSE_LIMIT {
        let (matrix, ones) = (BitMatrix::induced(graph, &kept), vec![1; kept.len()]);
        let found = dense::heavier_in_order(&matrix, &ones, lower as u64, enough as u64, meter)?;
        return Some(found.into_iter().map(|v| kept[v]).collect());
    }
    // Too large for one search: each vertex with those that come later in the degeneracy order.
    let (mut best, mut known) = (None, lower);
    let mut later = Later::new(graph, &cores.order);
    for &v in cores.order.iter().rev() {
        if known >= enough || !meter.look() {
            break;
        }
        let around = later.of(v, |u| cores.core[u] >= known);
        if cores.core[v] < known || around.len() < known.max(1) {
            continue;
        }
        let rest = known.saturating_sub(1);
        let found = if around.len() <= DENSE_LIMIT {
            let ones = vec![1; around.len()];
            dense::heavier(&later.matrix(&around), &ones, rest as u64, enough as u64 - 1, meter)
        } else if later.is_dense(&around) {
            larger_of(&later.matrix(&around), rest, enough - 1, meter)
        } else {
            larger_of(&later.sparse(&around), rest, enough - 1, meter)
        };
        if let Some(found) = found {
            known = found.len() + 1;
            best = Some(found.into_iter().map(|u| around[u]).chain([v]).collect());
        }
    }
    best
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
    let n = graph.len();
    let scale = FixedPoint::for_weights((0..n).map(|v| graph.weight(v)));
    let weights: Vec<u64> = (0..n).map(|v| scale.to_integer(graph.weight(v))).collect();
    let total = |vertices: &[usize]| vertices.iter().map(|&v| weights[v]).sum::<u64>();
    let around = |v: usize| weights[v] + graph.neighbors(v).map(|u| weights[u]).sum::<u64>();

    let mut by_weight: Vec<usize> = (0..n).collect();
    by_weight.sort_by_key(|&v| Reverse(around(v)));
    let start = extend(graph, by_weight.iter().copied());
    let upper = (0..n).map(around).max().unwrap_or(0);
    let better = heavier(graph, &weights, total(&start), &mut meter);
    let mut best = better.unwrap_or(start);
    best.sort_unstable();
    assert!(graph.is_clique(&best), "the set found is not a clique");
    let value = graph.total_weight(&best);
    let upper_bound = if meter.stopped {
        let known = total(&best);
        let kept: Vec<usize> = (0..n).filter(|&v| weights[v] > 0 && around(v) > known).collect();
        let own: Vec<u64> = kept.iter().map(|&v| weights[v]).collect();
        scale.to_weight(colour_bound(graph, &kept, &own, upper)).max(value)
    } else {
        value
    };
    Outcome { value, upper_bound, optimal: upper_bound == value, vertices: best, nodes: meter.nodes }
}

/// The heaviest clique if heavier than `lower`.
pub(super) fn heavier<A: Adjacency>(
    graph: &A,
    weights: &[u64],
    lower: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let pick = |vertices: &[usize]| vertices.iter().map(|&v| weights[v]).collect::<Vec<u64>>();
    let around = |v: usize| weights[v] + graph.neighbors(v).map(|u| weights[u]).sum::<u64>();
    let kept: Vec<usize> = (0..graph.len()).filter(|&v| weights[v] > 0 && around(v) > lower).collect();
    if kept.len() <= DENSE_LIMIT {
        let found = dense::heavier(&BitMatrix::induced(graph, &kept), &pick(&kept), lower, u64::MAX, meter)?;
        return Some(found.into_iter().map(|v| kept[v]).collect());
    }
    let order = degeneracy_while(graph, || meter.look()).order;
    let (mut best, mut known) = (None, lower);
    let mut later = Later::new(graph, &order);
    for &v in order.iter().rev() {
        if !meter.look() {
            break;
        }
        let around = later.of(v, |_| true);
        let available = pick(&around);
        if weights[v] + available.iter().sum::<u64>() <= known {
            continue;
        }
        // Without this vertex the rest must be heavier than what is missing; nothing is missing if it alone is.
        let rest = known.saturating_sub(weights[v]);
        let found = if around.len() <= DENSE_LIMIT {
            dense::heavier(&later.matrix(&around), &available, rest, u64::MAX, meter)
        } else if later.is_dense(&around) {
            heavier(&later.matrix(&around), &available, rest, meter)
        } else {
            heavier(&later.sparse(&around), &available, rest, meter)
        };
        let found = found.or_else(|| (weights[v] > known).then(Vec::new));
        if let Some(found) = found {
            let clique: Vec<usize> = found.into_iter().map(|u| around[u]).chain([v]).collect();
            known = pick(&clique).iter().sum();
            best = Some(clique);
        }
    }
    best
}

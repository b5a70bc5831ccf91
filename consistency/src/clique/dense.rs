//! Largest and heaviest cliques of graphs that fit into bit rows: reduction, start, choice of the search.

use super::budget::Meter;
use super::greedy::extend;
use super::local_search;
use super::rows::{BitMatrix, with_width};
use super::{by_vertex, complement_search, weighted_search};
use crate::graph::{Adjacency, degeneracy};

/// A clique of `matrix` of more than `lower` vertices: the largest, or one of at least `enough`; or `None`.
pub(super) fn larger(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let cores = degeneracy(matrix);
    let mut best: Option<Vec<usize>> = None;
    let mut order: Vec<usize> =
        cores.order.iter().rev().copied().filter(|&v| cores.core[v] >= lower).collect();
    if order.len() <= lower {
        return None;
    }
    let mut reduced = matrix.select(&order);
    let start = extend(&reduced, 0..reduced.n);
    let steps = (LOCAL_STEPS * reduced.n).min(LOCAL_MOVES / (1 + missing_degree(&reduced) as usize));
    let start = local_search::improve(&reduced, &start, steps);
    let mut known = lower;
    if start.len() > lower {
        known = start.len();
        best = Some(start.iter().map(|&v| order[v]).collect());
        if known >= enough {
            return best;
        }
        let kept: Vec<usize> = (0..order.len()).filter(|&i| cores.core[order[i]] >= known).collect();
        reduced = reduced.select(&kept);
        order = kept.into_iter().map(|i| order[i]).collect();
    }
    let found = if missing_degree(&reduced) <= SPARSE_COMPLEMENT {
        with_width!(reduced.words, sparse_complement(&reduced, known, enough, meter))
    } else {
        by_vertex::search(&reduced, known, enough, meter)
    };
    found.map(|clique| clique.into_iter().map(|v| order[v]).collect()).or(best)
}

/// Steps of the local search a vertex, and a limit on what all of them may touch.
const LOCAL_STEPS: usize = 10;
const LOCAL_MOVES: usize = 1_000_000;

/// Average number of missing edges a vertex up to which the complement is searched.
const SPARSE_COMPLEMENT: f64 = 9.0;

fn missing_degree(matrix: &BitMatrix) -> f64 {
    let n = matrix.n as f64;
    if n > 0.0 { n - 1.0 - 2.0 * matrix.edge_count() as f64 / n } else { 0.0 }
}

fn sparse_complement<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    complement_search::search::<W>(matrix, lower, enough, meter)
}

/// A clique of `matrix` heavier than `lower`, the heaviest there is, or `None`.
pub(super) fn heavier(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut order = degeneracy(matrix).order;
    order.reverse();
    order.sort_by_key(|&v| std::cmp::Reverse(weights[v]));
    let sorted = matrix.select(&order);
    let sorted_weights: Vec<u64> = order.iter().map(|&v| weights[v]).collect();
    let found = with_width!(sorted.words, weighted(&sorted, &sorted_weights, lower, meter))?;
    Some(found.into_iter().map(|v| order[v]).collect())
}

fn weighted<const W: usize>(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    weighted_search::search::<W>(matrix, weights, lower, meter)
}

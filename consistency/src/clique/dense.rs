//! Heaviest cliques of graphs that fit into bit rows: reduction, start, choice of the search.

use super::budget::Meter;
use super::greedy::extend;
use super::local_search;
use super::order::{DENSE, density, order, order_above};
use super::peels::Peels;
use super::rows::{closed, full, with_width};
use super::search::Problem;
use super::{by_vertex, complement_parts};
use crate::graph::{Adjacency, bit_matrix::BitMatrix};

/// A clique of `matrix` heavier than `lower`: the heaviest, or one of at least `enough`; or `None`.
pub(super) fn heavier(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut order = order_above(matrix, weights, lower);
    let pick = |order: &[usize]| order.iter().map(|&v| weights[v]).collect::<Vec<u64>>();
    let mut reduced = matrix.select(&order);
    let mut own = pick(&order);
    if own.iter().sum::<u64>() <= lower {
        return None;
    }
    let start = extend(&reduced, 0..reduced.len());
    let moves = if density(&reduced) > DENSE { LOCAL_MOVES } else { LOCAL_MOVES / 3 };
    let steps = (LOCAL_STEPS * reduced.len()).min(moves / (1 + missing_degree(&reduced) as usize));
    let start = local_search::improve(&reduced, &own, &start, steps, enough);
    let weight: u64 = start.iter().map(|&v| own[v]).sum();
    let (mut best, mut known) = (None, lower);
    if weight > lower {
        known = weight;
        best = Some(start.iter().map(|&v| order[v]).collect());
        if known >= enough {
            return best;
        }
        let kept = order_above(&reduced, &own, known);
        reduced = reduced.select(&kept);
        order = kept.into_iter().map(|i| order[i]).collect();
        own = pick(&order);
    }
    let found = exactly(&reduced, &own, known, enough, meter);
    found.map(|clique| clique.into_iter().map(|v| order[v]).collect()).or(best)
}

/// The same for a graph that hardly ever holds such a clique, near one that is known: `start`.
pub(super) fn heavier_near(
    matrix: &BitMatrix,
    weights: &[u64],
    start: &[usize],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    if counts(weights) && missing_degree(matrix) <= SPARSE_COMPLEMENT {
        let hint = || {
            let steps = NEAR_STEPS * matrix.len();
            let better = local_search::improve(matrix, weights, start, steps, enough);
            (better.len() as u64 >= enough).then_some(better)
        };
        return sparse_complement(matrix, lower, enough, &hint, meter);
    }
    let order = order_above(matrix, weights, lower);
    let own: Vec<u64> = order.iter().map(|&v| weights[v]).collect();
    if own.iter().sum::<u64>() <= lower {
        return None;
    }
    let found = exactly(&matrix.select(&order), &own, lower, enough, meter)?;
    Some(found.into_iter().map(|v| order[v]).collect())
}

/// Takes the search that fits.
fn exactly(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let counted = counts(weights);
    if counted && missing_degree(matrix) <= SPARSE_COMPLEMENT {
        sparse_complement(matrix, lower, enough, &|| None, meter)
    } else {
        by_vertex::search(Problem { matrix, weights, counted }, lower, enough, meter)
    }
}

/// A clique of more than `lower` vertices: the largest, or one of at least `enough`; or `None`.
pub(super) fn larger(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    heavier(matrix, &vec![1; matrix.len()], lower as u64, enough as u64, meter)
}

/// Upper bound of the weight of a clique, by colouring alone.
pub(super) fn bound(matrix: &BitMatrix, weights: &[u64]) -> u64 {
    with_width!(matrix.words(), bound_wide(matrix, weights))
}

fn bound_wide<const W: usize>(matrix: &BitMatrix, weights: &[u64]) -> u64 {
    let order = order(matrix, weights);
    let weights: Vec<u64> = order.iter().map(|&v| weights[v]).collect();
    Peels::<W>::new().bound(&closed(&matrix.select(&order)), &weights, full(matrix.len()))
}

/// Steps of the local search a vertex, and a limit on what all of them may touch; a third of it where few vertices
/// are joined, since there the search costs hardly more.
const LOCAL_STEPS: usize = 10;
const LOCAL_MOVES: usize = 150_000;

/// Steps a vertex from a clique that nearly suffices.
const NEAR_STEPS: usize = 2;

/// Average number of missing edges a vertex up to which the complement is searched.
const SPARSE_COMPLEMENT: f64 = 9.0;

fn missing_degree(matrix: &BitMatrix) -> f64 {
    let n = matrix.len() as f64;
    if n > 0.0 { n - 1.0 - 2.0 * matrix.edge_count() as f64 / n } else { 0.0 }
}

fn counts(weights: &[u64]) -> bool {
    weights.iter().all(|&w| w == 1)
}

/// * `hint` – may know a clique of `enough`; asked if the search does not end at once.
fn sparse_complement(
    matrix: &BitMatrix,
    lower: u64,
    enough: u64,
    hint: &dyn Fn() -> Option<Vec<usize>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let (lower, enough) = (lower as usize, enough as usize);
    with_width!(matrix.words(), sparse_complement_wide(matrix, lower, enough, hint, meter))
}

fn sparse_complement_wide<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    hint: &dyn Fn() -> Option<Vec<usize>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    complement_parts::search::<W>(matrix, lower, enough, hint, meter)
}

//! Heaviest cliques of graphs that fit into bit rows: reduction, start, choice of the search.

use super::budget::Meter;
use super::greedy::extend;
use super::local_search;
use super::order::{DENSE, all_matter, density, order_above};
use super::peels::Peels;
use super::rows::{closed, complement, full, spread, with_width};
use super::search::Problem;
use super::{by_vertex, complement_parts};
use crate::graph::{
    Adjacency,
    bit_matrix::{Apart, BitMatrix},
    bits::words_for,
};

/// A clique of `matrix` heavier than `lower`: the heaviest, or one of at least `enough`; or `None`.
pub(super) fn heavier(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let order = order_above(matrix, weights, lower);
    let found = heavier_in_order(&matrix.select(&order), &pick(weights, &order), lower, enough, meter)?;
    Some(found.into_iter().map(|v| order[v]).collect())
}

/// The same for vertices in the order of colouring.
pub(super) fn heavier_in_order(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    if weights.iter().sum::<u64>() <= lower {
        return None;
    }
    let n = matrix.len();
    let start = extend(matrix, 0..n);
    let dense = density(matrix) > DENSE;
    let moves = if dense { LOCAL_MOVES } else { EASY_MOVES.min(n * n / 8) };
    let steps = (LOCAL_STEPS * n).min(moves / (1 + missing_degree(matrix) as usize));
    let start = with_width!(matrix.words(), improved(matrix, weights, &start, steps, enough));
    let weight: u64 = start.iter().map(|&v| weights[v]).sum();
    if weight >= enough {
        return Some(start);
    }
    let (best, lower) = if weight > lower { (Some(start), weight) } else { (None, lower) };
    let ordered = !dense || through_complement(matrix, weights);
    if ordered && all_matter(matrix, weights, lower) {
        return exactly(matrix, weights, lower, enough, meter).or(best);
    }
    let kept = order_above(matrix, weights, lower);
    let found = exactly(&matrix.select(&kept), &pick(weights, &kept), lower, enough, meter);
    found.map(|clique| clique.into_iter().map(|v| kept[v]).collect()).or(best)
}

fn improved<const W: usize>(
    matrix: &BitMatrix,
    weights: &[u64],
    start: &[usize],
    steps: usize,
    enough: u64,
) -> Vec<usize> {
    local_search::improve(&complement::<W>(matrix), weights, start, steps, enough)
}

fn pick(weights: &[u64], vertices: &[usize]) -> Vec<u64> {
    vertices.iter().map(|&v| weights[v]).collect()
}

/// The same for a graph that hardly ever holds such a clique.
pub(super) fn heavier_at_once(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let order = order_above(matrix, weights, lower);
    let own = pick(weights, &order);
    if own.iter().sum::<u64>() <= lower {
        return None;
    }
    let found = exactly(&matrix.select(&order), &own, lower, enough, meter)?;
    Some(found.into_iter().map(|v| order[v]).collect())
}

/// The same for a near-clique, counted, given by its complement, where what `start` makes nearly suffices.
pub(super) fn larger_near(
    apart: &Apart,
    start: &dyn Fn() -> Vec<usize>,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let hint = || {
        let better = with_width!(words_for(apart.len()), improved_near(apart, &start(), enough));
        (better.len() >= enough).then_some(better)
    };
    sparse_complement(apart, lower, enough, &hint, meter)
}

fn improved_near<const W: usize>(apart: &Apart, start: &[usize], enough: usize) -> Vec<usize> {
    let (ones, steps) = (vec![1; apart.len()], NEAR_STEPS * apart.len());
    local_search::improve(&spread::<W>(apart), &ones, start, steps, enough as u64)
}

/// Whether a graph with so many vertices and pairs that are not joined is searched through its complement.
pub(super) fn is_near_clique(vertices: usize, missing: usize) -> bool {
    2.0 * missing as f64 <= SPARSE_COMPLEMENT * vertices as f64
}

/// Takes the search that fits.
fn exactly(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    if through_complement(matrix, weights) {
        sparse_complement(&matrix.apart_all(), lower as usize, enough as usize, &|| None, meter)
    } else {
        let counted = counts(weights);
        by_vertex::search(Problem { matrix, weights, counted }, lower, enough, meter)
    }
}

/// Whether a graph is searched through its complement, where the order of its vertices does not matter.
fn through_complement(matrix: &BitMatrix, weights: &[u64]) -> bool {
    missing_degree(matrix) <= SPARSE_COMPLEMENT && counts(weights)
}

/// Upper bound of the weight of a clique, by colouring alone.
pub(super) fn bound(matrix: &BitMatrix, weights: &[u64]) -> u64 {
    with_width!(matrix.words(), bound_wide(matrix, weights))
}

fn bound_wide<const W: usize>(matrix: &BitMatrix, weights: &[u64]) -> u64 {
    let order = order_above(matrix, weights, 0);
    let weights = pick(weights, &order);
    Peels::<W>::new().bound(&closed(&matrix.select(&order)), &weights, full(order.len()))
}

/// Steps of the local search a vertex, and a limit on what all of them may touch; less where few vertices are joined,
/// since there the search costs hardly more: no more than reading the graph does.
const LOCAL_STEPS: usize = 10;
const LOCAL_MOVES: usize = 150_000;
const EASY_MOVES: usize = 50_000;

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
    apart: &Apart,
    lower: usize,
    enough: usize,
    hint: &dyn Fn() -> Option<Vec<usize>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    with_width!(words_for(apart.len()), sparse_complement_wide(apart, lower, enough, hint, meter))
}

fn sparse_complement_wide<const W: usize>(
    apart: &Apart,
    lower: usize,
    enough: usize,
    hint: &dyn Fn() -> Option<Vec<usize>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    complement_parts::search::<W>(apart, lower, enough, hint, meter)
}

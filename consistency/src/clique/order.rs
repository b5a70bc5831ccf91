//! Orders of colouring, and which vertices matter.

use crate::graph::{Adjacency, bit_matrix::BitMatrix};

/// The order of colouring, without vertices that are in no clique heavier than `lower`.
pub(super) fn order_above(matrix: &BitMatrix, weights: &[u64], lower: u64) -> Vec<usize> {
    order_among((0..matrix.len()).collect(), |v| matrix.neighbors(v), weights, lower)
}

/// The order of colouring of some `vertices`, of which `near` are joined to each: last the one with the lightest
/// neighbourhood, before it the one with the lightest without that, and so on; of several the one whose neighbours have
/// the lightest neighbourhoods. Vertices that are in no clique heavier than `lower` are left out.
///
/// **Source**: the minimum width order with ties broken by the degrees of the neighbours of Tomita and Kameda, *An
/// efficient branch-and-bound algorithm for finding a maximum clique with computational experiments*, 2007; the ties
/// are ranked once, in the whole graph.
pub(super) fn order_among<I: Iterator<Item = usize>>(
    vertices: Vec<usize>,
    near: impl Fn(usize) -> I,
    weights: &[u64],
    lower: u64,
) -> Vec<usize> {
    let (mut left, mut around) = (vertices, vec![0u64; weights.len()]);
    left.iter().for_each(|&v| around[v] = near(v).map(|u| weights[u]).sum());
    let matters: Vec<bool> =
        (0..weights.len()).map(|v| weights[v] > 0 && weights[v] + around[v] > lower).collect();
    left.sort_by_cached_key(|&v| near(v).map(|u| around[u]).fold(0, u64::saturating_add));
    let mut order = Vec::with_capacity(left.len());
    while let Some(at) = (0..left.len()).min_by_key(|&i| around[left[i]]) {
        let v = left.remove(at);
        near(v).for_each(|u| around[u] = around[u].saturating_sub(weights[v]));
        order.push(v);
    }
    order.retain(|&v| matters[v]);
    order.reverse();
    order
}

/// Weight of all neighbours.
fn weight_around(matrix: &BitMatrix, weights: &[u64], v: usize) -> u64 {
    matrix.neighbors(v).map(|u| weights[u]).sum()
}

/// Whether a vertex may be in a clique heavier than `lower`.
pub(super) fn matters<'a>(
    matrix: &'a BitMatrix,
    weights: &'a [u64],
    lower: u64,
) -> impl Fn(usize) -> bool + 'a {
    let counted = weights.iter().all(|&w| w == 1);
    move |v| {
        let around = if counted { matrix.degree(v) as u64 } else { weight_around(matrix, weights, v) };
        weights[v] > 0 && weights[v] + around > lower
    }
}

/// Share of the vertex pairs that are joined, about.
pub(super) fn density(matrix: &BitMatrix) -> f64 {
    2.0 * matrix.edge_count() as f64 / (matrix.len() * matrix.len()).max(1) as f64
}

/// Density from which a search is so much work that better orders and starts are worth their cost.
pub(super) const DENSE: f64 = 0.6;

//! Orders of colouring, and which vertices matter.

use pulp::{Arch, NullaryFnOnce};

use super::rows::{Set, and, closed, drop, full, members, with_width};
use super::tally::Tally;
use crate::graph::{Adjacency, bit_matrix::BitMatrix};

/// The order of colouring, without vertices that are in no clique heavier than `lower`.
pub(super) fn order_above(matrix: &BitMatrix, weights: &[u64], lower: u64) -> Vec<usize> {
    with_width!(matrix.words(), order_wide(matrix, weights, lower))
}

fn order_wide<const W: usize>(matrix: &BitMatrix, weights: &[u64], lower: u64) -> Vec<usize> {
    order_among(&closed::<W>(matrix), full(matrix.len()), weights, lower)
}

/// The order of colouring of some `vertices`: last the one with the lightest neighbourhood, before it the one with the
/// lightest without that, and so on; of several the one whose neighbours have the lightest neighbourhoods. Vertices
/// that are in no clique heavier than `lower` are left out. Rows of `adjacent` hold their own vertex too.
///
/// **Source**: the minimum width order with ties broken by the degrees of the neighbours of Tomita and Kameda, *An
/// efficient branch-and-bound algorithm for finding a maximum clique with computational experiments*, 2007; the ties
/// are ranked once, in the whole graph.
pub(super) fn order_among<const W: usize>(
    adjacent: &[Set<W>],
    vertices: Set<W>,
    weights: &[u64],
    lower: u64,
) -> Vec<usize> {
    Arch::new().dispatch(Order { adjacent, vertices, weights, lower })
}

struct Order<'a, const W: usize> {
    adjacent: &'a [Set<W>],
    vertices: Set<W>,
    weights: &'a [u64],
    lower: u64,
}

impl<const W: usize> NullaryFnOnce for Order<'_, W> {
    type Output = Vec<usize>;

    #[inline(always)]
    fn call(self) -> Vec<usize> {
        let Self { adjacent, vertices, weights, lower } = self;
        let near = |v: usize, among: &Set<W>| {
            let mut near = and(&adjacent[v], among);
            drop(&mut near, v);
            near
        };
        let mut around = Tally::new();
        members(vertices).for_each(|v| around.add(&near(v, &vertices), weights[v]));
        let mut kept = vec![false; adjacent.len()];
        members(vertices).for_each(|v| kept[v] = matters(weights[v], around.of(v), lower));
        let mut ranked: Vec<usize> = members(vertices).collect();
        ranked.sort_by_cached_key(|&v| around.total(&near(v, &vertices)));
        let mut rank = vec![0u32; adjacent.len()];
        ranked.iter().zip(0..).for_each(|(&v, at)| rank[v] = at);
        let (mut left, mut order) = (vertices, Vec::with_capacity(ranked.len()));
        while let Some(v) = members(around.least(&left)).min_by_key(|&v| rank[v]) {
            drop(&mut left, v);
            around.subtract(&near(v, &left), weights[v]);
            order.push(v);
        }
        order.retain(|&v| kept[v]);
        order.reverse();
        order
    }
}

/// Whether all vertices may be in a clique heavier than `lower`.
pub(super) fn all_matter(matrix: &BitMatrix, weights: &[u64], lower: u64) -> bool {
    let counted = weights.iter().all(|&w| w == 1);
    let around = |v: usize| match counted {
        true => matrix.degree(v) as u64,
        false => matrix.neighbors(v).map(|u| weights[u]).sum(),
    };
    (0..matrix.len()).all(|v| matters(weights[v], around(v), lower))
}

/// Whether a vertex of this weight and with this weight around it may be in a clique heavier than `lower`.
fn matters(weight: u64, around: u64, lower: u64) -> bool {
    weight > 0 && weight + around > lower
}

/// Share of the vertex pairs that are joined, about.
pub(super) fn density(matrix: &BitMatrix) -> f64 {
    2.0 * matrix.edge_count() as f64 / (matrix.len() * matrix.len()).max(1) as f64
}

/// Density from which a search is so much work that better orders and starts are worth their cost.
pub(super) const DENSE: f64 = 0.6;

//! Branch and bound for the largest or heaviest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::cover::Cover;
use super::incumbent::Incumbent;
use super::order::{DENSE, density, order_among};
use super::rows::{Set, and, and_not, closed, count, drop, first, full, is_empty, put, with_width};
use crate::graph::{Adjacency, bit_matrix::BitMatrix};

/// What is searched: a graph in the order of colouring, and the weight of each vertex.
#[derive(Clone, Copy)]
pub(super) struct Problem<'a> {
    pub(super) matrix: &'a BitMatrix,
    pub(super) weights: &'a [u64],
    /// Whether all weights are one.
    pub(super) counted: bool,
}

/// A clique heavier than `lower`: the heaviest, or the first of at least `enough`; or `None`.
///
/// * `few` – vertices to branch on up to which an order of their own is not worth its cost.
pub(super) fn search(
    problem: Problem<'_>,
    (lower, enough): (u64, u64),
    few: u32,
    rival: Option<Rival<'_>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    if problem.weights.iter().sum::<u64>() <= lower {
        return None;
    }
    with_width!(problem.matrix.words(), search_wide(problem, (lower, enough), few, rival, meter))
}

fn search_wide<const W: usize>(
    problem: Problem<'_>,
    (lower, enough): (u64, u64),
    few: u32,
    rival: Option<Rival<'_>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let Problem { matrix, weights, counted } = problem;
    let adjacent = &closed::<W>(matrix);
    let (all, mut cover) = (full(matrix.len()), Cover::new(counted));
    // Most searches end here, before an order of their own is worth its cost.
    let branching = cover.branching(adjacent, weights, all, lower);
    if is_empty(&branching) {
        return None;
    }
    // Where few vertices are joined the work is little, and the order of the whole graph will do.
    if count(&branching) > few && (!counted || density(matrix) > DENSE) {
        let order = order_among(adjacent, all, weights, lower);
        let weights: Vec<u64> = order.iter().map(|&v| weights[v]).collect();
        let problem = Problem { matrix: &matrix.select(&order), weights: &weights, counted };
        let found = search(problem, (lower, enough), u32::MAX, rival, meter)?;
        return Some(found.into_iter().map(|v| order[v]).collect());
    }
    let mut search = Search {
        adjacent,
        weights,
        counted,
        cover,
        best: lower,
        enough,
        found: None,
        path: Vec::new(),
        weight: 0,
        rival,
        meter,
    };
    search.branch(all, branching);
    search.found
}

/// Searches of other parts of the same graph, whose cliques count here too.
#[derive(Clone, Copy)]
pub(super) struct Rival<'a> {
    pub(super) incumbent: &'a Incumbent,
    pub(super) index: u32,
    /// Weight that every clique of this part has besides what is searched.
    pub(super) fixed: u64,
}

/// Words of rows from which on each node looks at the clock.
const WIDE: usize = 16;

struct Search<'a, const W: usize> {
    /// Rows hold their own vertex too.
    adjacent: &'a [Set<W>],
    weights: &'a [u64],
    counted: bool,
    cover: Cover<W>,
    best: u64,
    enough: u64,
    found: Option<Vec<usize>>,
    path: Vec<usize>,
    weight: u64,
    rival: Option<Rival<'a>>,
    meter: &'a mut Meter,
}

impl<const W: usize> Search<'_, W> {
    fn expand(&mut self, candidates: Set<W>) {
        if !self.goes_on() {
            return;
        }
        let missing = self.best - self.weight;
        let branching = self.cover.branching(self.adjacent, self.weights, candidates, missing);
        self.branch(candidates, branching);
    }

    /// Searches each of the `branching` vertices with those `candidates` that are not to come.
    fn branch(&mut self, candidates: Set<W>, mut branching: Set<W>) {
        let mut open = and_not(&candidates, &branching);
        while let Some(v) = first(&branching) {
            drop(&mut branching, v);
            let next = and(&open, &self.adjacent[v]);
            put(&mut open, v);
            if self.counted && self.weight + 1 + u64::from(count(&next)) <= self.best {
                continue;
            }
            self.path.push(v);
            self.weight += self.weights[v];
            if self.weight > self.best {
                self.record();
            }
            if !is_empty(&next) {
                self.expand(next);
            }
            self.weight -= self.weights[v];
            self.path.pop();
        }
    }

    /// Takes over what others found, and says whether to go on.
    #[inline(always)]
    fn goes_on(&mut self) -> bool {
        if let Some(rival) = self.rival {
            let known = rival.incumbent.to_beat(rival.index, self.best + rival.fixed);
            self.best = self.best.max(known.saturating_sub(rival.fixed));
        }
        // a node of wide rows takes longer than a look at the clock
        self.best < self.enough && self.meter.tick() && (W < WIDE || self.meter.look())
    }

    fn record(&mut self) {
        self.best = self.weight;
        self.found = Some(self.path.clone());
        if let Some(rival) = self.rival {
            rival.incumbent.offer(self.best + rival.fixed, rival.index);
        }
    }
}

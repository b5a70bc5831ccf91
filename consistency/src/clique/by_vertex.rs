//! Splits a search by vertex: small graphs with an order of their own, and work for many threads.

use super::budget::Meter;
use super::cover::Cover;
use super::incumbent::{Incumbent, START};
use super::rows::{BitMatrix, Set, and, and_not, drop, first, full, is_empty, put, with_width};
use super::search::{self, Problem, Rival};
use crate::graph::bits;

/// A clique heavier than `lower`: the heaviest, or one of at least `enough`; or `None`.
///
/// The answer does not depend on the number of threads: of the parts that hold a heaviest clique the first one wins,
/// and what is returned is what a search of that part finds when it knows the weight.
pub(super) fn search(problem: Problem<'_>, lower: u64, enough: u64, meter: &mut Meter) -> Option<Vec<usize>> {
    with_width!(problem.matrix.words, search_wide(problem, lower, enough, meter))
}

fn search_wide<const W: usize>(
    problem: Problem<'_>,
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let split = Split::<W>::new(problem, lower, enough);
    split.run_all(meter);
    let (weight, index) = split.incumbent.get();
    if index == START {
        return None;
    }
    let part = split.parts.get(index as usize)?;
    let rest = weight - problem.weights[part.vertex];
    let mut again = Meter::unlimited();
    let found = if rest == 0 { Vec::new() } else { split.search(part, rest - 1, rest, None, &mut again)? };
    meter.nodes += again.nodes;
    Some(found.into_iter().chain([part.vertex]).collect())
}

/// Cliques of `vertex` with some of `around`, which are all joined to it.
struct Part<const W: usize> {
    vertex: usize,
    around: Set<W>,
}

struct Split<'a, const W: usize> {
    problem: Problem<'a>,
    /// Rows hold their own vertex too.
    adjacent: Vec<Set<W>>,
    parts: Vec<Part<W>>,
    incumbent: Incumbent,
    enough: u64,
}

impl<'a, const W: usize> Split<'a, W> {
    fn new(problem: Problem<'a>, lower: u64, enough: u64) -> Self {
        let adjacent = problem.matrix.closed::<W>();
        let all = full(problem.matrix.n);
        let mut branching = Cover::new(problem.counted).branching(&adjacent, problem.weights, all, lower);
        let mut open = and_not(&all, &branching);
        let mut parts = Vec::new();
        while let Some(vertex) = first(&branching) {
            drop(&mut branching, vertex);
            parts.push(Part { vertex, around: and(&open, &adjacent[vertex]) });
            put(&mut open, vertex);
        }
        Self { problem, adjacent, parts, incumbent: Incumbent::new(lower), enough }
    }

    fn run_in_turn(&self, meter: &mut Meter) {
        let mut cover = Cover::new(self.problem.counted);
        (0..self.parts.len()).for_each(|index| self.run(index, &mut cover, meter));
    }

    #[cfg(not(feature = "rayon"))]
    fn run_all(&self, meter: &mut Meter) {
        self.run_in_turn(meter);
    }

    #[cfg(feature = "rayon")]
    fn run_all(&self, meter: &mut Meter) {
        use rayon::prelude::*;
        // A limit of nodes must stop at the same node each time, so such a search stays on one thread.
        if meter.limits_nodes() || rayon::current_num_threads() == 1 {
            return self.run_in_turn(meter);
        }
        let shared = &*meter;
        let meters: Vec<Meter> = (0..self.parts.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|index| {
                let mut meter = shared.fork();
                self.run(index, &mut Cover::new(self.problem.counted), &mut meter);
                meter
            })
            .collect();
        meters.iter().for_each(|one| meter.join(one));
    }

    fn run(&self, index: usize, cover: &mut Cover<W>, meter: &mut Meter) {
        let part = &self.parts[index];
        let fixed = self.problem.weights[part.vertex];
        let rival = Rival { incumbent: &self.incumbent, index: index as u32, fixed };
        let known = self.incumbent.to_beat(rival.index, 0);
        if known >= self.enough || !meter.tick() {
            return;
        }
        if fixed > known {
            self.incumbent.offer(fixed, rival.index);
        }
        // Most parts end here, before an order of their own is worth its cost.
        let rest = known.saturating_sub(fixed);
        if is_empty(&cover.branching(&self.adjacent, self.problem.weights, part.around, rest)) {
            return;
        }
        self.search(part, rest, self.enough.saturating_sub(fixed), Some(rival), meter);
    }

    /// Searches the graph around the vertex of a part in an order of its own.
    fn search(
        &self,
        part: &Part<W>,
        lower: u64,
        enough: u64,
        rival: Option<Rival<'_>>,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let mut vertices: Vec<usize> = bits::iter(&part.around).collect();
        let mut matrix = BitMatrix::part(&self.adjacent, &vertices);
        // Where few vertices are joined parts are small work, and the order of the whole graph will do.
        if !self.problem.counted || matrix.density() > DENSE {
            let weights: Vec<u64> = vertices.iter().map(|&v| self.problem.weights[v]).collect();
            let order = matrix.order_above(&weights, lower);
            matrix = matrix.select(&order);
            vertices = order.into_iter().map(|v| vertices[v]).collect();
        }
        let weights: Vec<u64> = vertices.iter().map(|&v| self.problem.weights[v]).collect();
        if weights.iter().sum::<u64>() <= lower {
            return None;
        }
        let problem = Problem { matrix: &matrix, weights: &weights, counted: self.problem.counted };
        let found = search::search(problem, lower, enough, rival, meter)?;
        Some(found.into_iter().map(|v| vertices[v]).collect())
    }
}

/// Density of a part from which an order of its own is worth its cost.
const DENSE: f64 = 0.6;

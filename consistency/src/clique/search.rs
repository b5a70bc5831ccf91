//! Branch and bound for the largest or heaviest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::cover::Cover;
use super::incumbent::Incumbent;
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
pub(super) fn search(
    problem: Problem<'_>,
    lower: u64,
    enough: u64,
    rival: Option<Rival<'_>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    with_width!(problem.matrix.words(), search_wide(problem, lower, enough, rival, meter))
}

fn search_wide<const W: usize>(
    problem: Problem<'_>,
    lower: u64,
    enough: u64,
    rival: Option<Rival<'_>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let adjacent = closed::<W>(problem.matrix);
    let within = Within { adjacent: &adjacent, weights: problem.weights, counted: problem.counted };
    let cover = &mut Cover::new(problem.counted);
    within.search(full(problem.matrix.len()), lower, enough, rival, cover, meter)
}

/// What is searched, in rows that hold their own vertex too.
#[derive(Clone, Copy)]
pub(super) struct Within<'a, const W: usize> {
    pub(super) adjacent: &'a [Set<W>],
    pub(super) weights: &'a [u64],
    pub(super) counted: bool,
}

impl<const W: usize> Within<'_, W> {
    /// A clique of `candidates` heavier than `lower`: the heaviest, or the first of at least `enough`; or `None`.
    pub(super) fn search(
        self,
        candidates: Set<W>,
        lower: u64,
        enough: u64,
        rival: Option<Rival<'_>>,
        cover: &mut Cover<W>,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let mut search = Search {
            within: self,
            cover,
            best: lower,
            enough,
            found: None,
            path: Vec::new(),
            weight: 0,
            rival,
            meter,
        };
        search.expand(candidates);
        search.found
    }
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
    within: Within<'a, W>,
    cover: &'a mut Cover<W>,
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
        let Within { adjacent, weights, counted } = self.within;
        let mut branching = self.cover.branching(adjacent, weights, candidates, missing);
        let mut open = and_not(&candidates, &branching);
        while let Some(v) = first(&branching) {
            drop(&mut branching, v);
            let next = and(&open, &adjacent[v]);
            put(&mut open, v);
            if counted && self.weight + 1 + u64::from(count(&next)) <= self.best {
                continue;
            }
            self.path.push(v);
            self.weight += weights[v];
            if self.weight > self.best {
                self.record();
            }
            if !is_empty(&next) {
                self.expand(next);
            }
            self.weight -= weights[v];
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

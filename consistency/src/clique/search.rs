//! Branch and bound for the largest or heaviest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::cover::Cover;
use super::incumbent::Incumbent;
use super::rows::{BitMatrix, Set, and, and_not, count, drop, first, full, is_empty, put, with_width};

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
    with_width!(problem.matrix.words, search_wide(problem, lower, enough, rival, meter))
}

fn search_wide<const W: usize>(
    problem: Problem<'_>,
    lower: u64,
    enough: u64,
    rival: Option<Rival<'_>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut search = Search {
        adjacent: problem.matrix.closed::<W>(),
        problem,
        cover: Cover::new(problem.counted),
        best: lower,
        enough,
        found: None,
        path: Vec::new(),
        weight: 0,
        rival,
        meter,
    };
    search.expand(full(problem.matrix.n));
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

struct Search<'a, const W: usize> {
    /// Rows hold their own vertex too.
    adjacent: Vec<Set<W>>,
    problem: Problem<'a>,
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
        let mut branching = self.cover.branching(&self.adjacent, self.problem.weights, candidates, missing);
        let mut open = and_not(&candidates, &branching);
        while let Some(v) = first(&branching) {
            drop(&mut branching, v);
            let next = and(&open, &self.adjacent[v]);
            put(&mut open, v);
            if self.problem.counted && self.weight + 1 + u64::from(count(&next)) <= self.best {
                continue;
            }
            self.path.push(v);
            self.weight += self.problem.weights[v];
            if self.weight > self.best {
                self.record();
            }
            if !is_empty(&next) {
                self.expand(next);
            }
            self.weight -= self.problem.weights[v];
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
        self.best < self.enough && self.meter.tick()
    }

    fn record(&mut self) {
        self.best = self.weight;
        self.found = Some(self.path.clone());
        if let Some(rival) = self.rival {
            rival.incumbent.offer(self.best + rival.fixed, rival.index);
        }
    }
}

//! Branch and bound for the largest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::by_vertex::Incumbent;
use super::rows::{BitMatrix, Set, and, and_not, drop, empty, first, is_empty, put};
use crate::graph::bits;

/// A clique of `matrix` of more than `lower` vertices: the largest, or the first of at least `enough`; or `None`.
pub(super) fn search<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    rival: Rival<'_>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut search = Search::new(matrix, lower, enough, rival, meter);
    search.expand(full::<W>(matrix.n));
    search.found
}

/// Vertices to branch on at the root: without them `matrix` holds no clique of more than `lower` vertices.
pub(super) fn root_branching<const W: usize>(matrix: &BitMatrix, lower: usize) -> Vec<usize> {
    let mut meter = Meter::unlimited();
    let mut search =
        Search::<W>::new(matrix, lower, matrix.n, Rival { incumbent: None, index: 0 }, &mut meter);
    let branching = search.branching(full(matrix.n), lower);
    bits::iter(&branching).collect()
}

/// Searches of other parts of the same graph, whose cliques count here too.
#[derive(Clone, Copy)]
pub(super) struct Rival<'a> {
    pub(super) incumbent: Option<&'a Incumbent>,
    pub(super) index: u32,
}

fn full<const W: usize>(n: usize) -> Set<W> {
    let mut all = empty::<W>();
    (0..n).for_each(|v| put(&mut all, v));
    all
}

struct Search<'a, const W: usize> {
    adjacent: Vec<Set<W>>,
    /// Scratch of [`Search::branching`]: colour classes, and whether an inconsistent set uses the class.
    classes: Vec<Set<W>>,
    used: Vec<bool>,
    /// Scratch of [`Search::relax`]: members of each class joined to a vertex.
    near: Vec<Set<W>>,
    best: usize,
    enough: usize,
    found: Option<Vec<usize>>,
    path: Vec<usize>,
    rival: Rival<'a>,
    meter: &'a mut Meter,
}

impl<'a, const W: usize> Search<'a, W> {
    fn new(matrix: &BitMatrix, lower: usize, enough: usize, rival: Rival<'a>, meter: &'a mut Meter) -> Self {
        Self {
            adjacent: matrix.widened::<W>(),
            classes: vec![empty::<W>(); lower + 1],
            used: vec![false; lower + 1],
            near: vec![empty::<W>(); lower + 1],
            best: lower,
            enough,
            found: None,
            path: Vec::new(),
            rival,
            meter,
        }
    }

    /// Takes over what others found, and says whether to go on.
    fn goes_on(&mut self) -> bool {
        if let Some(incumbent) = self.rival.incumbent {
            self.best = self.best.max(incumbent.to_beat(self.rival.index).saturating_sub(1));
        }
        self.best < self.enough && self.meter.tick()
    }

    fn record(&mut self) {
        self.best = self.path.len();
        self.found = Some(self.path.clone());
        if let Some(incumbent) = self.rival.incumbent {
            incumbent.offer(self.best + 1, self.rival.index);
        }
    }
    fn expand(&mut self, candidates: Set<W>) {
        if !self.goes_on() {
            return;
        }
        let mut branching = self.branching(candidates, self.best - self.path.len());
        let mut open = and_not(&candidates, &branching);
        while let Some(v) = first(&branching) {
            drop(&mut branching, v);
            let next = and(&open, &self.adjacent[v]);
            put(&mut open, v);
            self.path.push(v);
            if !is_empty(&next) {
                self.expand(next);
            } else if self.path.len() > self.best {
                self.record();
            }
            self.path.pop();
        }
    }

    /// Vertices to branch on: without them the candidates hold no clique of more than `colours` vertices.
    fn branching(&mut self, candidates: Set<W>, colours: usize) -> Set<W> {
        if colours >= self.classes.len() {
            self.classes.resize(colours + 1, empty());
            self.used.resize(colours + 1, false);
            self.near.resize(colours + 1, empty());
        }
        let mut rest = candidates;
        for class in 0..colours {
            if is_empty(&rest) {
                return rest;
            }
            let (mut free, mut stable) = (rest, empty::<W>());
            while let Some(v) = first(&free) {
                drop(&mut free, v);
                free = and_not(&free, &self.adjacent[v]);
                put(&mut stable, v);
            }
            rest = and_not(&rest, &stable);
            self.classes[class] = stable;
            self.used[class] = false;
        }
        let mut todo = rest;
        while let Some(v) = first(&todo) {
            drop(&mut todo, v);
            if self.recolour(v, colours) || self.relax(v, colours) {
                drop(&mut rest, v);
            }
        }
        rest
    }

    /// Finds a class for `v`, moving at most one vertex elsewhere.
    fn recolour(&mut self, v: usize, colours: usize) -> bool {
        for class in 0..colours {
            if self.used[class] {
                continue;
            }
            let conflict = and(&self.classes[class], &self.adjacent[v]);
            let Some(w) = first(&conflict) else {
                put(&mut self.classes[class], v);
                return true;
            };
            let mut others = conflict;
            drop(&mut others, w);
            if !is_empty(&others) {
                continue;
            }
            for other in 0..colours {
                if other != class
                    && !self.used[other]
                    && is_empty(&and(&self.classes[other], &self.adjacent[w]))
                {
                    drop(&mut self.classes[class], w);
                    put(&mut self.classes[class], v);
                    put(&mut self.classes[other], w);
                    return true;
                }
            }
        }
        false
    }

    /// Finds two classes which, with `v`, hold no triangle: the three count for two colours.
    fn relax(&mut self, v: usize, colours: usize) -> bool {
        for class in 0..colours {
            self.near[class] = and(&self.classes[class], &self.adjacent[v]);
        }
        for one in 0..colours {
            if self.used[one] {
                continue;
            }
            for two in one + 1..colours {
                if !self.used[two] && self.are_apart(&self.near[one], &self.near[two]) {
                    self.used[one] = true;
                    self.used[two] = true;
                    return true;
                }
            }
        }
        false
    }

    #[inline(always)]
    fn are_apart(&self, a: &Set<W>, b: &Set<W>) -> bool {
        let mut rest = *a;
        while let Some(w) = first(&rest) {
            drop(&mut rest, w);
            if !is_empty(&and(b, &self.adjacent[w])) {
                return false;
            }
        }
        true
    }
}

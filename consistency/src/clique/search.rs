//! Branch and bound for the largest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::rows::{BitMatrix, Set, and, and_not, drop, empty, first, is_empty, put};

/// A clique of `matrix` of more than `lower` vertices: the largest, or the first of at least `enough`; or `None`.
pub(super) fn search<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut all = empty::<W>();
    (0..matrix.n).for_each(|v| put(&mut all, v));
    let mut search = Search {
        adjacent: matrix.widened::<W>(),
        classes: vec![empty::<W>(); matrix.n + 1],
        used: vec![false; matrix.n + 1],
        best: lower,
        enough,
        found: None,
        path: Vec::new(),
        meter,
    };
    search.expand(all);
    search.found
}

struct Search<'a, const W: usize> {
    adjacent: Vec<Set<W>>,
    /// Scratch of [`Search::branching`]: colour classes, and whether an inconsistent set uses the class.
    classes: Vec<Set<W>>,
    used: Vec<bool>,
    best: usize,
    enough: usize,
    found: Option<Vec<usize>>,
    path: Vec<usize>,
    meter: &'a mut Meter,
}

impl<const W: usize> Search<'_, W> {
    fn expand(&mut self, candidates: Set<W>) {
        if self.best >= self.enough || !self.meter.tick() {
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
                self.best = self.path.len();
                self.found = Some(self.path.clone());
            }
            self.path.pop();
        }
    }

    /// Vertices to branch on: without them the candidates hold no clique of more than `colours` vertices.
    fn branching(&mut self, candidates: Set<W>, colours: usize) -> Set<W> {
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
        for one in 0..colours {
            if self.used[one] {
                continue;
            }
            let near = and(&self.classes[one], &self.adjacent[v]);
            for two in one + 1..colours {
                if self.used[two] {
                    continue;
                }
                let far = and(&self.classes[two], &self.adjacent[v]);
                let mut rest = near;
                let mut joined = false;
                while let Some(w) = first(&rest) {
                    drop(&mut rest, w);
                    if !is_empty(&and(&far, &self.adjacent[w])) {
                        joined = true;
                        break;
                    }
                }
                if !joined {
                    self.used[one] = true;
                    self.used[two] = true;
                    return true;
                }
            }
        }
        false
    }
}

//! Branch and bound for the heaviest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::rows::{BitMatrix, Set, and, and_not, drop, empty, first, has, is_empty, put};

/// A clique of `matrix` heavier than `lower`, the heaviest there is, or `None`.
pub(super) fn search<const W: usize>(
    matrix: &BitMatrix,
    weights: &[u64],
    lower: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut all = empty::<W>();
    (0..matrix.n).for_each(|v| put(&mut all, v));
    let mut search = Search {
        adjacent: matrix.widened::<W>(),
        weights,
        residual: weights.to_vec(),
        peels: Vec::new(),
        near: Vec::new(),
        best: lower,
        found: None,
        path: Vec::new(),
        meter,
    };
    search.expand(all, 0);
    search.found
}

struct Search<'a, const W: usize> {
    adjacent: Vec<Set<W>>,
    weights: &'a [u64],
    /// Scratch of [`Search::branching`]: weight of each vertex that no stable set covers yet.
    residual: Vec<u64>,
    /// Stable sets with the weight each was peeled off with and has not spent on relaxing others.
    peels: Vec<(Set<W>, u64)>,
    /// Scratch of [`Search::relax`]: peels and their members joined to a vertex.
    near: Vec<(usize, Set<W>)>,
    best: u64,
    found: Option<Vec<usize>>,
    path: Vec<usize>,
    meter: &'a mut Meter,
}

impl<const W: usize> Search<'_, W> {
    fn expand(&mut self, candidates: Set<W>, weight: u64) {
        if !self.meter.tick() {
            return;
        }
        if weight > self.best {
            self.best = weight;
            self.found = Some(self.path.clone());
        }
        let mut branching = self.branching(candidates, self.best - weight);
        let mut open = and_not(&candidates, &branching);
        while let Some(v) = first(&branching) {
            drop(&mut branching, v);
            let next = and(&open, &self.adjacent[v]);
            put(&mut open, v);
            self.path.push(v);
            self.expand(next, weight + self.weights[v]);
            self.path.pop();
        }
    }

    /// Vertices to branch on: without them the candidates hold no clique heavier than `allowed`.
    ///
    /// Stable sets are peeled off, each with the least residual weight of its members; a clique meets a stable set
    /// at most once, so it weighs at most the sum of the peels over vertices whose residual reached zero.
    fn branching(&mut self, candidates: Set<W>, mut allowed: u64) -> Set<W> {
        let mut rest = candidates;
        let mut todo = candidates;
        while let Some(v) = first(&todo) {
            drop(&mut todo, v);
            self.residual[v] = self.weights[v];
        }
        self.peels.clear();
        while !is_empty(&rest) && allowed > 0 {
            let (mut free, mut stable) = (rest, empty::<W>());
            let mut least = allowed;
            while let Some(v) = first(&free) {
                drop(&mut free, v);
                free = and_not(&free, &self.adjacent[v]);
                put(&mut stable, v);
                least = least.min(self.residual[v]);
            }
            allowed -= least;
            self.peels.push((stable, least));
            while let Some(v) = first(&stable) {
                drop(&mut stable, v);
                self.residual[v] -= least;
                if self.residual[v] == 0 {
                    drop(&mut rest, v);
                }
            }
        }
        let mut todo = rest;
        while let Some(v) = first(&todo) {
            drop(&mut todo, v);
            if self.relax(v) {
                drop(&mut rest, v);
            }
        }
        rest
    }

    /// Pays for what is left of `v` with pairs of peels which, with `v`, hold no triangle: of equal weights of the
    /// three only two can be in a clique. Both peels then have less to spend on others.
    fn relax(&mut self, v: usize) -> bool {
        self.near.clear();
        for (index, (stable, weight)) in self.peels.iter().enumerate() {
            if *weight > 0 && !has(stable, v) {
                self.near.push((index, and(stable, &self.adjacent[v])));
            }
        }
        for i in 0..self.near.len() {
            for j in i + 1..self.near.len() {
                let ((one, a), (two, b)) = (self.near[i], self.near[j]);
                let spent = self.residual[v].min(self.peels[one].1).min(self.peels[two].1);
                if spent == 0 || !self.are_apart(&a, &b) {
                    continue;
                }
                self.peels[one].1 -= spent;
                self.peels[two].1 -= spent;
                self.residual[v] -= spent;
                if self.residual[v] == 0 {
                    return true;
                }
                if self.peels[one].1 == 0 {
                    break;
                }
            }
        }
        false
    }

    /// Whether no vertex of `a` is one of `b` or joined to one: peels can share vertices.
    #[inline(always)]
    fn are_apart(&self, a: &Set<W>, b: &Set<W>) -> bool {
        if !is_empty(&and(a, b)) {
            return false;
        }
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

//! Branch and bound for the heaviest clique of a small graph held in bit rows.

use super::budget::Meter;
use super::rows::{BitMatrix, Set, and, and_not, drop, empty, first, is_empty, put};

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
        while !is_empty(&rest) {
            let (mut free, mut stable) = (rest, empty::<W>());
            let mut least = u64::MAX;
            while let Some(v) = first(&free) {
                drop(&mut free, v);
                free = and_not(&free, &self.adjacent[v]);
                put(&mut stable, v);
                least = least.min(self.residual[v]);
            }
            if least > allowed {
                return rest;
            }
            allowed -= least;
            while let Some(v) = first(&stable) {
                drop(&mut stable, v);
                self.residual[v] -= least;
                if self.residual[v] == 0 {
                    drop(&mut rest, v);
                }
            }
        }
        rest
    }
}

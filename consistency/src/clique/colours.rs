//! Which candidates must be branched on: colouring, recolouring, propagation over the colour classes.

use super::cores::{Cores, Fit};
use super::rows::{Set, and, and_not, drop, first, is_empty, put, stable};

/// Scratch of [`Colours::branching`].
pub(super) struct Colours<const W: usize> {
    /// Stable sets of candidates; those that a core has used up are at the end.
    classes: Vec<Set<W>>,
    cores: Cores<W>,
}

impl<const W: usize> Colours<W> {
    pub(super) fn new() -> Self {
        Self { classes: Vec::new(), cores: Cores::new() }
    }

    /// Vertices to branch on: without them the candidates hold no clique of more than `colours` vertices.
    ///
    /// `adjacent` rows hold their own vertex too.
    #[inline(always)]
    pub(super) fn branching(&mut self, adjacent: &[Set<W>], candidates: Set<W>, colours: usize) -> Set<W> {
        let mut rest = candidates;
        self.classes.clear();
        for _ in 0..colours {
            if is_empty(&rest) {
                return rest;
            }
            let stable = stable(&rest, adjacent);
            rest = and_not(&rest, &stable);
            self.classes.push(stable);
        }
        let (mut todo, mut live) = (rest, self.classes.len());
        while let Some(v) = first(&todo) {
            drop(&mut todo, v);
            if self.covers(adjacent, v, &mut live) {
                drop(&mut rest, v);
            }
        }
        rest
    }

    /// Whether the first `live` classes with `v` still count for that many colours; classes used up are moved behind.
    #[inline(always)]
    fn covers(&mut self, adjacent: &[Set<W>], v: usize, live: &mut usize) -> bool {
        if let Fit::Free(class) = self.cores.start(adjacent, &self.classes[..*live], v) {
            put(&mut self.classes[class], v);
            return true;
        }
        if self.recolour(adjacent, v, *live) {
            return true;
        }
        if !self.cores.find(adjacent, &self.classes[..*live]) {
            return false;
        }
        self.cores.core.sort_unstable();
        for &class in self.cores.core.iter().rev() {
            *live -= 1;
            self.classes.swap(class, *live);
        }
        true
    }

    /// Finds a class for `v` whose only neighbour of `v` fits into another one.
    #[inline(always)]
    fn recolour(&mut self, adjacent: &[Set<W>], v: usize, live: usize) -> bool {
        for (class, w) in self.cores.units() {
            for other in 0..live {
                if other != class && is_empty(&and(&self.classes[other], &adjacent[w])) {
                    drop(&mut self.classes[class], w);
                    put(&mut self.classes[class], v);
                    put(&mut self.classes[other], w);
                    return true;
                }
            }
        }
        false
    }
}

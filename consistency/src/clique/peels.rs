//! Which candidates must be branched on for the heaviest clique: stable sets with weights, and cores of them.

use super::cores::{Cores, Fit};
use super::rows::{Set, and_not, drop, empty, first, is_empty, put};

/// Words that the cores of one node may look at, a tenth of a second; graphs of hundreds of vertices take a hundredth
/// of it. Among thousands that are nearly all joined, most sets have one member and each forces a step through all
/// others, for every vertex: hours.
const MOST_WORK: u64 = 1 << 28;

/// Scratch of [`Peels::branching`].
pub(super) struct Peels<const W: usize> {
    /// Weight of each vertex that no stable set covers yet.
    residual: Vec<u64>,
    /// Stable sets and the weight that each has left to spend; those without any are at the end.
    sets: Vec<Set<W>>,
    left: Vec<u64>,
    live: usize,
    cores: Cores<W>,
    /// Words that cores looked at in this node.
    work: u64,
    /// What was spent on the vertex at hand, to be taken back if that does not suffice.
    changes: Vec<Change>,
}

enum Change {
    /// A set of a core paid this weight; without any left it went to the end.
    Spent { set: usize, weight: u64, emptied: bool },
    /// Part of the weight of a set went to a copy of it, whose place was taken from a set that went to `last`.
    Split { set: usize, last: usize },
}

impl<const W: usize> Peels<W> {
    pub(super) fn new() -> Self {
        Self {
            residual: Vec::new(),
            sets: Vec::new(),
            left: Vec::new(),
            live: 0,
            cores: Cores::new(),
            work: 0,
            changes: Vec::new(),
        }
    }

    /// Vertices to branch on: without them the candidates hold no clique heavier than `allowed`.
    ///
    /// Stable sets are peeled off, each with the least residual weight of its members; a clique meets a stable set
    /// at most once, so it weighs at most the sum of the peels over vertices whose residual reached zero. What is
    /// left of a vertex is paid for by cores: sets which no clique through the vertex can all meet, so of equal
    /// weights of all of them and of the vertex one is not needed.
    ///
    /// `adjacent` rows hold their own vertex too.
    #[inline(always)]
    pub(super) fn branching(
        &mut self,
        adjacent: &[Set<W>],
        weights: &[u64],
        candidates: Set<W>,
        mut allowed: u64,
    ) -> Set<W> {
        self.residual.clear();
        self.residual.extend_from_slice(weights);
        self.sets.clear();
        self.left.clear();
        let mut rest = candidates;
        while !is_empty(&rest) && allowed > 0 {
            let (mut free, mut stable) = (rest, empty::<W>());
            let mut least = allowed;
            while let Some(v) = first(&free) {
                free = and_not(&free, &adjacent[v]);
                put(&mut stable, v);
                least = least.min(self.residual[v]);
            }
            allowed -= least;
            self.sets.push(stable);
            self.left.push(least);
            while let Some(v) = first(&stable) {
                drop(&mut stable, v);
                self.residual[v] -= least;
                if self.residual[v] == 0 {
                    drop(&mut rest, v);
                }
            }
        }
        self.live = self.sets.len();
        self.work = 0;
        let mut todo = rest;
        // without cores more vertices are left to branch on, and nothing is wrong
        while let Some(v) = first(&todo).filter(|_| self.work <= MOST_WORK) {
            drop(&mut todo, v);
            if self.pays(adjacent, v) {
                drop(&mut rest, v);
            }
        }
        rest
    }

    /// Upper bound of the weight of a clique of `candidates`: all of them peeled off.
    pub(super) fn bound(&mut self, adjacent: &[Set<W>], weights: &[u64], candidates: Set<W>) -> u64 {
        self.branching(adjacent, weights, candidates, u64::MAX);
        self.left.iter().sum()
    }

    /// Whether the sets can pay for what is left of `v`; if not, nothing is spent.
    #[inline(always)]
    fn pays(&mut self, adjacent: &[Set<W>], v: usize) -> bool {
        self.changes.clear();
        let mut open = self.residual[v];
        while open > 0 {
            match self.cores.start(adjacent, &self.sets[..self.live], v) {
                Fit::Free(set) => {
                    open -= self.cover(set, v, open);
                }
                Fit::Joined => {
                    let found = self.cores.find(adjacent, &self.sets[..self.live]);
                    self.work += self.cores.work();
                    if !found {
                        self.take_back(v);
                        return false;
                    }
                    let least = self.cores.core.iter().map(|&set| self.left[set]).min();
                    let weight = open.min(least.unwrap_or(open));
                    self.spend(weight);
                    open -= weight;
                }
            }
        }
        true
    }

    /// Adds `v` to a set none of whose members it is joined to, for a weight of at most `open`.
    #[inline(always)]
    fn cover(&mut self, set: usize, v: usize, open: u64) -> u64 {
        let weight = open.min(self.left[set]);
        if weight < self.left[set] {
            // The rest of the weight stays with the set as it was.
            let last = self.sets.len();
            self.sets.push(self.sets[set]);
            self.left.push(self.left[set] - weight);
            self.swap(self.live, last);
            self.live += 1;
            self.left[set] = weight;
            self.changes.push(Change::Split { set, last });
        }
        put(&mut self.sets[set], v);
        weight
    }

    #[inline(always)]
    fn spend(&mut self, weight: u64) {
        self.cores.core.sort_unstable();
        for i in (0..self.cores.core.len()).rev() {
            let set = self.cores.core[i];
            self.left[set] -= weight;
            let emptied = self.left[set] == 0;
            if emptied {
                self.live -= 1;
                self.swap(set, self.live);
            }
            self.changes.push(Change::Spent { set, weight, emptied });
        }
    }

    #[inline(always)]
    fn swap(&mut self, a: usize, b: usize) {
        self.sets.swap(a, b);
        self.left.swap(a, b);
    }

    /// Undoes what was done for `v`, and takes it out of all sets: it will be branched on.
    #[inline(always)]
    fn take_back(&mut self, v: usize) {
        while let Some(change) = self.changes.pop() {
            match change {
                Change::Spent { set, weight, emptied } => {
                    if emptied {
                        self.swap(set, self.live);
                        self.live += 1;
                    }
                    self.left[set] += weight;
                }
                Change::Split { set, last } => {
                    self.live -= 1;
                    self.left[set] += self.left[self.live];
                    self.swap(self.live, last);
                    self.sets.pop();
                    self.left.pop();
                }
            }
        }
        self.sets[..self.live].iter_mut().for_each(|set| drop(set, v));
    }
}

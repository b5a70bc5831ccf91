use std::ops::Range;

use super::rows::{Set, and, count, drop, first, is_empty};
use crate::graph::bits::iter;

/// Upper bound of the number of independent vertices: disjoint cliques hold one each, and fewer where they contradict
/// each other.
///
/// A clique all of whose members fail is dropped from the count with the cliques that made them fail: if each held a
/// vertex, so would this one. A member fails if, with it chosen, a chain of cliques that are left with one member
/// ends at a clique without any; odd cycles are the smallest case.
///
/// **Source**: the rule of Li and Quan, *An efficient branch-and-bound algorithm based on MaxSAT for the maximum
/// clique problem*, 2010, on the complement; here the chains run along edges of the sparse complement.
#[derive(Default)]
pub(super) struct ComplementBound {
    /// Members of the cliques, one clique after the other, and where each begins and ends.
    members: Vec<u32>,
    starts: Vec<u32>,
    /// The clique of each vertex while it counts.
    clique_of: Vec<u32>,
    /// Members left in each clique during a chain, and the cliques where that changed.
    left: Vec<u32>,
    touched: Vec<u32>,
    /// Step that put a vertex out, while `out_in` is the current chain.
    put_out_by: Vec<u32>,
    out_in: Vec<u64>,
    chain: u64,
    /// Vertices chosen in the chain.
    steps: Vec<u32>,
    /// Cliques of the core, and those whose reasons are still to be looked for.
    core: Vec<u32>,
    in_core: Vec<u64>,
    mark: u64,
    todo: Vec<u32>,
    seen_in: Vec<u64>,
}

const NONE: u32 = u32::MAX;

/// Largest clique whose members are tried one by one.
const LARGEST_TRIED: usize = 4;

impl ComplementBound {
    /// The bound within `alive`; work stops once it is down to `target`.
    #[inline(always)]
    pub(super) fn bound<const W: usize>(&mut self, apart: &[Set<W>], alive: &Set<W>, target: isize) -> isize {
        self.members.clear();
        self.starts.clear();
        self.starts.push(0);
        let mut rest = *alive;
        self.cover_by_cliques(apart, &mut rest);
        self.cover_by_edges(apart, rest);
        let mut total = self.cliques() as isize;
        // Each core takes two cliques and more.
        if total <= target || (target > 0 && 2 * (total - target) > total) {
            return total;
        }
        self.start(apart.len());
        for size in 1..=LARGEST_TRIED {
            for clique in 0..self.cliques() {
                if self.range(clique).len() != size || self.left[clique] == 0 {
                    continue;
                }
                if self.contradicts(apart, alive, clique) {
                    total -= 1;
                    if total <= target {
                        return total;
                    }
                }
            }
        }
        total
    }

    #[inline(always)]
    fn cliques(&self) -> usize {
        self.starts.len() - 1
    }

    /// Where the members of a clique are.
    #[inline(always)]
    fn range(&self, clique: usize) -> Range<usize> {
        self.starts[clique] as usize..self.starts[clique + 1] as usize
    }

    /// Ends the clique whose members were pushed last.
    #[inline(always)]
    fn close(&mut self) {
        self.starts.push(self.members.len() as u32);
    }

    #[inline(always)]
    fn start(&mut self, vertices: usize) {
        self.clique_of.clear();
        self.clique_of.resize(vertices, NONE);
        self.out_in.resize(self.out_in.len().max(vertices), 0);
        self.put_out_by.resize(self.put_out_by.len().max(vertices), 0);
        self.in_core.resize(self.in_core.len().max(self.cliques()), 0);
        self.seen_in.resize(self.seen_in.len().max(self.cliques()), 0);
        self.left.clear();
        for clique in 0..self.cliques() {
            let range = self.range(clique);
            self.left.push(range.len() as u32);
            for i in range {
                self.clique_of[self.members[i] as usize] = clique as u32;
            }
        }
    }

    /// Whether all members of a clique fail; the cliques that it takes then count no more.
    #[inline(always)]
    fn contradicts<const W: usize>(&mut self, apart: &[Set<W>], alive: &Set<W>, clique: usize) -> bool {
        self.core.clear();
        self.mark += 1;
        self.join(clique as u32);
        for i in self.range(clique) {
            let v = self.members[i];
            let empty = self.chain(apart, alive, v);
            while let Some(touched) = self.touched.pop() {
                self.left[touched as usize] = self.range(touched as usize).len() as u32;
            }
            let Some(empty) = empty else { return false };
            self.blame(empty);
        }
        for c in 0..self.core.len() {
            let used = self.core[c] as usize;
            self.left[used] = 0;
            for i in self.range(used) {
                self.clique_of[self.members[i] as usize] = NONE;
            }
        }
        true
    }

    /// Chooses `v` and what follows from it; returns a clique that is left without members.
    #[inline(always)]
    fn chain<const W: usize>(&mut self, apart: &[Set<W>], alive: &Set<W>, v: u32) -> Option<u32> {
        self.chain += 1;
        self.steps.clear();
        self.steps.push(v);
        let own = self.clique_of[v as usize];
        let mut step = 0;
        while step < self.steps.len() {
            let chosen = self.steps[step] as usize;
            for u in iter(&and(&apart[chosen], alive)) {
                let clique = self.clique_of[u];
                if clique == NONE || clique == own || self.out_in[u] == self.chain {
                    continue;
                }
                self.out_in[u] = self.chain;
                self.put_out_by[u] = step as u32;
                let left = &mut self.left[clique as usize];
                *left -= 1;
                self.touched.push(clique);
                match *left {
                    0 => return Some(clique),
                    1 => {
                        let mut members = self.members[self.range(clique as usize)].iter();
                        if let Some(&last) = members.find(|&&u| self.out_in[u as usize] != self.chain) {
                            self.steps.push(last);
                        }
                    }
                    _ => {}
                }
            }
            step += 1;
        }
        None
    }

    /// Takes the cliques that led to `empty` into the core.
    #[inline(always)]
    fn blame(&mut self, empty: u32) {
        self.visit(empty);
        while let Some(clique) = self.todo.pop() {
            for i in self.range(clique as usize) {
                let u = self.members[i] as usize;
                if self.out_in[u] == self.chain && self.put_out_by[u] > 0 {
                    let chosen = self.steps[self.put_out_by[u] as usize] as usize;
                    self.visit(self.clique_of[chosen]);
                }
            }
        }
    }

    #[inline(always)]
    fn visit(&mut self, clique: u32) {
        if self.seen_in[clique as usize] != self.chain {
            self.seen_in[clique as usize] = self.chain;
            self.todo.push(clique);
            self.join(clique);
        }
    }

    #[inline(always)]
    fn join(&mut self, clique: u32) {
        if self.in_core[clique as usize] != self.mark {
            self.in_core[clique as usize] = self.mark;
            self.core.push(clique);
        }
    }

    /// Cuts off cliques of three vertices and more.
    #[inline(always)]
    fn cover_by_cliques<const W: usize>(&mut self, apart: &[Set<W>], rest: &mut Set<W>) {
        let mut todo = *rest;
        while let Some(v) = first(&todo) {
            drop(&mut todo, v);
            let near = and(&apart[v], rest);
            let mut seconds = near;
            while let Some(a) = first(&seconds) {
                drop(&mut seconds, a);
                let mut common = and(&near, &apart[a]);
                if is_empty(&common) {
                    continue;
                }
                self.members.extend([v as u32, a as u32]);
                drop(rest, v);
                drop(rest, a);
                while let Some(b) = first(&common) {
                    drop(rest, b);
                    self.members.push(b as u32);
                    common = and(&common, &apart[b]);
                }
                todo = and(&todo, rest);
                self.close();
                break;
            }
        }
    }

    /// Covers the rest by a matching, vertices with few partners first, and single vertices.
    #[inline(always)]
    fn cover_by_edges<const W: usize>(&mut self, apart: &[Set<W>], mut rest: Set<W>) {
        while let Some(v) = first(&rest) {
            drop(&mut rest, v);
            let mut near = and(&apart[v], &rest);
            let mut best: Option<(u32, usize)> = None;
            while let Some(u) = first(&near) {
                drop(&mut near, u);
                let partners = count(&and(&apart[u], &rest));
                if best.is_none_or(|(least, _)| partners < least) {
                    best = Some((partners, u));
                }
            }
            match best {
                Some((_, u)) => {
                    drop(&mut rest, u);
                    self.members.extend([v as u32, u as u32]);
                }
                None => self.members.push(v as u32),
            }
            self.close();
        }
    }
}

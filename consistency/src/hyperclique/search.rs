//! Branch and bound for the largest hyperclique.

use crate::clique::Meter;
use crate::graph::hypergraph::Combinations;
use crate::graph::{Hypergraph, bits};

/// Searches hypercliques which hold all of `fixed`.
///
/// For a chosen set `Q` the candidates are the vertices that form an edge with every `k-1` of `Q`, and two candidates
/// are *joined* if they form an edge with every `k-2` of `Q`. The rest of a hyperclique is a clique of that graph,
/// so its colour number is a bound; choosing a vertex only takes joins away.
pub(super) struct Search<'a> {
    graph: &'a Hypergraph,
    words: usize,
    levels: Vec<Level>,
    path: Vec<usize>,
    pub(super) best: usize,
    pub(super) found: Option<Vec<usize>>,
    /// The search ends when a hyperclique of this size is found.
    pub(super) target: usize,
    meter: &'a mut Meter,
}

/// Candidates and their joins at one depth; row `v` of `joined` is valid for candidates only.
#[derive(Clone)]
struct Level {
    open: Vec<u64>,
    joined: Vec<u64>,
}

impl<'a> Search<'a> {
    pub(super) fn new(graph: &'a Hypergraph, lower: usize, meter: &'a mut Meter) -> Self {
        let words = graph.words();
        let mut open = vec![0; words];
        (0..graph.len()).for_each(|v| bits::insert(&mut open, v));
        let root = Level { joined: joins(graph, lower + 1, &open), open };
        Self {
            graph,
            words,
            levels: vec![root],
            path: Vec::new(),
            best: lower,
            found: None,
            target: graph.len(),
            meter,
        }
    }

    /// Leaves the vertices marked in `closed` out.
    pub(super) fn close(&mut self, closed: &[bool]) {
        for (v, _) in closed.iter().enumerate().filter(|(_, closed)| **closed) {
            bits::remove(&mut self.levels[0].open, v);
        }
    }

    /// Runs over all hypercliques that hold every vertex of `fixed`, themselves a hyperclique.
    pub(super) fn run(mut self, fixed: &[usize]) -> Option<Vec<usize>> {
        for &v in fixed {
            bits::remove(&mut self.levels[self.path.len()].open, v);
            self.choose(v);
            self.path.push(v);
        }
        self.expand();
        self.found
    }

    /// Fills the next level as if `v`, a candidate, were chosen.
    fn choose(&mut self, v: usize) {
        let depth = self.path.len();
        if self.levels.len() == depth + 1 {
            self.levels.push(self.levels[depth].clone());
        }
        let (old, new) = self.levels.split_at_mut(depth + 1);
        let (old, new) = (&old[depth], &mut new[0]);
        let w = self.words;
        let row = |u: usize| u * w..(u + 1) * w;
        for ((next, open), joined) in new.open.iter_mut().zip(&old.open).zip(&old.joined[row(v)]) {
            *next = open & joined;
        }
        let candidates: Vec<usize> = bits::iter(&new.open).collect();
        for &u in &candidates {
            new.joined[row(u)].copy_from_slice(&old.joined[row(u)]);
        }
        // Each choice of k-3 vertices of Q, with v, makes a new k-2.
        let mut subsets = Combinations::new(depth, self.graph.order().saturating_sub(3));
        if self.graph.order() == 2 {
            return;
        }
        let mut edge = Vec::with_capacity(self.graph.order());
        while let Some(places) = subsets.next() {
            for &u in &candidates {
                edge.clear();
                edge.extend(places.iter().map(|&i| self.path[i]));
                edge.extend([u, v]);
                edge.sort_unstable();
                let completing = self.graph.row(&edge);
                new.joined[row(u)].iter_mut().zip(completing).for_each(|(a, b)| *a &= b);
            }
        }
    }

    fn expand(&mut self) {
        if self.best >= self.target || !self.meter.tick() {
            return;
        }
        let depth = self.path.len();
        if depth > self.best {
            self.best = depth;
            self.found = Some(self.path.clone());
        }
        let branching = self.branching(self.best - depth);
        for v in &branching {
            bits::remove(&mut self.levels[depth].open, *v);
        }
        for &v in &branching {
            self.choose(v);
            bits::insert(&mut self.levels[depth].open, v);
            self.path.push(v);
            self.expand();
            self.path.pop();
            if self.best >= self.target || self.meter.stopped {
                return;
            }
        }
    }

    /// Candidates left over when as many colour classes as `colours` are filled.
    fn branching(&self, colours: usize) -> Vec<usize> {
        let Level { open, joined } = &self.levels[self.path.len()];
        let mut rest = open.clone();
        let mut free = vec![0; self.words];
        for _ in 0..colours {
            free.copy_from_slice(&rest);
            let mut any = false;
            while let Some(v) = first(&free) {
                any = true;
                bits::remove(&mut free, v);
                bits::remove(&mut rest, v);
                let row = &joined[v * self.words..(v + 1) * self.words];
                free.iter_mut().zip(row).for_each(|(a, b)| *a &= !b);
            }
            if !any {
                break;
            }
        }
        bits::iter(&rest).collect()
    }
}

fn first(set: &[u64]) -> Option<usize> {
    bits::iter(set).next()
}

/// Pairs that can be part of a hyperclique of `size` vertices: enough edges hold both.
fn joins(graph: &Hypergraph, size: usize, open: &[u64]) -> Vec<u64> {
    let (n, words, order) = (graph.len(), graph.words(), graph.order());
    let mut joined = vec![0; n * words];
    for v in 0..n {
        joined[v * words..(v + 1) * words].copy_from_slice(open);
        bits::remove(&mut joined[v * words..(v + 1) * words], v);
    }
    if order == 2 {
        for v in 0..n {
            joined[v * words..(v + 1) * words].copy_from_slice(graph.row(&[v]));
        }
    }
    if order != 3 || size < order {
        return joined;
    }
    for a in 0..n {
        for b in 0..a {
            if bits::count(graph.row(&[b, a])) < size - 2 {
                bits::remove(&mut joined[a * words..(a + 1) * words], b);
                bits::remove(&mut joined[b * words..(b + 1) * words], a);
            }
        }
    }
    joined
}

//! Branch and bound for the largest hyperclique.

use crate::clique::Meter;
use crate::graph::hypergraph::Combinations;
use crate::graph::{Hypergraph, bits};

/// Searches hypercliques.
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
    /// The vertex that all hypercliques searched hold.
    fixed: Option<usize>,
    meter: &'a mut Meter,
}

/// Candidates and their joins at one depth; row `v` of `joined` is valid for candidates only.
#[derive(Clone)]
struct Level {
    open: Vec<u64>,
    joined: Vec<u64>,
}

impl<'a> Search<'a> {
    /// For hypercliques of more than `lower` vertices, all of them `open`.
    ///
    /// * `fixed` – searches only those through this vertex, which is `open`.
    pub(super) fn new(
        graph: &'a Hypergraph,
        open: Vec<u64>,
        fixed: Option<usize>,
        lower: usize,
        meter: &'a mut Meter,
    ) -> Self {
        Self {
            graph,
            words: graph.words(),
            levels: vec![root(graph, lower + 1, open, fixed)],
            path: Vec::new(),
            best: lower,
            found: None,
            target: graph.len(),
            fixed,
            meter,
        }
    }

    /// Runs over all hypercliques.
    pub(super) fn run(mut self) -> Option<Vec<usize>> {
        if let Some(v) = self.fixed {
            bits::remove(&mut self.levels[0].open, v);
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

/// Candidates for hypercliques of `size` vertices, and which pairs of them can be part of one: enough edges hold both.
fn root(graph: &Hypergraph, size: usize, mut open: Vec<u64>, fixed: Option<usize>) -> Level {
    let (words, order) = (graph.words(), graph.order());
    let row = |v: usize| v * words..(v + 1) * words;
    let mut joined = vec![0; graph.len() * words];
    let few = |a: usize, b: usize| bits::count(graph.row(&[a.min(b), a.max(b)])) < size - 2;
    if order == 3
        && size >= order
        && let Some(v) = fixed
    {
        let far: Vec<usize> = bits::iter(&open).filter(|&u| u != v && few(u, v)).collect();
        far.into_iter().for_each(|u| bits::remove(&mut open, u));
    }
    for v in bits::iter(&open) {
        let all = if order == 2 { graph.row(&[v]) } else { &open };
        joined[row(v)].copy_from_slice(all);
        bits::remove(&mut joined[row(v)], v);
    }
    if order == 3 && size >= order {
        for a in bits::iter(&open) {
            // Only pairs that form an edge with a fixed vertex matter.
            let through = fixed.filter(|&v| v != a).map(|v| graph.row(&[a.min(v), a.max(v)]));
            let others = |block: usize| open[block] & through.map_or(u64::MAX, |row| row[block]);
            let others =
                (0..=a / 64).flat_map(|block| bits::iter_word(others(block)).map(move |b| 64 * block + b));
            for b in others.take_while(|&b| b < a) {
                if few(a, b) {
                    bits::remove(&mut joined[row(a)], b);
                    bits::remove(&mut joined[row(b)], a);
                }
            }
        }
    }
    Level { open, joined }
}

use super::rows::BitMatrix;
use crate::graph::bits;

/// Improves a clique by adding vertices and by swapping one vertex for another, the least recently moved first.
///
/// Deterministic. A step costs the number of vertices *not* joined to the one that moves.
///
/// **Source**: the plateau moves of Pullan and Hoos, *Dynamic Local Search for the Maximum Clique Problem*, 2006,
/// with a fixed tabu rule in place of random restarts and penalties.
pub(super) fn improve(matrix: &BitMatrix, start: &[usize], steps: usize) -> Vec<usize> {
    let n = matrix.n;
    let apart: Vec<Vec<u32>> = (0..n)
        .map(|v| (0..n).filter(|&u| u != v && !bits::has(matrix.row(v), u)).map(|u| u as u32).collect())
        .collect();
    let mut search = LocalSearch {
        matrix,
        apart,
        missing: vec![0; n],
        chosen: vec![false; n],
        moved: vec![0; n],
        fit: Vec::new(),
        near: Vec::new(),
        place: (0..n as u32).collect(),
        size: 0,
        now: 0,
    };
    search.fit = (0..n as u32).collect();
    start.iter().for_each(|&v| search.add(v));
    search.run(start, steps)
}

struct LocalSearch<'a> {
    matrix: &'a BitMatrix,
    /// Vertices not joined to each vertex.
    apart: Vec<Vec<u32>>,
    /// Number of clique members a vertex is not joined to.
    missing: Vec<u32>,
    chosen: Vec<bool>,
    /// Step at which a vertex was last added or dropped.
    moved: Vec<u64>,
    /// Vertices outside the clique which miss none, and which miss one, of its members; `place` is where.
    fit: Vec<u32>,
    near: Vec<u32>,
    place: Vec<u32>,
    size: usize,
    now: u64,
}

impl LocalSearch<'_> {
    fn run(&mut self, start: &[usize], steps: usize) -> Vec<usize> {
        let mut best = start.to_vec();
        for _ in 0..steps {
            self.now += 1;
            if let Some(v) = self.oldest(&self.fit) {
                self.add(v);
            } else if let Some(v) = self.oldest(&self.near) {
                self.swap_in(v);
            } else if let Some(v) =
                (0..self.matrix.n).filter(|&v| !self.chosen[v]).min_by_key(|&v| (self.moved[v], v))
            {
                self.swap_in(v);
            } else {
                break;
            }
            if self.size > best.len() {
                best = (0..self.matrix.n).filter(|&v| self.chosen[v]).collect();
            }
        }
        best
    }

    fn oldest(&self, list: &[u32]) -> Option<usize> {
        list.iter().map(|&v| v as usize).min_by_key(|&v| (self.moved[v], self.apart[v].len(), v))
    }

    /// Adds `v` and drops the members it is not joined to.
    fn swap_in(&mut self, v: usize) {
        let gone: Vec<usize> =
            self.apart[v].iter().map(|&u| u as usize).filter(|&u| self.chosen[u]).collect();
        gone.into_iter().for_each(|u| self.drop(u));
        self.add(v);
    }

    fn add(&mut self, v: usize) {
        self.unlist(v);
        self.chosen[v] = true;
        self.moved[v] = self.now;
        self.size += 1;
        for i in 0..self.apart[v].len() {
            let u = self.apart[v][i] as usize;
            self.unlist(u);
            self.missing[u] += 1;
            self.list(u);
        }
    }

    fn drop(&mut self, v: usize) {
        self.chosen[v] = false;
        self.moved[v] = self.now;
        self.size -= 1;
        self.list(v);
        for i in 0..self.apart[v].len() {
            let u = self.apart[v][i] as usize;
            self.unlist(u);
            self.missing[u] -= 1;
            self.list(u);
        }
    }

    fn list_of(&mut self, v: usize) -> Option<&mut Vec<u32>> {
        match (self.chosen[v], self.missing[v]) {
            (false, 0) => Some(&mut self.fit),
            (false, 1) => Some(&mut self.near),
            _ => None,
        }
    }

    fn list(&mut self, v: usize) {
        if let Some(list) = self.list_of(v) {
            list.push(v as u32);
            let at = list.len() as u32 - 1;
            self.place[v] = at;
        }
    }

    fn unlist(&mut self, v: usize) {
        let at = self.place[v] as usize;
        if let Some(list) = self.list_of(v) {
            list.swap_remove(at);
            if let Some(&other) = list.get(at) {
                self.place[other as usize] = at as u32;
            }
        }
    }
}

use crate::graph::bit_matrix::Apart;

/// Improves a clique by adding vertices and by swapping one vertex for another: the move that gains most weight, of
/// equal ones that of the vertex that rested longest. A vertex that was dropped may not return at once.
///
/// Stops at a weight of `enough`. Deterministic. A step costs the number of vertices *not* joined to the one that moves.
///
/// **Source**: the plateau moves of Pullan and Hoos, *Dynamic Local Search for the Maximum Clique Problem*, 2006, and
/// the joined neighbourhoods of Wu, Hao and Glover, *Multi-neighborhood tabu search for the maximum weight clique
/// problem*, 2012, with fixed rules in place of random ones.
pub(super) fn improve(
    apart: &Apart,
    weights: &[u64],
    start: &[usize],
    steps: usize,
    enough: u64,
) -> Vec<usize> {
    let n = apart.len();
    let mut search = LocalSearch {
        weights,
        apart,
        missing: vec![0; n],
        lost: vec![0; n],
        chosen: vec![false; n],
        moved: vec![0; n],
        fit: Vec::new(),
        near: Vec::new(),
        place: (0..n as u32).collect(),
        weight: 0,
        now: 0,
    };
    search.fit = (0..n as u32).collect();
    start.iter().for_each(|&v| search.add(v));
    search.run(start, steps, enough)
}

/// Steps for which a vertex that moved stays where it is.
const REST: u64 = 5;

struct LocalSearch<'a> {
    weights: &'a [u64],
    /// Vertices not joined to each vertex.
    apart: &'a Apart,
    /// Number of clique members a vertex is not joined to.
    missing: Vec<u32>,
    /// Weight of those members.
    lost: Vec<u64>,
    chosen: Vec<bool>,
    /// Step at which a vertex was last added or dropped.
    moved: Vec<u64>,
    /// Vertices outside the clique which miss none, and which miss one, of its members; `place` is where.
    fit: Vec<u32>,
    near: Vec<u32>,
    place: Vec<u32>,
    weight: u64,
    now: u64,
}

impl LocalSearch<'_> {
    fn run(&mut self, start: &[usize], steps: usize, enough: u64) -> Vec<usize> {
        let n = self.weights.len();
        let (mut best, mut heaviest) = (start.to_vec(), self.weight);
        for _ in 0..steps {
            if heaviest >= enough {
                break;
            }
            self.now += 1;
            let oldest = |v: &usize| (self.moved[*v], *v);
            let Some(v) = self.best_move().or_else(|| (0..n).filter(|&v| !self.chosen[v]).min_by_key(oldest))
            else {
                break;
            };
            self.swap_in(v);
            if self.weight > heaviest {
                heaviest = self.weight;
                best = (0..n).filter(|&v| self.chosen[v]).collect();
            }
        }
        best
    }

    /// The vertex to add or swap in, if one is allowed to.
    fn best_move(&self) -> Option<usize> {
        let mut best: Option<(i64, u64, usize)> = None;
        for &v in self.fit.iter().chain(&self.near) {
            let v = v as usize;
            let moved = self.moved[v];
            if moved != 0 && moved + REST >= self.now {
                continue;
            }
            let gain = self.weights[v] as i64 - self.lost[v] as i64;
            let rank = |u: usize| (self.apart.of(u).len(), u);
            if best.is_none_or(|(most, oldest, u)| {
                gain > most || gain == most && (moved < oldest || moved == oldest && rank(v) < rank(u))
            }) {
                best = Some((gain, moved, v));
            }
        }
        best.map(|(_, _, v)| v)
    }

    /// Adds `v` and drops the members it is not joined to.
    fn swap_in(&mut self, v: usize) {
        let gone: Vec<usize> =
            self.apart.of(v).iter().map(|&u| u as usize).filter(|&u| self.chosen[u]).collect();
        gone.into_iter().for_each(|u| self.drop(u));
        self.add(v);
    }

    fn add(&mut self, v: usize) {
        self.unlist(v);
        self.chosen[v] = true;
        self.moved[v] = self.now;
        self.weight += self.weights[v];
        for i in 0..self.apart.of(v).len() {
            let u = self.apart.of(v)[i] as usize;
            self.lost[u] += self.weights[v];
            // Only vertices that miss few members are on a list.
            if self.missing[u] > 1 {
                self.missing[u] += 1;
                continue;
            }
            self.unlist(u);
            self.missing[u] += 1;
            self.list(u);
        }
    }

    fn drop(&mut self, v: usize) {
        self.chosen[v] = false;
        self.moved[v] = self.now;
        self.weight -= self.weights[v];
        self.list(v);
        for i in 0..self.apart.of(v).len() {
            let u = self.apart.of(v)[i] as usize;
            self.lost[u] -= self.weights[v];
            if self.missing[u] > 2 {
                self.missing[u] -= 1;
                continue;
            }
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

use crate::graph::bit_matrix::Apart;

/// A clique that changes vertex by vertex, and which vertices could be added to it or swapped in.
///
/// A change costs the number of vertices *not* joined to the one that moves.
pub(super) struct Held<'a> {
    weights: &'a [u64],
    apart: &'a Apart,
    /// Number of members a vertex is not joined to.
    missing: Vec<u32>,
    /// Weight of those members.
    lost: Vec<u64>,
    chosen: Vec<bool>,
    members: Vec<u32>,
    /// Vertices outside which miss none, and which miss one, of the members.
    fit: Vec<u32>,
    near: Vec<u32>,
    /// Where a vertex is on its list.
    place: Vec<u32>,
    weight: u64,
    /// Step at which a vertex was last added or dropped.
    moved: Vec<u64>,
    pub(super) now: u64,
}

impl<'a> Held<'a> {
    pub(super) fn new(apart: &'a Apart, weights: &'a [u64], start: &[usize]) -> Self {
        let n = apart.len();
        let mut held = Self {
            weights,
            apart,
            missing: vec![0; n],
            lost: vec![0; n],
            chosen: vec![false; n],
            members: Vec::new(),
            fit: (0..n as u32).collect(),
            near: Vec::new(),
            place: (0..n as u32).collect(),
            weight: 0,
            moved: vec![0; n],
            now: 0,
        };
        start.iter().for_each(|&v| held.add(v));
        held
    }

    pub(super) fn weight(&self) -> u64 {
        self.weight
    }

    /// The clique, in no order.
    pub(super) fn members(&self) -> &[u32] {
        &self.members
    }

    /// Vertices that can be added.
    pub(super) fn fit(&self) -> &[u32] {
        &self.fit
    }

    /// Vertices that can be swapped in for one member.
    pub(super) fn near(&self) -> &[u32] {
        &self.near
    }

    /// Step at which a vertex was last added or dropped.
    #[inline]
    pub(super) fn moved(&self, v: usize) -> u64 {
        self.moved[v]
    }

    /// What the clique would weigh more with `v` in place of all that it is not joined to.
    #[inline]
    pub(super) fn gain(&self, v: usize) -> i64 {
        self.weights[v] as i64 - self.lost[v] as i64
    }

    /// A member that `v` is not joined to.
    pub(super) fn misses(&self, v: usize) -> Option<usize> {
        self.apart.of(v).iter().map(|&u| u as usize).find(|&u| self.chosen[u])
    }

    /// The vertex outside that rested longest.
    pub(super) fn longest_outside(&self) -> Option<usize> {
        let outside = (0..self.chosen.len()).filter(|&v| !self.chosen[v]);
        outside.min_by_key(|&v| (self.moved[v], v))
    }

    /// Adds `v` and drops the members it is not joined to.
    pub(super) fn swap_in(&mut self, v: usize) {
        if self.missing[v] > 0 {
            let apart = self.apart;
            apart.of(v).iter().map(|&u| u as usize).for_each(|u| {
                if self.chosen[u] {
                    self.drop(u);
                }
            });
        }
        self.add(v);
    }

    fn add(&mut self, v: usize) {
        self.unlist(v);
        self.chosen[v] = true;
        self.list(v);
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

    pub(super) fn drop(&mut self, v: usize) {
        self.unlist(v);
        self.chosen[v] = false;
        self.list(v);
        self.moved[v] = self.now;
        self.weight -= self.weights[v];
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
            (true, _) => Some(&mut self.members),
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

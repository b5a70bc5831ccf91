use super::rows::{Set, and, and_not, count, drop, empty, first, full, members, or, put};
use super::tally::Tally;

/// A clique that changes vertex by vertex, and which vertices could be added to it or swapped in.
///
/// How many members each vertex is not joined to is tallied, so that a change counts for all vertices at once.
pub(super) struct Held<'a, const W: usize> {
    weights: &'a [u64],
    /// Whether all weights are one.
    counted: bool,
    /// For each vertex those it is not joined to.
    apart: &'a [Set<W>],
    all: Set<W>,
    members: Set<W>,
    /// Number of members a vertex is not joined to.
    missing: Tally<W>,
    weight: u64,
    /// Step at which a vertex was last added or dropped.
    moved: Vec<u64>,
    pub(super) now: u64,
}

impl<'a, const W: usize> Held<'a, W> {
    #[inline(always)]
    pub(super) fn new(apart: &'a [Set<W>], weights: &'a [u64], start: &[usize]) -> Self {
        let mut held = Self {
            weights,
            counted: weights.iter().all(|&w| w == 1),
            apart,
            all: full(apart.len()),
            members: empty(),
            missing: Tally::new(),
            weight: 0,
            moved: vec![0; apart.len()],
            now: 0,
        };
        start.iter().for_each(|&v| held.add(v));
        held
    }

    pub(super) fn weight(&self) -> u64 {
        self.weight
    }

    /// The clique.
    #[inline(always)]
    pub(super) fn members(&self) -> Set<W> {
        self.members
    }

    /// Number of vertices of the clique.
    #[inline(always)]
    pub(super) fn size(&self) -> usize {
        count(&self.members) as usize
    }

    /// Vertices that can be added, and those that can be swapped in for one member.
    #[inline(always)]
    pub(super) fn open(&self) -> (Set<W>, Set<W>) {
        let (odd, many) = self.missing.odd_and_many();
        let fit = and_not(&self.all, &or(&self.members, &or(&odd, &many)));
        (fit, and_not(&odd, &many))
    }

    /// Step at which a vertex was last added or dropped.
    #[inline(always)]
    pub(super) fn moved(&self, v: usize) -> u64 {
        self.moved[v]
    }

    /// What the clique would weigh more with `v`, which can be added or swapped in.
    #[inline(always)]
    pub(super) fn gain(&self, v: usize, swapped: Swapped) -> i64 {
        let lost = match swapped {
            Swapped::Nothing => 0,
            Swapped::One if self.counted => 1,
            Swapped::One => self.misses(v).map_or(0, |u| self.weights[u]),
        };
        self.weights[v] as i64 - lost as i64
    }

    /// A member that `v` is not joined to.
    #[inline(always)]
    pub(super) fn misses(&self, v: usize) -> Option<usize> {
        first(&and(&self.members, &self.apart[v]))
    }

    /// The vertex outside that rested longest.
    #[inline(always)]
    pub(super) fn longest_outside(&self) -> Option<usize> {
        members(and_not(&self.all, &self.members)).min_by_key(|&v| (self.moved[v], v))
    }

    /// Adds `v` and drops the members it is not joined to.
    #[inline(always)]
    pub(super) fn swap_in(&mut self, v: usize) {
        while let Some(u) = self.misses(v) {
            self.drop(u);
        }
        self.add(v);
    }

    #[inline(always)]
    fn add(&mut self, v: usize) {
        put(&mut self.members, v);
        self.moved[v] = self.now;
        self.weight += self.weights[v];
        self.missing.add(&self.apart[v], 1);
    }

    #[inline(always)]
    pub(super) fn drop(&mut self, v: usize) {
        drop(&mut self.members, v);
        self.moved[v] = self.now;
        self.weight -= self.weights[v];
        self.missing.subtract(&self.apart[v], 1);
    }
}

/// What leaves the clique for a vertex.
#[derive(Clone, Copy)]
pub(super) enum Swapped {
    Nothing,
    One,
}

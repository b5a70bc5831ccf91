use super::budget::Meter;
use super::held::Held;
use super::rows::{Set, and_not, drop, empty, members, put};

/// A large clique, found by a search that learns which vertices lead it astray.
///
/// The clique grows, then swaps as long as it shares a vertex with the one it was; then all its members get a penalty
/// and all but the last go. Of the vertices that fit, one with the least penalty moves, of several the one that rested
/// longest. Cliques whose vertices have few neighbours, which greedy moves pass by, are found this way. Now and then
/// penalties decay: as often as keeps three vertices in four penalised.
///
/// Stops at `enough` vertices, after `steps`, or with the budget. Deterministic.
///
/// **Source**: Pullan and Hoos, *Dynamic Local Search for the Maximum Clique Problem*, 2006; the share of penalised
/// vertices is that of Pullan, *Phased local search for the maximum clique problem*, 2006. Ties are random there.
pub(super) fn search<const W: usize>(
    apart: &[Set<W>],
    steps: u64,
    enough: u64,
    meter: &mut Meter,
) -> Vec<usize> {
    let (n, ones) = (apart.len(), vec![1; apart.len()]);
    let mut search = Penalties {
        held: Held::new(apart, &ones, &[]),
        steps,
        enough,
        penalty: vec![0; n],
        used: empty(),
        last: 0,
        delay: 2,
        rounds: 0,
        best: empty(),
        largest: 0,
    };
    while search.goes_on() && meter.look() {
        search.climb();
        search.penalise();
        search.restart();
    }
    members(search.best).collect()
}

/// Share of the vertices that are to have a penalty.
const PENALISED: f64 = 0.75;

struct Penalties<'a, const W: usize> {
    held: Held<'a, W>,
    steps: u64,
    enough: u64,
    penalty: Vec<u32>,
    /// Vertices that moved in this round; each moves once a round.
    used: Set<W>,
    last: usize,
    /// Rounds from one decay to the next, and those since the last.
    delay: u64,
    rounds: u64,
    best: Set<W>,
    largest: usize,
}

impl<const W: usize> Penalties<'_, W> {
    fn goes_on(&self) -> bool {
        self.held.now < self.steps && (self.largest as u64) < self.enough
    }

    /// Adds and swaps vertices until none may move or nothing is left of the clique.
    fn climb(&mut self) {
        loop {
            while let Some(v) = self.pick(self.held.open().0) {
                self.put_in(v);
            }
            let (since, mut shared) = (self.held.now, self.held.size());
            if shared > self.largest {
                (self.best, self.largest) = (self.held.members(), shared);
            }
            while shared > 0
                && self.pick(self.held.open().0).is_none()
                && let Some(v) = self.pick(self.held.open().1)
            {
                let Some(gone) = self.held.misses(v) else { break };
                shared -= usize::from(self.held.moved(gone) <= since);
                put(&mut self.used, gone);
                self.put_in(v);
            }
            if !self.goes_on() || self.pick(self.held.open().0).is_none() {
                return;
            }
        }
    }

    fn pick(&self, among: Set<W>) -> Option<usize> {
        members(and_not(&among, &self.used)).min_by_key(|&v| (self.penalty[v], self.held.moved(v), v))
    }

    fn put_in(&mut self, v: usize) {
        self.held.now += 1;
        self.held.swap_in(v);
        put(&mut self.used, v);
        self.last = v;
    }

    fn penalise(&mut self) {
        members(self.held.members()).for_each(|v| self.penalty[v] += 1);
        self.rounds += 1;
        if self.rounds < self.delay {
            return;
        }
        self.rounds = 0;
        self.penalty.iter_mut().for_each(|penalty| *penalty = penalty.saturating_sub(1));
        let penalised = self.penalty.iter().filter(|&&penalty| penalty > 0).count() as f64;
        if penalised < PENALISED * self.penalty.len() as f64 {
            self.delay += 1;
        } else if self.delay > 1 {
            self.delay -= 1;
        }
    }

    /// Leaves the vertex that came in last; without penalties that last, brings one in that rested.
    fn restart(&mut self) {
        self.used = empty();
        self.held.now += 1;
        if self.delay > 1 {
            let mut gone = self.held.members();
            drop(&mut gone, self.last);
            members(gone).for_each(|v| self.held.drop(v));
        } else if let Some(v) = self.held.longest_outside() {
            self.held.swap_in(v);
            self.last = v;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::complement;
    use super::*;
    use crate::clique::{Budget, maximum};
    use crate::graph::{Adjacency, Graph};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Random edges, and a clique of the first `hidden` vertices, which have fewer neighbours than the others.
    fn with_hidden_clique(n: usize, hidden: usize, rng: &mut ChaCha8Rng) -> Graph {
        let density = |a: usize, b: usize| match (a < hidden, b < hidden) {
            (true, true) => 1.0,
            (false, false) => 0.7,
            _ => 0.55,
        };
        let pairs = (0..n).flat_map(|a| (0..a).map(move |b| (a, b)));
        let edges: Vec<(usize, usize)> = pairs.filter(|&(a, b)| rng.random_bool(density(a, b))).collect();
        Graph::from_edges(n, edges).unwrap()
    }

    #[test]
    fn hidden_cliques_are_found() {
        for seed in 0..10 {
            let graph = with_hidden_clique(100, 15, &mut ChaCha8Rng::seed_from_u64(seed));
            let best = maximum(&graph, &Budget::UNLIMITED).value;
            let found = search(&complement::<2>(graph.matrix()), 50_000, 100, &mut Meter::unlimited());
            assert!(graph.is_clique(&found) && found.len() == best, "seed {seed}: {} of {best}", found.len());
        }
    }

    #[test]
    fn degenerate_graphs_end() {
        for n in 0..4 {
            let empty = Graph::from_edges(n, []).unwrap();
            let found = search(&complement::<2>(empty.matrix()), 100, 9, &mut Meter::unlimited());
            assert_eq!(found.len(), n.min(1));
            let complete = Graph::from_edges(n, (0..n).flat_map(|a| (0..a).map(move |b| (a, b)))).unwrap();
            let found = search(&complement::<2>(complete.matrix()), 100, 9, &mut Meter::unlimited());
            assert_eq!(found.len(), n);
        }
    }
}

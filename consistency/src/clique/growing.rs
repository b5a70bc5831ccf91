use pulp::{Arch, NullaryFnOnce};

use super::budget::{Budget, Meter};
use super::dense;
use super::fixed_point::FixedPoint;
use super::maximum::{self, DENSE_LIMIT};
use super::outcome::Outcome;
use crate::Error;
use crate::graph::{Adjacency, Graph, bits};

/// A graph that changes step by step while its heaviest clique stays known.
///
/// After each step only cliques that the step could have made better are searched: through a new vertex or edge, or
/// one that became heavier. When the best clique itself loses weight, all others are searched for one that beats what
/// is left, and the search stops where the old weight is reached again.
#[derive(Clone, Debug)]
pub(super) struct Growing {
    graph: Graph,
    deleted: Vec<bool>,
    best: Outcome<f64>,
    budget: Budget,
    /// Whether all weights are one.
    counted: bool,
    /// Number of neighbours of each vertex.
    degree: Vec<usize>,
    arch: Arch,
}

/// No weight at which a search could stop early.
const NO_LIMIT: u64 = u64::MAX;

impl Growing {
    pub(super) fn new(budget: Budget, counted: bool) -> Self {
        let best = Outcome { vertices: Vec::new(), value: 0.0, upper_bound: 0.0, optimal: true, nodes: 0 };
        Self {
            graph: Graph::default(),
            deleted: Vec::new(),
            best,
            budget,
            counted,
            degree: Vec::new(),
            arch: Arch::new(),
        }
    }

    pub(super) fn graph(&self) -> &Graph {
        &self.graph
    }

    pub(super) fn best(&self) -> &Outcome<f64> {
        &self.best
    }

    pub(super) fn insert(&mut self, neighbors: &[usize], weight: f64) -> Result<(), Error> {
        self.check(neighbors)?;
        let vertex = self.graph.len();
        if !(weight.is_finite() && weight >= 0.0) {
            return Err(Error::BadWeight { vertex, weight });
        }
        let v = self.graph.add_vertex()?;
        self.deleted.push(false);
        self.degree.push(0);
        self.graph.set_weight(v, weight)?;
        let degree = &mut self.degree;
        self.graph.join_all(v, neighbors, |u| [u, v].iter().for_each(|&w| degree[w] += 1));
        self.search_through(&[v], weight);
        Ok(())
    }

    pub(super) fn add_edge(&mut self, a: usize, b: usize) -> Result<(), Error> {
        self.check(&[a, b])?;
        if self.join(a, b)? {
            // A clique with both was one without either of them before.
            self.search_through(&[a, b], self.graph.weight(a).min(self.graph.weight(b)));
        }
        Ok(())
    }

    pub(super) fn remove_edge(&mut self, a: usize, b: usize) -> Result<(), Error> {
        self.check(&[a, b])?;
        let broken = self.part(a, b)? && self.best.vertices.contains(&a) && self.best.vertices.contains(&b);
        self.best.nodes = 0;
        if broken {
            let lighter = if self.graph.weight(a) <= self.graph.weight(b) { a } else { b };
            self.best.vertices.retain(|&v| v != lighter);
            self.search_all();
        }
        Ok(())
    }

    pub(super) fn remove(&mut self, vertex: usize) -> Result<(), Error> {
        self.check(&[vertex])?;
        let neighbors: Vec<usize> = self.graph.neighbors(vertex).collect();
        for u in neighbors {
            self.part(vertex, u)?;
        }
        self.deleted[vertex] = true;
        self.best.nodes = 0;
        if self.best.vertices.contains(&vertex) {
            self.best.vertices.retain(|&v| v != vertex);
            self.search_all();
        }
        Ok(())
    }

    pub(super) fn set_weight(&mut self, vertex: usize, weight: f64) -> Result<(), Error> {
        self.check(&[vertex])?;
        let before = self.graph.weight(vertex);
        self.graph.set_weight(vertex, weight)?;
        self.best.nodes = 0;
        let inside = self.best.vertices.contains(&vertex);
        if weight > before && inside {
            // No clique gained more than this one.
            self.best.value = self.graph.total_weight(&self.best.vertices);
            let upper = if self.best.optimal { 0.0 } else { self.best.upper_bound + (weight - before) };
            self.best.upper_bound = upper.max(self.best.value);
        } else if weight > before {
            self.search_through(&[vertex], weight - before);
        } else if weight < before && inside {
            self.search_all();
        }
        Ok(())
    }

    fn join(&mut self, a: usize, b: usize) -> Result<bool, Error> {
        let new = self.graph.add_edge(a, b)?;
        [a, b].iter().for_each(|&v| self.degree[v] += usize::from(new));
        Ok(new)
    }

    fn part(&mut self, a: usize, b: usize) -> Result<bool, Error> {
        let had = self.graph.remove_edge(a, b)?;
        [a, b].iter().for_each(|&v| self.degree[v] -= usize::from(had));
        Ok(had)
    }

    /// Searches cliques that hold all of `fixed`; no clique can have gained more than `gain`.
    fn search_through(&mut self, fixed: &[usize], gain: f64) {
        let mut meter = Meter::new(&self.budget);
        let was_optimal = self.best.optimal;
        let upper = self.best.upper_bound + gain;
        let joined = |u: &usize| fixed.iter().all(|&f| *u == f || self.graph.has_edge(*u, f));
        if self.best.vertices.iter().all(joined) {
            // The best clique takes them in and gains all that any clique can have gained; it is a clique still.
            let new: Vec<usize> = fixed.iter().filter(|f| !self.best.vertices.contains(f)).copied().collect();
            self.best.vertices.extend(new);
            self.best.vertices.sort_unstable();
            self.best.value = self.graph.total_weight(&self.best.vertices);
        } else {
            // Most vertices have too few neighbours for a larger clique.
            let few = self.counted && fixed.iter().any(|&f| self.degree[f] < self.best.vertices.len());
            let around = if few { Vec::new() } else { self.around(fixed) };
            let better = self.within(around, fixed, upper, &mut meter);
            self.settle(better);
        }
        self.bound(if was_optimal && !meter.stopped { self.best.value } else { upper }, &meter);
    }

    /// Searches all cliques after the best one lost weight.
    fn search_all(&mut self) {
        let mut meter = Meter::new(&self.budget);
        let upper = self.best.upper_bound;
        self.best.value = self.graph.total_weight(&self.best.vertices);
        let alive: Vec<usize> = (0..self.graph.len()).filter(|&v| !self.deleted[v]).collect();
        let better = self.within(alive, &[], upper, &mut meter);
        self.settle(better);
        self.bound(if meter.stopped { upper } else { self.best.value }, &meter);
    }

    /// The vertices that are joined to all of `fixed`, ascending.
    fn around(&self, fixed: &[usize]) -> Vec<usize> {
        let mut common = self.graph.row(fixed[0]).to_vec();
        for &f in &fixed[1..] {
            common.iter_mut().zip(self.graph.row(f)).for_each(|(word, row)| *word &= row);
        }
        bits::iter(&common).collect()
    }

    /// A clique better than the best one: `fixed`, and others out of `among`, which are joined to all of those.
    fn within(
        &self,
        among: Vec<usize>,
        fixed: &[usize],
        upper: f64,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        if self.counted {
            self.larger_within(among, fixed, upper as usize, meter)
        } else {
            self.heavier_within(among, fixed, meter)
        }
    }

    /// The same where vertices are counted; no clique has more than `upper`.
    fn larger_within(
        &self,
        mut among: Vec<usize>,
        fixed: &[usize],
        upper: usize,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let (known, own) = (self.best.vertices.len(), fixed.len());
        let lower = known.saturating_sub(own);
        let enough = upper.saturating_sub(own).max(1);
        let ends = self.thin(&mut among, own, lower);
        let n = among.len();
        let found = if n <= lower {
            None
        } else if n > DENSE_LIMIT {
            maximum::larger_of(&self.graph.matrix().select(&among), lower, enough, meter)
        } else if dense::is_near_clique(n, (n * (n - 1) - ends) / 2) {
            let inside = |v: &usize| among.binary_search(v).ok();
            let start = || self.best.vertices.iter().filter_map(inside).collect();
            dense::larger_near(&self.graph.matrix().apart(&among), &start, lower, enough, meter)
        } else {
            let matrix = self.graph.matrix().select(&among);
            dense::heavier_at_once(&matrix, &vec![1; n], lower as u64, enough as u64, meter)
        };
        match found {
            Some(found) => Some(named(&found, &among, fixed)),
            None => (own > known).then(|| fixed.to_vec()),
        }
    }

    /// The same where vertices are weighed.
    fn heavier_within(
        &self,
        mut among: Vec<usize>,
        fixed: &[usize],
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let scale = FixedPoint::for_weights((0..self.graph.len()).map(|v| self.graph.weight(v)));
        let integer = |v: usize| scale.to_integer(self.graph.weight(v));
        let weigh = |vertices: &[usize]| vertices.iter().map(|&v| integer(v)).sum::<u64>();
        let (known, own) = (weigh(&self.best.vertices), weigh(fixed));
        let lower = known.saturating_sub(own);
        self.thin_weighed(&mut among, integer, lower);
        let weights: Vec<u64> = among.iter().map(|&v| integer(v)).collect();
        let found = if weights.iter().sum::<u64>() <= lower {
            None
        } else if among.len() > DENSE_LIMIT {
            maximum::heavier(&self.graph.matrix().select(&among), &weights, lower, meter)
        } else {
            let matrix = self.graph.matrix().select(&among);
            dense::heavier_at_once(&matrix, &weights, lower, NO_LIMIT, meter)
        };
        match found {
            Some(found) => Some(named(&found, &among, fixed)),
            None => (own > known).then(|| fixed.to_vec()),
        }
    }

    /// Takes vertices out of `among`, all joined to `fixed` others, that are joined to fewer than `lower` of it.
    /// Returns the number of ends of edges among the rest.
    fn thin(&self, among: &mut Vec<usize>, fixed: usize, lower: usize) -> usize {
        // Most vertices have too few neighbours altogether.
        among.retain(|&v| self.degree[v] >= lower + fixed);
        if among.len() <= lower {
            among.clear();
            return 0;
        }
        self.arch.dispatch(Thin { graph: &self.graph, among, lower })
    }

    /// Takes vertices out of `among` that are joined to too little weight in it for a clique heavier than `lower`.
    fn thin_weighed(&self, among: &mut Vec<usize>, integer: impl Fn(usize) -> u64, lower: u64) {
        let mut open = set_of(&self.graph, among);
        let mut before = usize::MAX;
        while among.len() < before {
            before = among.len();
            among.retain(|&v| {
                let near: Vec<u64> =
                    self.graph.row(v).iter().zip(&open).map(|(row, open)| row & open).collect();
                let keep = integer(v) + bits::iter(&near).map(&integer).sum::<u64>() > lower;
                if !keep {
                    bits::remove(&mut open, v);
                }
                keep
            });
        }
    }

    fn settle(&mut self, better: Option<Vec<usize>>) {
        if let Some(mut vertices) = better {
            vertices.sort_unstable();
            assert!(self.graph.is_clique(&vertices), "the set found is not a clique");
            self.best.value = self.graph.total_weight(&vertices);
            self.best.vertices = vertices;
        }
    }

    fn bound(&mut self, upper: f64, meter: &Meter) {
        self.best.upper_bound = upper.max(self.best.value);
        self.best.optimal = self.best.upper_bound == self.best.value;
        self.best.nodes = meter.nodes;
    }

    fn check(&self, vertices: &[usize]) -> Result<(), Error> {
        match vertices.iter().find(|&&v| self.deleted.get(v) != Some(&false)) {
            Some(&vertex) => Err(Error::UnknownVertex { vertex, vertices: self.graph.len() }),
            None => Ok(()),
        }
    }
}

/// A set found in a part of a graph by its own names, and `fixed`.
fn named(found: &[usize], part: &[usize], fixed: &[usize]) -> Vec<usize> {
    found.iter().map(|&u| part[u]).chain(fixed.iter().copied()).collect()
}

fn set_of(graph: &Graph, vertices: &[usize]) -> Vec<u64> {
    let mut set = vec![0; graph.matrix().words()];
    vertices.iter().for_each(|&v| bits::insert(&mut set, v));
    set
}

/// Takes vertices out of `among` that are joined to fewer than `lower` of it, until none is left; returns the number
/// of ends of edges among those that stay.
struct Thin<'a> {
    graph: &'a Graph,
    among: &'a mut Vec<usize>,
    lower: usize,
}

impl NullaryFnOnce for Thin<'_> {
    type Output = usize;

    #[inline(always)]
    fn call(self) -> usize {
        let Self { graph, among, lower } = self;
        let mut open = set_of(graph, among);
        let (mut before, mut ends) = (usize::MAX, 0);
        while among.len() < before {
            before = among.len();
            ends = 0;
            // A plain loop: the closure of `retain` would not get the instructions that count bits.
            let mut kept = 0;
            for i in 0..before {
                let v = among[i];
                let row = graph.row(v).iter().zip(&open);
                let near = row.map(|(row, open)| (row & open).count_ones() as usize).sum::<usize>();
                if near >= lower {
                    among[kept] = v;
                    kept += 1;
                    ends += near;
                } else {
                    bits::remove(&mut open, v);
                }
            }
            among.truncate(kept);
            if among.len() <= lower {
                among.clear();
            }
        }
        ends
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use cpu_time::ThreadTime;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::graph::Adjacency;

    impl Growing {
        /// As if all of `graph` had been inserted and only a greedy clique found.
        fn of(graph: Graph, budget: Budget) -> Self {
            let degree = (0..graph.len()).map(|v| graph.degree(v)).collect();
            let upper_bound = (0..graph.len()).map(|v| graph.weight(v)).sum();
            let mut vertices: Vec<usize> = Vec::new();
            for v in 0..graph.len() {
                if vertices.iter().all(|&u| graph.has_edge(u, v)) {
                    vertices.push(v);
                }
            }
            let value = graph.total_weight(&vertices);
            let best = Outcome { vertices, value, upper_bound, optimal: false, nodes: 0 };
            Self { deleted: vec![false; graph.len()], degree, best, graph, ..Self::new(budget, false) }
        }
    }

    #[test]
    fn weighed_inserts_into_thousands_nearly_all_joined_keep_their_budget() {
        const N: usize = 3_000;
        let rng = &mut rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let mut graph = Graph::new(N).unwrap();
        for v in 0..N {
            graph.set_weight(v, (v * 37 % 200 + 1) as f64).unwrap();
            let near: Vec<usize> = (0..v).filter(|_| rng.random_bool(0.998)).collect();
            graph.join_all(v, &near, |_| ());
        }
        let mut cliques = Growing::of(graph, Budget::time(Duration::from_millis(50)));
        for _ in 0..4 {
            let near: Vec<usize> = (0..cliques.graph.len()).filter(|_| rng.random_bool(0.998)).collect();
            let start = ThreadTime::now();
            cliques.insert(&near, 100.0).unwrap();
            // The last step is not cut short, and this may be a slow build.
            assert!(start.elapsed() < Duration::from_secs(4), "{:?}", start.elapsed());
            let best = cliques.best();
            assert!(cliques.graph.is_clique(&best.vertices) && best.value <= best.upper_bound);
        }
    }
}

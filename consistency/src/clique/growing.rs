use super::budget::{Budget, Meter};
use super::dense;
use super::fixed_point::FixedPoint;
use super::outcome::Outcome;
use super::rows::BitMatrix;
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
}

/// No weight at which a search could stop early.
const NO_LIMIT: u64 = u64::MAX;

impl Growing {
    pub(super) fn new(budget: Budget, counted: bool) -> Self {
        let best = Outcome { vertices: Vec::new(), value: 0.0, upper_bound: 0.0, optimal: true, nodes: 0 };
        Self { graph: Graph::default(), deleted: Vec::new(), best, budget, counted }
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
        self.graph.set_weight(v, weight)?;
        for &u in neighbors {
            self.graph.add_edge(v, u)?;
        }
        self.search_through(&[v], weight);
        Ok(())
    }

    pub(super) fn add_edge(&mut self, a: usize, b: usize) -> Result<(), Error> {
        self.check(&[a, b])?;
        if self.graph.add_edge(a, b)? {
            // A clique with both was one without either of them before.
            self.search_through(&[a, b], self.graph.weight(a).min(self.graph.weight(b)));
        }
        Ok(())
    }

    pub(super) fn remove_edge(&mut self, a: usize, b: usize) -> Result<(), Error> {
        self.check(&[a, b])?;
        let broken = self.graph.remove_edge(a, b)?
            && self.best.vertices.contains(&a)
            && self.best.vertices.contains(&b);
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
            self.graph.remove_edge(vertex, u)?;
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
            let around = self.graph.neighbors(fixed[0]).filter(|u| !fixed.contains(u) && joined(u));
            let better = self.within(around.collect(), fixed, upper, &mut meter);
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

    /// A clique heavier than the best one: `fixed`, and others out of `among`, which are joined to all of those.
    fn within(
        &self,
        mut among: Vec<usize>,
        fixed: &[usize],
        upper: f64,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let scale = if self.counted { FixedPoint::ONE } else { self.scale() };
        let integer = |v: usize| scale.to_integer(self.graph.weight(v));
        let weigh = |vertices: &[usize]| vertices.iter().map(|&v| integer(v)).sum::<u64>();
        let (known, own) = (weigh(&self.best.vertices), weigh(fixed));
        let lower = known.saturating_sub(own);
        let enough = if self.counted { (upper as u64).saturating_sub(own).max(1) } else { NO_LIMIT };
        self.thin(&mut among, integer, lower);
        let weights: Vec<u64> = among.iter().map(|&v| integer(v)).collect();
        let found = if weights.iter().sum::<u64>() <= lower {
            None
        } else {
            dense::heavier_at_once(&BitMatrix::within(&self.graph, &among), &weights, lower, enough, meter)
        };
        match found {
            Some(found) => Some(found.into_iter().map(|u| among[u]).chain(fixed.iter().copied()).collect()),
            None => (own > known).then(|| fixed.to_vec()),
        }
    }

    /// Takes vertices out of `among` that are joined to too few others of it to be in a clique heavier than `lower`.
    fn thin(&self, among: &mut Vec<usize>, integer: impl Fn(usize) -> u64, lower: u64) {
        let mut open = vec![0; self.graph.row(0).len()];
        among.iter().for_each(|&v| bits::insert(&mut open, v));
        let mut before = usize::MAX;
        while among.len() < before {
            before = among.len();
            among.retain(|&v| {
                let near = || self.graph.row(v).iter().zip(&open).map(|(row, open)| row & open);
                let reach = if self.counted {
                    1 + near().map(|word| u64::from(word.count_ones())).sum::<u64>()
                } else {
                    let near: Vec<u64> = near().collect();
                    integer(v) + bits::iter(&near).map(&integer).sum::<u64>()
                };
                let keep = reach > lower;
                if !keep {
                    bits::remove(&mut open, v);
                }
                keep
            });
        }
    }

    fn scale(&self) -> FixedPoint {
        FixedPoint::for_weights((0..self.graph.len()).map(|v| self.graph.weight(v)))
    }

    fn settle(&mut self, better: Option<Vec<usize>>) {
        if let Some(mut vertices) = better {
            vertices.sort_unstable();
            assert!(self.graph.is_clique(&vertices), "the set found is not a clique");
            self.best.vertices = vertices;
        }
        self.best.value = self.graph.total_weight(&self.best.vertices);
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

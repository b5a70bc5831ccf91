use super::budget::{Budget, Meter};
use super::dense;
use super::outcome::Outcome;
use super::rows::BitMatrix;
use crate::Error;
use crate::graph::{Adjacency, Graph};

/// A graph that grows and shrinks while its largest clique stays known.
///
/// A new vertex can only improve the answer by a clique through itself, one vertex larger than before; most inserts
/// are settled by looking at degrees alone. Deleting a vertex outside the answer changes nothing; one inside lowers
/// the size by at most one, so the search stops at the first clique of the old size.
///
/// ```
/// use draco_consistency::clique::{Budget, Incremental};
/// let mut cliques = Incremental::new(Budget::UNLIMITED);
/// cliques.insert(&[])?;
/// cliques.insert(&[0])?;
/// assert_eq!(cliques.insert(&[0, 1])?.vertices, [0, 1, 2]);
/// assert_eq!(cliques.remove(1)?.vertices, [0, 2]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Incremental {
    graph: Graph,
    deleted: Vec<bool>,
    best: Outcome,
    budget: Budget,
}

impl Incremental {
    /// Without vertices; each step may use `budget`.
    pub fn new(budget: Budget) -> Self {
        let best = Outcome { vertices: Vec::new(), value: 0, upper_bound: 0, optimal: true, nodes: 0 };
        Self { graph: Graph::default(), deleted: Vec::new(), best, budget }
    }

    /// The graph; deleted vertices are still numbered but have no edges.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// The largest clique known; `nodes` counts the last step.
    pub fn best(&self) -> &Outcome {
        &self.best
    }

    /// Adds a vertex, numbered next, with edges to `neighbors`.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] for a neighbour that does not exist or was deleted, [`Error::TooManyVertices`]; the
    /// vertex is then not added.
    pub fn insert(&mut self, neighbors: &[usize]) -> Result<&Outcome, Error> {
        self.check(neighbors)?;
        let v = self.graph.add_vertex()?;
        self.deleted.push(false);
        for &u in neighbors {
            self.graph.add_edge(v, u)?;
        }
        let mut meter = Meter::new(&self.budget);
        let known = self.best.value;
        let better = self.through(v, known, &mut meter);
        // A clique through the new vertex is at most one larger than the bound before.
        let upper = match (&better, meter.stopped) {
            (Some(_), _) => self.best.upper_bound + 1,
            (None, false) if self.best.optimal => known,
            _ => self.best.upper_bound + 1,
        };
        self.settle(better, upper, &meter);
        Ok(&self.best)
    }

    /// Adds the edge between two vertices.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`].
    pub fn add_edge(&mut self, a: usize, b: usize) -> Result<&Outcome, Error> {
        self.check(&[a, b])?;
        if !self.graph.add_edge(a, b)? {
            return Ok(&self.best);
        }
        let mut meter = Meter::new(&self.budget);
        let common: Vec<usize> = self.graph.neighbors(a).filter(|&u| self.graph.has_edge(b, u)).collect();
        let better = self.within(&common, &[a, b], self.best.value, &mut meter);
        let upper = if better.is_some() || meter.stopped || !self.best.optimal {
            self.best.upper_bound + 1
        } else {
            self.best.value
        };
        self.settle(better, upper, &meter);
        Ok(&self.best)
    }

    /// Takes the edge between two vertices away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`].
    pub fn remove_edge(&mut self, a: usize, b: usize) -> Result<&Outcome, Error> {
        self.check(&[a, b])?;
        let broken = self.graph.remove_edge(a, b)?
            && self.best.vertices.contains(&a)
            && self.best.vertices.contains(&b);
        if broken {
            self.repair(a);
        }
        Ok(&self.best)
    }

    /// Takes a vertex and its edges away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] if it does not exist or was deleted before.
    pub fn remove(&mut self, vertex: usize) -> Result<&Outcome, Error> {
        self.check(&[vertex])?;
        let neighbors: Vec<usize> = self.graph.neighbors(vertex).collect();
        for u in neighbors {
            self.graph.remove_edge(vertex, u)?;
        }
        self.deleted[vertex] = true;
        if self.best.vertices.contains(&vertex) {
            self.repair(vertex);
        } else {
            self.best.nodes = 0;
        }
        Ok(&self.best)
    }

    /// Searches again after `gone` left the best clique: only the old size could be better than what is left.
    fn repair(&mut self, gone: usize) {
        let mut meter = Meter::new(&self.budget);
        let upper = self.best.upper_bound;
        self.best.vertices.retain(|&v| v != gone);
        self.best.value = self.best.vertices.len();
        let alive: Vec<usize> = (0..self.graph.len()).filter(|&v| !self.deleted[v]).collect();
        let better = self.within(&alive, &[], self.best.value, &mut meter);
        let found = better.as_ref().map_or(self.best.value, Vec::len);
        let upper = if meter.stopped { upper } else { found };
        self.settle(better, upper, &meter);
    }

    /// A clique through `v` of more than `lower` vertices.
    fn through(&self, v: usize, lower: usize, meter: &mut Meter) -> Option<Vec<usize>> {
        let around: Vec<usize> = self.graph.neighbors(v).collect();
        if self.best.vertices.iter().all(|&u| self.graph.has_edge(u, v)) {
            return Some(self.best.vertices.iter().copied().chain([v]).collect());
        }
        self.within(&around, &[v], lower, meter)
    }

    /// A clique of more than `lower` vertices: `fixed`, and others out of `among`, which are joined to all of those.
    fn within(
        &self,
        among: &[usize],
        fixed: &[usize],
        lower: usize,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let Some(rest) = lower.checked_sub(fixed.len()) else { return Some(fixed.to_vec()) };
        let enough = (self.best.upper_bound + 1).saturating_sub(fixed.len()).max(1);
        if among.len() <= rest {
            return None;
        }
        let matrix = BitMatrix::induced(&self.graph, among);
        let found = dense::larger(&matrix, rest, enough, meter)?;
        Some(found.into_iter().map(|u| among[u]).chain(fixed.iter().copied()).collect())
    }

    fn settle(&mut self, better: Option<Vec<usize>>, upper: usize, meter: &Meter) {
        if let Some(mut vertices) = better {
            vertices.sort_unstable();
            assert!(self.graph.is_clique(&vertices), "the set found is not a clique");
            self.best.value = vertices.len();
            self.best.vertices = vertices;
        }
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

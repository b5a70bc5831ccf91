use super::maximum::finish;
use super::search::Search;
use crate::Error;
use crate::clique::{Budget, Meter, Outcome};
use crate::graph::{Hypergraph, bits, hypergraph::Combinations};

/// A hypergraph that grows and shrinks while its largest hyperclique stays known.
///
/// A new vertex can only improve the answer by a hyperclique through itself, so only those are searched; deleting a
/// vertex outside the answer changes nothing, and one inside lowers the size by at most one.
#[derive(Clone, Debug)]
pub struct Incremental {
    graph: Hypergraph,
    deleted: Vec<bool>,
    best: Outcome,
    budget: Budget,
}

impl Incremental {
    /// Without vertices, for edges of `order` vertices; each step may use `budget`.
    ///
    /// # Errors
    /// [`Error::EdgeOrder`] for an order below two.
    pub fn new(order: usize, budget: Budget) -> Result<Self, Error> {
        let graph = Hypergraph::new(0, order)?;
        let best = Outcome { vertices: Vec::new(), value: 0, upper_bound: 0, optimal: true, nodes: 0 };
        Ok(Self { graph, deleted: Vec::new(), best, budget })
    }

    /// The hypergraph; deleted vertices are still numbered but have no edges.
    pub fn graph(&self) -> &Hypergraph {
        &self.graph
    }

    /// The largest hyperclique known, `nodes` counting the last step.
    pub fn best(&self) -> &Outcome {
        &self.best
    }

    /// Adds a vertex that forms an edge with each of `partners`, sets of `k - 1` vertices.
    ///
    /// # Errors
    /// [`Error::EdgeOrder`], [`Error::UnknownVertex`], [`Error::SelfLoop`], [`Error::TooManyVertices`]; the vertex is
    /// then not added.
    pub fn insert<E: AsRef<[usize]>>(
        &mut self,
        partners: impl IntoIterator<Item = E>,
    ) -> Result<&Outcome, Error> {
        let (v, order) = (self.graph.len(), self.graph.order());
        // One edge after the other, each in ascending order.
        let mut edges: Vec<usize> = Vec::new();
        for set in partners {
            let set = set.as_ref();
            if let Some(&vertex) = set.iter().find(|&&u| u >= v || self.deleted[u]) {
                return Err(Error::UnknownVertex { vertex, vertices: v });
            }
            if set.len() + 1 != order {
                return Err(Error::EdgeOrder { order, given: set.len() + 1 });
            }
            let begin = edges.len();
            edges.extend_from_slice(set);
            edges[begin..].sort_unstable();
            if let Some(twice) = edges[begin..].windows(2).find(|w| w[0] == w[1]) {
                return Err(Error::SelfLoop { vertex: twice[0] });
            }
            edges.push(v);
        }
        self.graph.add_vertex()?;
        self.deleted.push(false);
        edges.chunks_exact(order).for_each(|edge| self.graph.join(edge));
        let mut meter = Meter::new(&self.budget);
        let upper = self.best.upper_bound + 1;
        let mut search = Search::new(&self.graph, self.alive(), Some(v), self.best.value, &mut meter);
        search.target = upper;
        let better = search.run();
        let known = std::mem::take(&mut self.best.vertices);
        let was_optimal = self.best.optimal;
        self.best = finish(&self.graph, better.unwrap_or(known), upper, &meter);
        if !was_optimal && !self.best.optimal {
            self.best.upper_bound = self.best.upper_bound.max(upper);
        } else if !was_optimal {
            // Only hypercliques through the new vertex were searched.
            self.best.upper_bound = upper.max(self.best.value);
            self.best.optimal = self.best.upper_bound == self.best.value;
        }
        Ok(&self.best)
    }

    fn alive(&self) -> Vec<u64> {
        let mut alive = vec![0; self.graph.words()];
        (0..self.graph.len()).filter(|&v| !self.deleted[v]).for_each(|v| bits::insert(&mut alive, v));
        alive
    }

    /// Takes a vertex and all its edges away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] if it does not exist or was deleted before.
    pub fn remove(&mut self, vertex: usize) -> Result<&Outcome, Error> {
        if self.deleted.get(vertex) != Some(&false) {
            return Err(Error::UnknownVertex { vertex, vertices: self.graph.len() });
        }
        let mut sets = Combinations::new(self.graph.len(), self.graph.order() - 1);
        let mut gone = Vec::new();
        while let Some(set) = sets.next() {
            if bits::has(self.graph.row(set), vertex) {
                gone.push([set, &[vertex]].concat());
            }
        }
        for edge in &gone {
            self.graph.remove_edge(edge)?;
        }
        self.deleted[vertex] = true;
        let upper = self.best.upper_bound;
        let mut meter = Meter::new(&self.budget);
        let mut known = std::mem::take(&mut self.best.vertices);
        if known.contains(&vertex) {
            known.retain(|&v| v != vertex);
            let mut search = Search::new(&self.graph, self.alive(), None, known.len(), &mut meter);
            search.target = upper;
            known = search.run().unwrap_or(known);
            self.best = finish(&self.graph, known, upper, &meter);
        } else {
            self.best.vertices = known;
            self.best.nodes = 0;
        }
        Ok(&self.best)
    }
}

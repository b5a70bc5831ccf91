use super::budget::Budget;
use super::growing::Growing;
use super::outcome::Outcome;
use crate::Error;
use crate::graph::Graph;

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
    inner: Growing,
    best: Outcome,
}

impl Incremental {
    /// Without vertices; each step may use `budget`.
    pub fn new(budget: Budget) -> Self {
        let best = Outcome { vertices: Vec::new(), value: 0, upper_bound: 0, optimal: true, nodes: 0 };
        Self { inner: Growing::new(budget, true), best }
    }

    /// The graph; deleted vertices are still numbered but have no edges.
    pub fn graph(&self) -> &Graph {
        self.inner.graph()
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
        self.inner.insert(neighbors, 1.0)?;
        Ok(self.counted())
    }

    /// Adds the edge between two vertices.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`].
    pub fn add_edge(&mut self, a: usize, b: usize) -> Result<&Outcome, Error> {
        self.inner.add_edge(a, b)?;
        Ok(self.counted())
    }

    /// Takes the edge between two vertices away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`].
    pub fn remove_edge(&mut self, a: usize, b: usize) -> Result<&Outcome, Error> {
        self.inner.remove_edge(a, b)?;
        Ok(self.counted())
    }

    /// Takes a vertex and its edges away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] if it does not exist or was deleted before.
    pub fn remove(&mut self, vertex: usize) -> Result<&Outcome, Error> {
        self.inner.remove(vertex)?;
        Ok(self.counted())
    }

    fn counted(&mut self) -> &Outcome {
        let found = self.inner.best();
        // Numbers of vertices are exact in `f64`.
        self.best.value = found.value as usize;
        self.best.upper_bound = found.upper_bound as usize;
        self.best.optimal = found.optimal;
        self.best.nodes = found.nodes;
        self.best.vertices.clone_from(&found.vertices);
        &self.best
    }
}

/// A graph with vertex weights that grows and shrinks while its heaviest clique stays known.
///
/// Steps cost what those of [`Incremental`] cost; of changed weights, only a vertex of the answer that becomes lighter
/// and one outside that becomes heavier need a search. Weights are counted as by [`super::maximum_weight`].
///
/// ```
/// use draco_consistency::clique::{Budget, IncrementalWeight};
/// let mut cliques = IncrementalWeight::new(Budget::UNLIMITED);
/// cliques.insert(&[], 2.0)?;
/// cliques.insert(&[0], 1.0)?;
/// assert_eq!(cliques.insert(&[], 2.5)?.vertices, [0, 1]);
/// assert_eq!(cliques.set_weight(2, 3.5)?.vertices, [2]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct IncrementalWeight {
    inner: Growing,
}

impl IncrementalWeight {
    /// Without vertices; each step may use `budget`.
    pub fn new(budget: Budget) -> Self {
        Self { inner: Growing::new(budget, false) }
    }

    /// The graph with its weights; deleted vertices are still numbered but have no edges.
    pub fn graph(&self) -> &Graph {
        self.inner.graph()
    }

    /// The heaviest clique known; `nodes` counts the last step.
    pub fn best(&self) -> &Outcome<f64> {
        self.inner.best()
    }

    /// Adds a vertex of this weight, numbered next, with edges to `neighbors`.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] for a neighbour that does not exist or was deleted, [`Error::BadWeight`],
    /// [`Error::TooManyVertices`]; the vertex is then not added.
    pub fn insert(&mut self, neighbors: &[usize], weight: f64) -> Result<&Outcome<f64>, Error> {
        self.inner.insert(neighbors, weight)?;
        Ok(self.best())
    }

    /// Adds the edge between two vertices.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`].
    pub fn add_edge(&mut self, a: usize, b: usize) -> Result<&Outcome<f64>, Error> {
        self.inner.add_edge(a, b)?;
        Ok(self.best())
    }

    /// Takes the edge between two vertices away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`].
    pub fn remove_edge(&mut self, a: usize, b: usize) -> Result<&Outcome<f64>, Error> {
        self.inner.remove_edge(a, b)?;
        Ok(self.best())
    }

    /// Takes a vertex and its edges away.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] if it does not exist or was deleted before.
    pub fn remove(&mut self, vertex: usize) -> Result<&Outcome<f64>, Error> {
        self.inner.remove(vertex)?;
        Ok(self.best())
    }

    /// Changes the weight of a vertex.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`] if it does not exist or was deleted, [`Error::BadWeight`].
    pub fn set_weight(&mut self, vertex: usize, weight: f64) -> Result<&Outcome<f64>, Error> {
        self.inner.set_weight(vertex, weight)?;
        Ok(self.best())
    }
}

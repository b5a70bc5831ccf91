use petgraph::visit::{EdgeRef, IntoEdgeReferences, NodeIndexable};

use super::{Adjacency, SparseGraph, bit_matrix::BitMatrix};
use crate::Error;

/// Undirected graph with one row of bits a vertex and a weight a vertex.
///
/// Memory is `n²/8` bytes, so at most [`Graph::MAX_VERTICES`] vertices; asking for an edge is one bit test.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    edges: BitMatrix,
    weights: Vec<f64>,
}

impl Graph {
    /// Largest number of vertices: half a gigabyte of rows.
    pub const MAX_VERTICES: usize = 1 << 16;

    /// A graph of `vertices` vertices of weight one and no edge.
    ///
    /// # Errors
    /// [`Error::TooManyVertices`] above [`Graph::MAX_VERTICES`].
    pub fn new(vertices: usize) -> Result<Self, Error> {
        if vertices > Self::MAX_VERTICES {
            return Err(Error::TooManyVertices { vertices, limit: Self::MAX_VERTICES });
        }
        Ok(Self { edges: BitMatrix::new(vertices), weights: vec![1.0; vertices] })
    }

    /// A graph of `vertices` vertices with these edges; naming an edge twice, in either direction, is harmless.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`], [`Error::TooManyVertices`].
    ///
    /// ```
    /// use draco_consistency::graph::{Adjacency, Graph};
    /// let triangle_and_tail = Graph::from_edges(4, [(0, 1), (1, 2), (2, 0), (2, 3)])?;
    /// assert!(triangle_and_tail.is_clique(&[0, 1, 2]));
    /// # Ok::<(), draco_consistency::Error>(())
    /// ```
    pub fn from_edges(
        vertices: usize,
        edges: impl IntoIterator<Item = (usize, usize)>,
    ) -> Result<Self, Error> {
        let mut graph = Self::new(vertices)?;
        for (a, b) in edges {
            graph.add_edge(a, b)?;
        }
        Ok(graph)
    }

    /// The undirected simple graph under a petgraph graph: vertex `i` is the node with index `i`, directions and
    /// parallel edges are dropped.
    ///
    /// # Errors
    /// [`Error::SelfLoop`], [`Error::TooManyVertices`].
    pub fn from_petgraph<P: IntoEdgeReferences + NodeIndexable>(graph: P) -> Result<Self, Error> {
        let edges = graph.edge_references().map(|e| (graph.to_index(e.source()), graph.to_index(e.target())));
        Self::from_edges(graph.node_bound(), edges)
    }

    /// The same graph as bit rows.
    ///
    /// # Errors
    /// [`Error::TooManyVertices`].
    pub fn from_sparse(sparse: &SparseGraph) -> Result<Self, Error> {
        let mut graph = Self::new(sparse.len())?;
        graph.edges = BitMatrix::of(sparse);
        graph.weights = (0..sparse.len()).map(|v| sparse.weight(v)).collect();
        Ok(graph)
    }

    /// Rows of edges, and as many sound weights.
    pub(super) fn from_rows(edges: BitMatrix, weights: Vec<f64>) -> Self {
        Self { edges, weights }
    }

    /// Replaces all vertex weights.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::BadWeight`].
    pub fn with_weights(mut self, weights: &[f64]) -> Result<Self, Error> {
        if weights.len() != self.len() {
            return Err(Error::LengthMismatch { given: weights.len(), expected: self.len() });
        }
        for (vertex, &weight) in weights.iter().enumerate() {
            self.set_weight(vertex, weight)?;
        }
        Ok(self)
    }

    /// Sets the weight of one vertex.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::BadWeight`].
    pub fn set_weight(&mut self, vertex: usize, weight: f64) -> Result<(), Error> {
        self.check(vertex)?;
        if !(weight.is_finite() && weight >= 0.0) {
            return Err(Error::BadWeight { vertex, weight });
        }
        self.weights[vertex] = weight;
        Ok(())
    }

    /// Adds a vertex of weight one without edges and returns its number. Amortised cost `O(n/64)`.
    ///
    /// # Errors
    /// [`Error::TooManyVertices`].
    pub fn add_vertex(&mut self) -> Result<usize, Error> {
        let vertex = self.len();
        if vertex >= Self::MAX_VERTICES {
            return Err(Error::TooManyVertices { vertices: vertex + 1, limit: Self::MAX_VERTICES });
        }
        self.edges.push();
        self.weights.push(1.0);
        Ok(vertex)
    }

    /// Joins `a` and `b`; says whether the edge is new.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`].
    pub fn add_edge(&mut self, a: usize, b: usize) -> Result<bool, Error> {
        self.check(a)?;
        self.check(b)?;
        if a == b {
            return Err(Error::SelfLoop { vertex: a });
        }
        let new = !self.has_edge(a, b);
        self.edges.join(a, b);
        Ok(new)
    }

    /// Parts `a` and `b`; says whether they were joined.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`].
    pub fn remove_edge(&mut self, a: usize, b: usize) -> Result<bool, Error> {
        self.check(a)?;
        self.check(b)?;
        let had = self.has_edge(a, b);
        self.edges.part(a, b);
        Ok(had)
    }

    /// Share of the vertex pairs that are joined; zero below two vertices.
    pub fn density(&self) -> f64 {
        let pairs = self.len() as f64 * (self.len() as f64 - 1.0) / 2.0;
        if pairs > 0.0 { self.edge_count() as f64 / pairs } else { 0.0 }
    }

    /// The graph on `vertices` (vertex `i` of the result is `vertices[i]`), with their weights.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`].
    pub fn induced(&self, vertices: &[usize]) -> Result<Self, Error> {
        for &v in vertices {
            self.check(v)?;
        }
        let mut part = Self::new(vertices.len())?;
        for (i, &a) in vertices.iter().enumerate() {
            part.weights[i] = self.weights[a];
            for j in (0..i).filter(|&j| self.has_edge(a, vertices[j])) {
                part.edges.join(i, j);
            }
        }
        Ok(part)
    }

    /// Neighbours of `vertex` as a set of bits, bit `j` of word `j / 64`; empty for an unknown vertex.
    #[inline]
    pub fn row(&self, vertex: usize) -> &[u64] {
        self.edges.known_row(vertex)
    }

    /// Joins `vertex` to `others`, all known and different from it, and tells which edges are new.
    pub(crate) fn join_all(&mut self, vertex: usize, others: &[usize], mut each: impl FnMut(usize)) {
        for &u in others {
            if !self.has_edge(vertex, u) {
                self.edges.join(vertex, u);
                each(u);
            }
        }
    }

    /// The edges alone.
    pub(crate) fn matrix(&self) -> &BitMatrix {
        &self.edges
    }

    fn check(&self, vertex: usize) -> Result<(), Error> {
        if vertex < self.len() { Ok(()) } else { Err(Error::UnknownVertex { vertex, vertices: self.len() }) }
    }
}

impl Adjacency for Graph {
    #[inline]
    fn len(&self) -> usize {
        self.edges.len()
    }

    #[inline]
    fn neighbors(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        self.edges.neighbors(vertex)
    }

    #[inline]
    fn degree(&self, vertex: usize) -> usize {
        self.edges.degree(vertex)
    }

    #[inline]
    fn has_edge(&self, a: usize, b: usize) -> bool {
        self.edges.has_edge(a, b)
    }

    #[inline]
    fn weight(&self, vertex: usize) -> f64 {
        self.weights.get(vertex).copied().unwrap_or(0.0)
    }

    fn edge_count(&self) -> usize {
        self.edges.edge_count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_added_one_by_one_keep_the_edges() {
        let mut graph = Graph::default();
        for v in 0..200 {
            assert_eq!(graph.add_vertex(), Ok(v));
            if v > 0 {
                assert_eq!(graph.add_edge(v, v - 1), Ok(true));
                assert_eq!(graph.add_edge(v - 1, v), Ok(false));
            }
        }
        assert_eq!(graph.edge_count(), 199);
        assert_eq!(graph.neighbors(64).collect::<Vec<_>>(), [63, 65]);
        assert_eq!(graph.remove_edge(64, 63), Ok(true));
        assert!(!graph.has_edge(63, 64));
    }

    #[test]
    fn bad_input_is_named() {
        let mut graph = Graph::new(3).unwrap();
        assert_eq!(graph.add_edge(0, 3), Err(Error::UnknownVertex { vertex: 3, vertices: 3 }));
        assert_eq!(graph.add_edge(1, 1), Err(Error::SelfLoop { vertex: 1 }));
        assert!(matches!(graph.set_weight(1, f64::NAN), Err(Error::BadWeight { vertex: 1, .. })));
        assert!(matches!(graph.set_weight(1, -1.0), Err(Error::BadWeight { .. })));
        assert!(matches!(Graph::new(1_000_000), Err(Error::TooManyVertices { .. })));
        assert!(!graph.has_edge(7, 0) && graph.row(9).is_empty());
    }

    #[test]
    fn petgraph_gives_the_same_graph() {
        let petgraph = petgraph::graph::UnGraph::<(), ()>::from_edges([(0, 1), (1, 2), (2, 1)]);
        assert_eq!(Graph::from_petgraph(&petgraph), Graph::from_edges(3, [(0, 1), (1, 2)]));
    }
}

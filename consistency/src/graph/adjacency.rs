/// What the clique functions ask of a graph: undirected, no self loops, vertices `0..len()`.
pub trait Adjacency {
    /// Number of vertices.
    fn len(&self) -> usize;

    /// Whether there is no vertex.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbours of `vertex` in ascending order; none if the graph has no such vertex.
    fn neighbors(&self, vertex: usize) -> impl Iterator<Item = usize> + '_;

    /// Number of neighbours.
    fn degree(&self, vertex: usize) -> usize;

    /// Whether `a` and `b` are joined; false for vertices that do not exist.
    fn has_edge(&self, a: usize, b: usize) -> bool;

    /// Weight of a vertex: finite, not negative, one unless set.
    fn weight(&self, vertex: usize) -> f64;

    /// Whether every two of `vertices` are joined and none is named twice or unknown.
    fn is_clique(&self, vertices: &[usize]) -> bool {
        vertices.iter().all(|&v| v < self.len())
            && vertices
                .iter()
                .enumerate()
                .all(|(i, &a)| vertices[i + 1..].iter().all(|&b| self.has_edge(a, b)))
    }

    /// Number of edges.
    fn edge_count(&self) -> usize {
        (0..self.len()).map(|v| self.degree(v)).sum::<usize>() / 2
    }

    /// Sum of the weights of `vertices`.
    fn total_weight(&self, vertices: &[usize]) -> f64 {
        vertices.iter().map(|&v| self.weight(v)).sum()
    }
}

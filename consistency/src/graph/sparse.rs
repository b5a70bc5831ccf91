use super::{Adjacency, bit_matrix::BitMatrix};
use crate::Error;

/// Undirected graph as sorted neighbour lists and a weight a vertex; memory `O(n + m)`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparseGraph {
    starts: Vec<usize>,
    neighbors: Vec<u32>,
    weights: Vec<f64>,
}

impl SparseGraph {
    /// Largest number of vertices: neighbours are stored in 32 bits.
    pub const MAX_VERTICES: usize = u32::MAX as usize;

    /// A graph of `vertices` vertices of weight one with these edges; naming an edge twice is harmless.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`], [`Error::TooManyVertices`].
    pub fn from_edges(
        vertices: usize,
        edges: impl IntoIterator<Item = (usize, usize)>,
    ) -> Result<Self, Error> {
        if vertices > Self::MAX_VERTICES {
            return Err(Error::TooManyVertices { vertices, limit: Self::MAX_VERTICES });
        }
        let mut arcs = Vec::new();
        for (a, b) in edges {
            if let Some(&vertex) = [a, b].iter().find(|&&v| v >= vertices) {
                return Err(Error::UnknownVertex { vertex, vertices });
            }
            if a == b {
                return Err(Error::SelfLoop { vertex: a });
            }
            arcs.push((a as u32, b as u32));
            arcs.push((b as u32, a as u32));
        }
        Ok(Self::from_arcs(&arcs, vec![1.0; vertices]))
    }

    /// From both directions of edges known to be sound.
    pub(super) fn from_arcs(arcs: &[(u32, u32)], weights: Vec<f64>) -> Self {
        let n = weights.len();
        if n.saturating_mul(n) <= BITS_AN_ARC * arcs.len() {
            return Self::from_many_arcs(arcs, weights);
        }
        let bounds = starts(n, arcs.iter().map(|arc| arc.0));
        let (mut place, mut lists) = (bounds.clone(), vec![0; arcs.len()]);
        for &(a, b) in arcs {
            lists[place[a as usize]] = b;
            place[a as usize] += 1;
        }
        // Vertices enter the lists of their neighbours one after the other, which sorts those.
        let mut neighbors = vec![0; arcs.len()];
        place.copy_from_slice(&bounds);
        for v in 0..n {
            for &u in &lists[bounds[v]..bounds[v + 1]] {
                neighbors[place[u as usize]] = v as u32;
                place[u as usize] += 1;
            }
        }
        let (mut starts, mut kept) = (vec![0; n + 1], 0);
        for v in 0..n {
            for i in bounds[v]..bounds[v + 1] {
                if kept == starts[v] || neighbors[kept - 1] != neighbors[i] {
                    neighbors[kept] = neighbors[i];
                    kept += 1;
                }
            }
            starts[v + 1] = kept;
        }
        neighbors.truncate(kept);
        Self { starts, neighbors, weights }
    }

    /// The same by way of bit rows, which need no more memory than the arcs.
    fn from_many_arcs(arcs: &[(u32, u32)], weights: Vec<f64>) -> Self {
        let mut rows = BitMatrix::new(weights.len());
        arcs.iter().for_each(|&(a, b)| rows.direct(a as usize, b as usize));
        Self::from_rows(&rows, weights)
    }

    /// The graph of bit rows, one a weight.
    pub(super) fn from_rows(rows: &BitMatrix, weights: Vec<f64>) -> Self {
        let arcs = (0..weights.len()).map(|v| rows.degree(v)).sum();
        let (mut starts, mut neighbors) = (Vec::with_capacity(weights.len() + 1), Vec::with_capacity(arcs));
        starts.push(0);
        for v in 0..weights.len() {
            rows.neighbors(v).for_each(|u| neighbors.push(u as u32));
            starts.push(neighbors.len());
        }
        Self { starts, neighbors, weights }
    }

    /// A part of a graph: both directions of its edges, and its weights.
    pub(crate) fn induced(arcs: impl Iterator<Item = (usize, usize)>, weights: Vec<f64>) -> Self {
        let arcs: Vec<(u32, u32)> = arcs.map(|(a, b)| (a as u32, b as u32)).collect();
        Self::from_arcs(&arcs, weights)
    }

    /// Replaces all vertex weights.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::BadWeight`].
    pub fn with_weights(mut self, weights: &[f64]) -> Result<Self, Error> {
        if weights.len() != self.len() {
            return Err(Error::LengthMismatch { given: weights.len(), expected: self.len() });
        }
        if let Some((vertex, &weight)) =
            weights.iter().enumerate().find(|(_, w)| !(w.is_finite() && **w >= 0.0))
        {
            return Err(Error::BadWeight { vertex, weight });
        }
        self.weights.copy_from_slice(weights);
        Ok(self)
    }

    #[inline]
    fn list(&self, vertex: usize) -> &[u32] {
        if vertex < self.len() { &self.neighbors[self.starts[vertex]..self.starts[vertex + 1]] } else { &[] }
    }
}

/// Bits that an arc takes.
const BITS_AN_ARC: usize = 64;

/// Where the elements of each key begin when they are sorted, and the end.
fn starts(keys: usize, elements: impl Iterator<Item = u32>) -> Vec<usize> {
    let mut starts = vec![0; keys + 1];
    elements.for_each(|key| starts[key as usize + 1] += 1);
    for key in 0..keys {
        starts[key + 1] += starts[key];
    }
    starts
}

impl Adjacency for SparseGraph {
    #[inline]
    fn len(&self) -> usize {
        self.weights.len()
    }

    #[inline]
    fn neighbors(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        self.list(vertex).iter().map(|&v| v as usize)
    }

    #[inline]
    fn degree(&self, vertex: usize) -> usize {
        self.list(vertex).len()
    }

    #[inline]
    fn has_edge(&self, a: usize, b: usize) -> bool {
        let (a, b) = if self.degree(a) <= self.degree(b) { (a, b) } else { (b, a) };
        u32::try_from(b).is_ok_and(|b| self.list(a).binary_search(&b).is_ok())
    }

    #[inline]
    fn weight(&self, vertex: usize) -> f64 {
        self.weights.get(vertex).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_named_twice_count_once() {
        let graph = SparseGraph::from_edges(4, [(0, 1), (1, 0), (2, 1), (0, 1)]).unwrap();
        assert_eq!(graph.edge_count(), 2);
        assert_eq!(graph.neighbors(1).collect::<Vec<_>>(), [0, 2]);
        assert!(graph.has_edge(2, 1) && !graph.has_edge(0, 2) && !graph.has_edge(9, 0));
    }

    #[test]
    fn many_and_few_arcs_make_the_same_lists() {
        for n in [1, 2, 63, 64, 65, 200] {
            let edges = (0..n).flat_map(|a| (0..a).map(move |b| (a, b)).filter(|(a, b)| a * b % 3 != 1));
            let dense = SparseGraph::from_edges(n, edges.clone()).unwrap();
            // Vertices without edges are what makes it sparse.
            let sparse = SparseGraph::from_edges(20 * n + 2000, edges).unwrap();
            assert_eq!(dense.edge_count(), sparse.edge_count());
            assert!((0..n).all(|v| dense.list(v) == sparse.list(v)), "{n}");
        }
    }

    #[test]
    fn bad_edges_are_named() {
        assert_eq!(SparseGraph::from_edges(2, [(1, 1)]), Err(Error::SelfLoop { vertex: 1 }));
        assert!(matches!(SparseGraph::from_edges(2, [(1, 2)]), Err(Error::UnknownVertex { vertex: 2, .. })));
        assert!(SparseGraph::default().is_empty());
    }
}

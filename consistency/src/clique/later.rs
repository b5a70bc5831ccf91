use crate::graph::{Adjacency, SparseGraph, bit_matrix::BitMatrix};

/// Neighbourhoods restricted to what comes later in an order: every clique is its first vertex with some of those.
pub(super) struct Later<'a, A> {
    graph: &'a A,
    rank: Vec<usize>,
    place: Vec<u32>,
}

impl<'a, A: Adjacency> Later<'a, A> {
    pub(super) fn new(graph: &'a A, order: &[usize]) -> Self {
        let mut rank = vec![0; graph.len()];
        order.iter().enumerate().for_each(|(i, &v)| rank[v] = i);
        Self { graph, rank, place: vec![u32::MAX; graph.len()] }
    }

    pub(super) fn of(&self, v: usize, keep: impl Fn(usize) -> bool) -> Vec<usize> {
        self.graph.neighbors(v).filter(|&u| self.rank[u] > self.rank[v] && keep(u)).collect()
    }

    /// Whether bit rows of a part need no more memory than lists of its edges.
    pub(super) fn is_dense(&self, vertices: &[usize]) -> bool {
        let edges: usize = vertices.iter().map(|&v| self.graph.degree(v)).sum();
        vertices.len() * vertices.len() <= BITS_A_NEIGHBOR * edges
    }

    pub(super) fn matrix(&mut self, vertices: &[usize]) -> BitMatrix {
        BitMatrix::induced_with(self.graph, vertices, &mut self.place)
    }

    pub(super) fn sparse(&mut self, vertices: &[usize]) -> SparseGraph {
        vertices.iter().enumerate().for_each(|(i, &v)| self.place[v] = i as u32);
        let place = &self.place;
        let edges = vertices.iter().enumerate().flat_map(|(i, &v)| {
            self.graph.neighbors(v).map(|u| place[u]).filter(|&j| j != u32::MAX).map(move |j| (i, j as usize))
        });
        let weights: Vec<f64> = vertices.iter().map(|&v| self.graph.weight(v)).collect();
        let part = SparseGraph::induced(edges, weights);
        vertices.iter().for_each(|&v| self.place[v] = u32::MAX);
        part
    }
}

/// Memory that making a list of neighbours takes for each of them.
const BITS_A_NEIGHBOR: usize = 160;

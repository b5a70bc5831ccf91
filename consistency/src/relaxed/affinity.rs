use crate::Error;
use crate::graph::{Adjacency, SparseGraph};

/// Symmetric matrix of affinities in (0, 1] between measurements, stored by neighbour; pairs not named contradict each
/// other. The diagonal is one.
#[derive(Clone, Debug, PartialEq)]
pub struct Affinity {
    graph: SparseGraph,
    /// Affinity of each neighbour, row after row in the order of the graph.
    rows: Vec<Vec<f64>>,
}

impl Affinity {
    /// From pairs and their affinity; of a pair named twice the later affinity counts.
    ///
    /// # Errors
    /// [`Error::UnknownVertex`], [`Error::SelfLoop`], [`Error::BadAffinity`] outside (0, 1].
    pub fn from_pairs(vertices: usize, pairs: &[(usize, usize, f64)]) -> Result<Self, Error> {
        if let Some(&(a, b, affinity)) = pairs.iter().find(|(.., w)| !(*w > 0.0 && *w <= 1.0)) {
            return Err(Error::BadAffinity { a, b, affinity });
        }
        let graph = SparseGraph::from_edges(vertices, pairs.iter().map(|&(a, b, _)| (a, b)))?;
        let neighbors: Vec<Vec<usize>> = (0..vertices).map(|v| graph.neighbors(v).collect()).collect();
        let mut rows: Vec<Vec<f64>> = neighbors.iter().map(|list| vec![0.0; list.len()]).collect();
        for &(a, b, affinity) in pairs {
            for (from, to) in [(a, b), (b, a)] {
                if let Ok(at) = neighbors[from].binary_search(&to) {
                    rows[from][at] = affinity;
                }
            }
        }
        Ok(Self { graph, rows })
    }

    /// The pairs with an affinity, as a graph.
    pub fn graph(&self) -> &SparseGraph {
        &self.graph
    }

    /// Neighbours of `vertex` with their affinity.
    pub fn neighbors(&self, vertex: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let row = self.rows.get(vertex).map_or(&[][..], |row| row);
        self.graph.neighbors(vertex).zip(row.iter().copied())
    }

    /// `x'Mx` of a set's indicator divided by its size: one for a single vertex, up to the size for a perfect clique.
    pub fn density(&self, vertices: &[usize]) -> f64 {
        let mut inside = vec![false; self.graph.len()];
        for &v in vertices {
            if let Some(mark) = inside.get_mut(v) {
                *mark = true;
            }
        }
        let edges: f64 = vertices
            .iter()
            .flat_map(|&v| self.neighbors(v))
            .filter(|&(u, _)| inside[u])
            .map(|(_, w)| w)
            .sum();
        if vertices.is_empty() { 0.0 } else { 1.0 + edges / vertices.len() as f64 }
    }
}

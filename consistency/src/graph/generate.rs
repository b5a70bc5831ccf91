//! Random graphs with a known clique hidden in them.

use rand::{Rng, RngExt};

use super::Graph;
use crate::Error;

/// A graph and the vertices that were planted as consistent.
#[derive(Clone, Debug, PartialEq)]
pub struct Planted {
    /// The graph.
    pub graph: Graph,
    /// Whether each vertex belongs to the planted set.
    pub planted: Vec<bool>,
}

impl Planted {
    /// Whether an edge joins two planted vertices, so that it is there for a reason and not by chance.
    pub fn is_planted_edge(&self, a: usize, b: usize) -> bool {
        self.planted.get(a) == Some(&true) && self.planted.get(b) == Some(&true)
    }
}

/// How a planted graph looks; the default is the size of a hard multi-robot session.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantedParams {
    /// Number of vertices. Default 1000.
    pub vertices: usize,
    /// Number of planted vertices. Default 300.
    pub planted: usize,
    /// Probability that two planted vertices are joined, 0 to 1. Default 0.98: a gate at 98 %; one plants a clique.
    pub inner: f64,
    /// Probability that any other two are joined, 0 to 1. Default 0.1.
    pub outer: f64,
}

impl Default for PlantedParams {
    fn default() -> Self {
        Self { vertices: 1000, planted: 300, inner: 0.98, outer: 0.1 }
    }
}

/// A random graph in which each pair is joined with probability `density`, clamped to 0 to 1.
///
/// # Errors
/// [`Error::TooManyVertices`].
pub fn random(vertices: usize, density: f64, rng: &mut impl Rng) -> Result<Graph, Error> {
    let params = PlantedParams { vertices, planted: 0, inner: density, outer: density };
    Ok(planted(&params, rng)?.graph)
}

/// A random graph with a set of vertices, spread over all numbers, that are joined more often than the rest: a clique
/// or, with `inner` below one, a near-clique. Probabilities are clamped to 0 to 1, NaN counts as 0.
///
/// # Errors
/// [`Error::TooManyVertices`]; [`Error::LengthMismatch`] if more are planted than there are.
///
/// ```
/// use draco_consistency::graph::{PlantedParams, planted};
/// use rand::SeedableRng;
/// let params = PlantedParams { vertices: 50, planted: 10, inner: 1.0, outer: 0.1 };
/// let found = planted(&params, &mut rand_chacha::ChaCha8Rng::seed_from_u64(1))?;
/// assert_eq!(found.planted.iter().filter(|p| **p).count(), 10);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn planted(params: &PlantedParams, rng: &mut impl Rng) -> Result<Planted, Error> {
    let (n, k) = (params.vertices, params.planted);
    if k > n {
        return Err(Error::LengthMismatch { given: k, expected: n });
    }
    let mut graph = Graph::new(n)?;
    let mut planted = vec![false; n];
    // One draw a vertex: it is planted with the share still to be placed.
    let mut left = k;
    for (v, mark) in planted.iter_mut().enumerate() {
        *mark = rng.random_range(0..n - v) < left;
        left -= usize::from(*mark);
    }
    let probability = |p: f64| if p.is_nan() { 0.0 } else { p.clamp(0.0, 1.0) };
    let (inner, outer) = (probability(params.inner), probability(params.outer));
    for a in 0..n {
        for b in a + 1..n {
            if rng.random_bool(if planted[a] && planted[b] { inner } else { outer }) {
                graph.add_edge(a, b)?;
            }
        }
    }
    Ok(Planted { graph, planted })
}

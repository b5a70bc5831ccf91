//! Graphs whose vertices are measurements and whose edges say "these two agree".
//!
//! [`Graph`] keeps one row of bits a vertex: right for up to some ten thousand vertices and any density.
//! [`SparseGraph`] keeps sorted neighbour lists: right for a million vertices with few edges each. The clique
//! functions take both through [`Adjacency`]. [`dimacs`] and [`matrix_market`] read the usual benchmark files.

mod adjacency;
pub(crate) mod bit_matrix;
pub(crate) mod bits;
mod degeneracy;
mod dense;
mod dimacs;
mod generate;
pub(crate) mod hypergraph;
mod matrix_market;
mod sparse;

pub use adjacency::Adjacency;
pub(crate) use degeneracy::degeneracy_while;
pub use degeneracy::{Degeneracy, degeneracy};
pub use dense::Graph;
pub use dimacs::{FileGraph, dimacs, read_dimacs, read_dimacs_smaller};
pub use generate::{Planted, PlantedParams, planted, random};
pub use hypergraph::Hypergraph;
pub use matrix_market::{matrix_market, read_matrix_market};
pub use sparse::SparseGraph;

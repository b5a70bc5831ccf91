//! Dense-subgraph relaxation for weighted agreement: which set holds most mutual affinity?
//!
//! Where agreement has degrees, the clique of most affinity is wanted rather than the one of most vertices.
//! [`densest`] maximises a relaxation by projected ascent; [`spectral`] takes the leading eigenvector at once. Both
//! return a verified clique, and the relaxation's own set, which need not be one. When *not* to use them: if you need
//! a proof, use [`crate::clique`].

mod affinity;
mod densest;

pub use affinity::Affinity;
pub use densest::{Params, Relaxation, Start, Termination, densest, spectral};

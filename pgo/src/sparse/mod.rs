//! Sparse Cholesky factorisation of symmetric matrices of `N × N` blocks.

mod bucket_queue;
pub(crate) mod dense;
mod factor;
mod inverse;
mod minimum_fill;
#[cfg(feature = "rayon")]
mod parallel;
mod scalar;
mod symbolic;

pub(crate) use factor::{BlockMatrix, Cholesky};
pub(crate) use inverse::SelectedInverse;
pub(crate) use minimum_fill::minimum_fill;
pub(crate) use symbolic::Symbolic;

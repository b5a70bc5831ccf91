//! Sparse Cholesky factorisation of symmetric matrices of `N × N` blocks.

mod dense;
mod factor;
mod ordering;
mod symbolic;

pub(crate) use factor::{BlockMatrix, Cholesky};
pub(crate) use symbolic::Symbolic;

//! Sparse Cholesky factorisation of symmetric matrices of `N × N` blocks.

mod dense;
mod factor;
mod inverse;
mod ordering;
mod symbolic;

pub(crate) use factor::{BlockMatrix, Cholesky};
pub(crate) use inverse::SelectedInverse;
pub(crate) use symbolic::Symbolic;

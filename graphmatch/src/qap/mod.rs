//! Quadratic assignment: which permutation makes two square matrices agree at the least cost.

mod faq;
mod problem;
mod robust_tabu;

pub use faq::{FaqParams, faq};
pub use problem::{Permutation, Qap};
pub use robust_tabu::{TabuParams, robust_tabu};

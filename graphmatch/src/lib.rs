//! Which object is which.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod dbscan;
mod disjoint_sets;
mod error;

pub use dbscan::{Dbscan, dbscan};
pub use error::Error;

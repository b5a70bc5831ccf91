#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod error;

// Graph algorithms: nothing here knows of poses.
pub mod clique;
pub mod graph;

pub use error::Error;

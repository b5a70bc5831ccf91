//! Where everything lies.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod error;
mod factor;
mod graph;
pub mod io;
mod kernel;
mod key;
mod marginals;
mod problem;
mod solve;
mod sparse;

pub use error::Error;
pub use factor::{CustomFactor, Factor, FactorId, Measurement};
pub use graph::{Component, PoseGraph, PoseGraph2, PoseGraph3};
pub use kernel::{Kernel, Weighed};
pub use key::Key;
pub use marginals::{JointCovariance, Marginals};
pub use solve::{Gauge, Method, Solution, SolveParams, Termination, solve};

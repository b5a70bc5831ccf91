#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod certify;
mod chordal;
pub mod distributed;
mod error;
mod factor;
mod gnc;
mod graph;
pub mod io;
mod kernel;
mod key;
mod marginals;
mod optimizer;
mod problem;
mod solve;
mod spanning_tree;
mod sparse;

pub use certify::{Certificate, certify, chordal_objective};
pub use chordal::{ChordalPose, chordal};
pub use error::Error;
pub use factor::{CustomFactor, Factor, FactorId, Measurement};
pub use gnc::{GncLoss, GncParams, GncSolution, gnc};
pub use graph::{Component, PoseGraph, PoseGraph2, PoseGraph3};
pub use kernel::{Kernel, Weighed};
pub use key::Key;
pub use marginals::{JointCovariance, Marginals};
pub use solve::{Gauge, Method, Solution, SolveParams, Termination, solve};
pub use spanning_tree::spanning_tree;

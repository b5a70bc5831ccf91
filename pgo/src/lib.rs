#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod certify;
mod chordal;
mod condense;
pub mod distributed;
mod error;
pub mod evaluation;
mod factor;
mod gnc;
mod graph;
mod incremental;
pub mod io;
mod ipc;
mod jacobi;
mod kernel;
mod key;
mod key_table;
mod linearise;
mod marginals;
mod max_mixture;
mod nearest_rotation;
mod optimizer;
mod pattern;
mod problem;
mod quadratic;
mod solve;
mod spanning_tree;
mod sparse;
mod staircase;

pub use certify::{Certificate, certify, chordal_objective};
pub use chordal::{ChordalPose, chordal};
pub use error::Error;
pub use factor::{CustomFactor, Factor, FactorId, FactorModel, Measurement};
pub use gnc::{GncLoss, GncParams, GncSolution, GncStart, gnc};
pub use graph::{Component, PoseGraph, PoseGraph2, PoseGraph3};
pub use incremental::{
    Incremental, Incremental2, Incremental3, IncrementalMode, IncrementalParams, IncrementalUpdate,
};
pub use ipc::{Ipc, IpcParams, IpcSolution, IpcVerdict, ipc};
pub use kernel::{Kernel, Weighed};
pub use key::Key;
pub use marginals::{JointCovariance, Marginals};
pub use max_mixture::{MaxMixture, MixtureComponent};
pub use solve::{Gauge, Method, Solution, SolveParams, Start, Termination, solve};
pub use spanning_tree::spanning_tree;
pub use staircase::{StaircaseParams, StaircaseSolution, staircase};

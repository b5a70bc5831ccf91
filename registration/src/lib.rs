//! Where a scan lies, and how sure that is.
//!
//! Start with a [`Cloud`] for each scan, prepare one as [`Target`] and call [`Target::align`] with a preset of
//! [`IcpParams`]. The same code serves 2-D (`Isometry2<f64>`) and 3-D (`Isometry3<f64>`).
//!
//! Tangent order is **translation, then rotation**; perturbations are on the right, so a covariance is in the
//! frame of the source.
#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod cloud;
pub mod correlative;
mod downsample;
mod error;
pub mod global;
mod icp;
pub mod io;
mod kd_tree;
mod linalg;
mod motion;
mod multi_start;
mod noise;
mod normals;
mod outlier;
mod parallel;
mod rigid_fit;
mod sliding_window;

pub use cloud::Cloud;
pub use downsample::{mean_downsample, medoid_downsample, medoid_indices};
pub use error::Error;
pub use icp::{
    Acceleration, Covariance, IcpParams, Kernel, Matcher, Optimizer, Overlap, Registration, Rejector,
    Residual, ResidualStatistics, StopRule, Target, Termination,
};
pub use kd_tree::{KdTree, Neighbor};
pub use motion::RigidMotion;
pub use multi_start::{MultiStart, StartMode, starts_around};
pub use noise::RangeBearingNoise;
pub use outlier::{radius_outlier_filter, radius_outlier_indices};
pub use sliding_window::SlidingWindow;

/// Standard deviation given to degenerate directions in a covariance, metres (and radians times the size of the
/// scan): far beyond any scan, yet harmless when inverted.
pub const DEGENERATE_SIGMA: f64 = 1e3;

//! Poses for SLAM in two and three dimensions.
//!
//! Poses *are* nalgebra's types: [`LieGroup`] is implemented for `UnitComplex<f64>` (SO(2)), `Isometry2<f64>`
//! (SE(2)), `UnitQuaternion<f64>` (SO(3)) and `Isometry3<f64>` (SE(3)), so code written once over
//! `G: LieGroup<N>` serves both dimensions.
//!
//! Tangent order is **translation, then rotation**; perturbations are on the **right**, `T ⊞ ξ = T · exp(ξ)`;
//! covariances are in that order, in the frame of the pose's own body.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod check;
pub mod chi2;
mod cholesky;
mod coefficients;
pub mod convention;
mod error;
mod gaussian;
mod group;
mod mean;
mod points;
mod se2;
mod se3;
mod so2;
mod so3;

pub use error::Error;
pub use gaussian::{GaussianPose, GaussianPose2, GaussianPose3, SecondOrder, transport};
pub use group::{LieGroup, Linearized, LinearizedPair};
pub use mean::{Mean, MeanParams, Termination, frechet_mean};
pub use points::{MovedPoint, PointAction};
pub use so3::{hat3, vee3};

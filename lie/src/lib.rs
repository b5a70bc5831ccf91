//! Poses for SLAM in two and three dimensions.
//!
//! Poses *are* nalgebra's types: [`LieGroup`] is implemented for `UnitComplex<f64>` (SO(2)), `Isometry2<f64>`
//! (SE(2)), `UnitQuaternion<f64>` (SO(3)) and `Isometry3<f64>` (SE(3)), so code written once over
//! `G: LieGroup<N>` serves both dimensions.
//!
//! Tangent order is **translation, then rotation**; perturbations are on the **right**, `T ⊞ ξ = T · exp(ξ)`;
//! covariances are in that order, in the frame of the pose's own body. For matrices of other libraries see
//! [`convention`].
//!
//! Start with [`GaussianPose`] for poses with covariance, with [`LieGroup::between_error_with_jacobians`] for a
//! factor of a pose graph. Not for you when you need `f32`, automatic differentiation or similarity transforms.
//!
//! ```
//! use draco_lie::LieGroup;
//! use nalgebra::{Isometry3, Vector6};
//!
//! let xi = Vector6::new(1.0, 2.0, 3.0, 0.1, -0.2, 0.3);
//! let world_from_body = Isometry3::exp(&xi);
//! assert!((world_from_body.log() - xi).norm() < 1e-15);
//!
//! // the same for every group
//! fn halfway<const N: usize, G: LieGroup<N>>(a: &G, b: &G) -> G {
//!     a.interpolate(b, 0.5)
//! }
//! let middle = halfway(&LieGroup::identity(), &world_from_body);
//! assert!((middle.log() - xi * 0.5).norm() < 1e-15);
//! ```
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

/// The program the README opens with, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeDoctests;

//! How good is a trajectory? Absolute and relative errors against a reference, and costs by other definitions.
//!
//! Start with [`ate`] for the error of a whole map after alignment, with [`rpe`] for drift. Figures are those of
//! the `evo` package (Grupp, *evo: Python package for the evaluation of odometry and SLAM*, 2017) at the same
//! settings. Trajectories are compared pose by pose; [`associate`] pairs those that only share a clock.
//!
//! [`objective`] evaluates a pose graph by the residual that another library minimises, so that published costs
//! can be reproduced.

mod alignment;
mod association;
mod objective;
mod pairs;
mod pose_error;

pub use alignment::{Alignment, TrajectoryPose, align};
pub use association::associate;
pub use objective::{Objective, objective};
pub use pairs::{Delta, Pairs};
pub use pose_error::{PoseErrors, PoseRelation, RpeParams, Statistics, ate, rpe};

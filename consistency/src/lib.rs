#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod error;

// Graph algorithms: nothing here knows of poses.
pub mod clique;
pub mod graph;
pub mod hyperclique;
pub mod relaxed;

pub use error::Error;

// Pose-aware layer: turns measurements into graphs and votes.
mod closure;
pub mod gcm;
pub mod gkcm;
mod pair_test;
mod pcm;
mod pcm_stream;
mod pose;
mod scale;
mod selection;
pub mod simulate;
mod trajectory;

pub use closure::{Closure, Closure2, Closure3, PoseKey};
pub use gcm::{
    Event, Gcm, GcmOnline, GcmParams, GroupParams, PooledParams, Verdict, gcm, gcm_group, gcm_pooled,
};
pub use gkcm::{CycleParams, KConsistency, Range, RangeParams, cycle_consistency, range_consistency};
pub use pair_test::PairTest;
pub use pcm::{PcmParams, pcm};
pub use pcm_stream::{Change, Pcm};
pub use pose::{Pose, isotropic_covariance};
pub use scale::covariance_scale;
pub use selection::{FailedPair, Reason, Rejection, Selection};
pub use trajectory::{
    MapTransform, MapTransform2, MapTransform3, Trajectories, Trajectories2, Trajectories3, Trajectory,
    Trajectory2, Trajectory3,
};

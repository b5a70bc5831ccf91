//! Group consistency: closures of one place and time are wrong together, so they vote together.
//!
//! Start with [`gcm`](crate::gcm()); [`gcm_pooled`], [`gcm_group`] and [`one_vote`] are rules to compare with.
mod beam;
mod clusters;
mod frames;
mod group_cost;
mod grouping;
mod one_vote;
mod params;
mod pooled;
mod posterior;
mod verdict;
mod votes;

pub(crate) use frames::{Frames, implied};
pub use group_cost::{Aggregate, GroupParams, Objective, gcm_group};
pub use one_vote::one_vote;
pub use params::{GapUnit, GcmParams, Sigma};
pub use pooled::{PooledParams, gcm_pooled};
pub use posterior::{Gcm, GroupPosterior, gcm};
pub use verdict::Verdict;

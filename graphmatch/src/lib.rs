//! Which object is which.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod affinity;
mod as_coded;
mod assignment;
mod consensus;
mod dbscan;
mod disjoint_sets;
mod error;
mod matching;
mod object;
mod rigid;
mod similarity;
mod spectral;
mod split_mix;

pub use affinity::{Affinity, AffinityParams, Attributes, Kernel};
pub use as_coded::{AsCodedParams, as_coded};
pub use assignment::{Assignment, Costs, assign, assign_or_leave};
pub use consensus::{ConsensusParams, consensus};
pub use dbscan::{Dbscan, dbscan};
pub use error::Error;
pub use matching::{Match, Method, Mode, Pair, Verdict, match_objects};
pub use object::Object;
pub use similarity::{NoSimilarity, ShapeSimilarity, Similarity};
pub use spectral::{Eigenvector, principal_eigenvector};

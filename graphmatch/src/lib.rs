#![doc = include_str!("../README.md")]
//!
//! Conventions: `map1_from_map2` takes coordinates of map 2 to map 1; covariances have order `[x, y, θ]`, perturbation
//! on the right, in the frame of map 2; pair vectors are row-major, `first * objects of map 2 + second`.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod affinity;
mod as_coded;
mod assignment;
mod consensus;
mod dbscan;
mod disjoint_sets;
mod error;
mod lanes;
mod matching;
mod object;
mod qap;
mod rigid;
mod similarity;
mod solvers;
mod spectral;
mod split_mix;
mod tridiagonal;

pub use affinity::{Affinity, AffinityParams, Attributes, Kernel};
pub use as_coded::{AsCodedParams, as_coded};
pub use assignment::{Assignment, Costs, SparseCosts, assign, assign_or_leave, assign_sparse};
pub use consensus::{ConsensusParams, consensus};
pub use dbscan::{Dbscan, dbscan};
pub use error::Error;
pub use matching::{Match, Method, Mode, Pair, Verdict, match_objects};
pub use object::Object;
pub use qap::{FaqParams, Permutation, Qap, TabuParams, faq, robust_tabu};
pub use similarity::{NoSimilarity, ShapeSimilarity, Similarity};
pub use solvers::{
    GraduatedParams, RrwmParams, assign_scores, gcgc, graduated_assignment, greedy_pairs, ipfp, rrwm,
};
pub use spectral::{Eigenvector, principal_eigenvector, smac};

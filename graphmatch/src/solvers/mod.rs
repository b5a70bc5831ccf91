//! Assignments from an affinity: soft scores of pairs, and how to make them hard.

mod discretize;
mod gcgc;
mod graduated_assignment;
mod ipfp;
mod rrwm;
mod sinkhorn;

pub use discretize::{assign_scores, greedy_pairs};
pub use gcgc::gcgc;
pub use graduated_assignment::{GraduatedParams, graduated_assignment};
pub use ipfp::ipfp;
pub use rrwm::{RrwmParams, rrwm};

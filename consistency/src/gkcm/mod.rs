//! Group-k consistency: measurements that only three or four together can contradict each other.
//!
//! [`range_consistency`] finds the largest set of ranges from a moving robot to one unknown beacon of which every
//! four agree (three ranges place a beacon in the plane, the fourth checks). [`cycle_consistency`] finds the largest
//! set of closures of a team of which every three agree, which includes the cycles of three robots that no pair test
//! sees. Both test a set only when all its smaller subsets passed and say how many tests were made.
//!
//! When *not* to use it: where pairs alone can disagree, [`pcm`](crate::pcm()) is much cheaper; where outliers come in
//! correlated groups, use [`gcm`](crate::gcm()).
//!
//! **Source**: Forsgren, Vasudevan, Kaess, McLain, Mangelson, *Group-k consistent measurement set maximization*, 2022.
mod cycles;
mod ranges;

pub use cycles::{CycleParams, cycle_consistency};
pub use ranges::{Range, RangeParams, range_consistency};

use crate::{Reason, Rejection, Selection};

/// The largest k-wise consistent set and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct KConsistency {
    /// Accepted and rejected measurements.
    pub selection: Selection,
    /// Whether the set is proved to be a largest one.
    pub optimal: bool,
    /// Tests made of `j` measurements together, at `tests[j]`.
    pub tests: Vec<u64>,
}

/// Sorts vertices into accepted and rejected; `measurement` names each vertex, a set below `minimum` is not believed.
fn select(mut accepted: Vec<usize>, minimum: usize, measurement: &[usize]) -> Selection {
    accepted.sort_unstable();
    let size = accepted.len();
    let mut selection = Selection::default();
    for (vertex, &own) in measurement.iter().enumerate() {
        if size >= minimum && accepted.binary_search(&vertex).is_ok() {
            selection.accepted.push(own);
        } else {
            let reason = if size >= minimum {
                Reason::OutsideLargestSet { size }
            } else {
                Reason::TooFewVotes { size, minimum }
            };
            selection.rejected.push(Rejection { closure: own, reason });
        }
    }
    selection.sort();
    selection
}

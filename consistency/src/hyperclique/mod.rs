//! Cliques of hypergraphs: sets of which every `k` agree.
//!
//! Ranges to one beacon, or closures of three robots, can only be judged three or four at a time. Start with
//! [`maximum`]; build the hypergraph from tests with [`from_checks`], which tests a set of `k` only if its smaller
//! subsets passed. When *not* to use it: if two measurements alone can contradict each other, [`crate::clique`] is
//! much cheaper.

mod checks;
mod greedy;
mod incremental;
mod maximum;
mod search;

pub use checks::{Checked, from_checks};
pub use greedy::greedy;
pub use incremental::Incremental;
pub use maximum::maximum;

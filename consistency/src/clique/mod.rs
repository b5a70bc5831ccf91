//! Maximum cliques: the largest sets of measurements that all agree with one another, with a proof.
//!
//! Start with [`maximum`] or [`maximum_weight`]. Both stop at a [`Budget`] if you set one and then still return a
//! verified clique and an upper bound. When *not* to use them: if a good clique in microseconds is enough, take
//! [`greedy`].

mod budget;
mod by_vertex;
mod colours;
mod complement_bound;
mod complement_parts;
mod complement_search;
mod complement_state;
mod cores;
mod cover;
mod dense;
mod enumerate;
mod fixed_point;
mod fractional;
mod greedy;
mod growing;
mod held;
mod incremental;
mod incumbent;
mod later;
mod local_search;
mod maximum;
mod order;
mod outcome;
mod peels;
mod penalties;
mod rows;
mod search;
mod tally;
mod threads;

pub use budget::Budget;
pub(crate) use budget::Meter;
pub use enumerate::{MaximalCliques, all_maximum, maximal};
pub use greedy::greedy;
pub use incremental::{Incremental, IncrementalWeight};
pub use maximum::{maximum, maximum_weight};
pub use outcome::Outcome;

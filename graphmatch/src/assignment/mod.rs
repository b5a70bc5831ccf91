//! Linear assignment: which row goes with which column at the least total cost.

mod core_arcs;
mod costs;
mod dense;
mod kernels;
mod length;
mod paths;
mod row_reduction;
mod solve;
mod sparse;
mod state;

pub use costs::Costs;
pub use solve::{Assignment, assign, assign_or_leave};
pub use sparse::{SparseCosts, assign_sparse};

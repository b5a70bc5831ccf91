mod bounds;
mod group;
mod leaf;
mod many;
mod probe;
mod tree;
mod visitor;

pub(crate) use group::{Group, Ranks};
pub use tree::KdTree;
pub use visitor::Neighbor;
pub(crate) use visitor::{NearestFew, Visitor};

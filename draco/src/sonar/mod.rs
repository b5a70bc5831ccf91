//! From a polar sonar image to points: CFAR detection and fan geometry.

mod filter;

pub use filter::PointFilter;

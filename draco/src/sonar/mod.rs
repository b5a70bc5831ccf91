//! From a polar sonar image to points: CFAR detection and fan geometry.
//!
//! A [`Cfar`] finds the cells of a [`PolarImage`] that stand out of their surroundings, a [`Fan`] says where a cell
//! lies, and a [`PointFilter`] thins what was found. [`FrontEnd`] does all three.

mod cfar;
mod fan;
mod filter;
mod front_end;
mod threshold;

pub use cfar::{Cfar, CfarParams, PolarImage};
pub use fan::Fan;
pub use filter::PointFilter;
pub use front_end::FrontEnd;
pub use threshold::{CfarKind, threshold_factor};

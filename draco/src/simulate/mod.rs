//! Simulated missions: worlds, paths, odometry and sonar scans, from one seed.
//!
//! Two scenarios after the published system's simulated sites: [`Scenario::Harbor`], rows of pilings along a quay,
//! whose repetition makes wrong closures agree with one another, and [`Scenario::Wreck`], the scattered parts of an
//! airplane on free ground, where shapes are distinct. Start with [`simulate`].
//!
//! Scans come in two ways: [`ScanMode::Direct`] draws points from ray casts, and [`ScanMode::Image`] makes the whole
//! polar image and runs the detector of [`sonar`](crate::sonar) over it, at many times the cost.

mod image;
mod mission;
mod movers;
mod path;
mod scan;
mod scenario;
mod world;

pub use image::{ImageParams, polar_image};
pub use mission::{OdometryNoise, ScanMode, SimulationParams, simulate, visited_overlap};
pub use path::{KeyframePolicy, follow};
pub use scan::{ScanParams, direct_scan};
pub use scenario::Scenario;
pub use world::{Hit, Shape, Solid, World};

//! Correlative registration of sparse scans in the plane: every pose of a window is scored, not only a path downhill.
//!
//! Sonar scans are sparse, streaky and often seen against one straight wall; the best pose of such a scan is a
//! *region*, and a local method stops somewhere in it. Here the scan is scored against the distances from the
//! target at every pose of a lattice, and the answer is the mean and the covariance of the posterior over the winning
//! mode together with the best score found far away from it.
//!
//! - [`Target::locate`]: one scan (or a few merged ones) in a target, from a start with a known uncertainty.
//! - [`align_maps`]: two whole maps with no start at all, over the full turn, as several separate modes.
//!
//! Use ICP instead when the start is good to a fraction of a metre and points are dense.

mod distance_field;
mod kernel_grid;
mod map_alignment;
mod matcher;

pub use distance_field::{DistanceField, FieldParams};
pub use map_alignment::{MapAlignmentParams, MapMode, align_maps};
pub use matcher::{CorrelativeMatch, CorrelativeParams, Start, Target};

//! Objects of a map: density clusters with their rectangles, and persistent cells.
//!
//! Start with [`extract`]; keep numbers steady over time with [`ObjectTracks`]. Whole clusters work where things
//! stand apart, as pilings do; on a real quay their middles depend on how much of it was seen, so long ones are cut,
//! and [`persistent_cells`] do without objects altogether.

mod cells;
mod extract;
mod persistence;
mod rectangle;
mod tracks;

pub use cells::{CellParams, free_cells, persistent_cells};
pub use extract::{Centroid, Object, ObjectParams, extract};
pub use rectangle::{Rectangle, minimum_area_rectangle};
pub use tracks::ObjectTracks;

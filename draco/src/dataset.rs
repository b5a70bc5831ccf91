//! Keyframe folders on disk: `keyframes.csv` and `points.csv`.
//!
//! | file | columns it must have | columns it may have |
//! | --- | --- | --- |
//! | `keyframes.csv` | `robot,kf,time,dr_x,dr_y,dr_theta` | `gt_x,gt_y,gt_theta` (all three or none), `n_points` |
//! | `points.csv` | `kf,x,y` | `robot` |
//!
//! Columns are found by name, in any order; others are ignored. Seconds, metres, radians. Points are in the sensor
//! frame, x forward and y to port. `kf` is unique over the whole file; where `points.csv` has a column `robot`, it
//! need only be unique within a robot. Rows of one robot come in order of time; rows of several robots may be mixed.
//! Empty `gt_*` cells mean that the truth is unknown there. `n_points`, where given, is checked, so that a cut
//! `points.csv` does not pass for a whole one.
//!
//! Start with [`read_keyframe_folder`].

mod read;
mod write;

pub use read::{read_keyframe_folder, read_keyframe_tables};
pub use write::{write_keyframe_folder, write_keyframe_tables};

/// Name of the table of keyframes.
pub const KEYFRAMES_FILE: &str = "keyframes.csv";
/// Name of the table of points.
pub const POINTS_FILE: &str = "points.csv";

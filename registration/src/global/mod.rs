//! Search without a good start: branch and bound over a box of poses, with a certificate and the rivals.

mod best_first;
mod draco1;
mod near_grid;
mod near_start;
mod nearest_grid;
mod se2;
mod se3;
mod window;

pub use draco1::{Draco1Match, Draco1Params, Draco1Rejection, draco1};
pub use near_start::{NearStartParams, align_near_start};
pub use se2::{GlobalMatch, Mode, Pivot, SearchParams, branch_and_bound_2d};
pub use se3::{GlobalMatch3, Mode3, SearchParams3, branch_and_bound_3d};

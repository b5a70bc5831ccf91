//! Density clustering of points in the plane.
//!
//! [`dbscan`] labels a whole cloud; [`Dbscan`] keeps the labels of a growing cloud. Both give the labels of
//! scikit-learn's `DBSCAN` for the same points: neighbours lie within `eps` (inclusive), a point counts itself,
//! clusters are numbered by their first core point, and a border point that touches several clusters joins the
//! one with the smallest number.
mod batch;
mod grid;
mod incremental;

pub use batch::dbscan;
pub use incremental::Dbscan;

use crate::Error;

fn check(eps: f64, min_samples: usize) -> Result<(), Error> {
    if !(eps.is_finite() && eps > 0.0) {
        return Err(Error::BadParameter { name: "eps", value: eps, need: "finite and positive" });
    }
    if min_samples == 0 {
        return Err(Error::BadParameter { name: "min_samples", value: 0.0, need: "at least 1" });
    }
    Ok(())
}

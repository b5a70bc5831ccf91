use draco_registration::{medoid_downsample, radius_outlier_filter};
use nalgebra::{Point2, Vector2};

use crate::Error;

/// Thins a scan: one measured point a cell, and only points with company.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointFilter {
    /// Edge of the cells, metres: of each, the point nearest to the mean stays. Default 0.5.
    pub cell_m: f64,
    /// How far a point looks for neighbours, metres. Default 1.
    pub radius_m: f64,
    /// How many it must find after thinning. Default 5.
    pub min_neighbors: usize,
}

impl Default for PointFilter {
    /// The values of the published system.
    fn default() -> Self {
        Self { cell_m: 0.5, radius_m: 1.0, min_neighbors: 5 }
    }
}

impl PointFilter {
    /// The points that stay, in order of their cells.
    ///
    /// # Errors
    /// [`Error::Registration`] when a parameter is out of range or a point is not finite.
    pub fn apply(&self, points: &[Point2<f64>]) -> Result<Vec<Point2<f64>>, Error> {
        let vectors: Vec<Vector2<f64>> = points.iter().map(|point| point.coords).collect();
        let thinned = medoid_downsample(&vectors, self.cell_m)?;
        let kept = radius_outlier_filter(&thinned, self.radius_m, self.min_neighbors)?;
        Ok(kept.into_iter().map(Point2::from).collect())
    }
}

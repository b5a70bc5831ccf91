use nalgebra::{Matrix2, Point2};

use crate::Error;

/// One object of a robot's map: where it is and how large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Object {
    /// Centre in the map frame, metres.
    pub centroid: Point2<f64>,
    /// Longer side of the bounding rectangle, metres.
    pub length: f64,
    /// Shorter side of the bounding rectangle, metres.
    pub breadth: f64,
    /// Covariance of the centre in the map frame, m²; `None` takes
    /// [`position_sigma`](crate::ConsensusParams::position_sigma).
    pub covariance: Option<Matrix2<f64>>,
}

impl Object {
    /// An object without own covariance.
    pub fn new(centroid: Point2<f64>, length: f64, breadth: f64) -> Self {
        Self { centroid, length, breadth, covariance: None }
    }
}

/// Checks every object of `map`, which the messages call `name`.
pub(crate) fn check_map(map: &[Object], name: &'static str) -> Result<(), Error> {
    for (index, object) in map.iter().enumerate() {
        if !object.centroid.coords.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFinitePoint { what: name, index });
        }
        for value in [object.length, object.breadth] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::BadExtent { map: name, index, value });
            }
        }
        if let Some(c) = object.covariance {
            let scale = c.m11.abs() + c.m22.abs();
            let valid = c.iter().all(|x| x.is_finite())
                && c.m11 >= 0.0
                && c.m22 >= 0.0
                && (c.m12 - c.m21).abs() <= 1e-9 * scale
                && c.determinant() >= -1e-9 * scale * scale;
            if !valid {
                return Err(Error::BadCovariance { map: name, index });
            }
        }
    }
    Ok(())
}

/// Coordinates of all centres.
pub(crate) fn centroids(map: &[Object]) -> Vec<Point2<f64>> {
    map.iter().map(|o| o.centroid).collect()
}

use nalgebra::Point2;

use super::{Cfar, Fan, PointFilter, PolarImage};
use crate::Error;

/// From an image to the points of a keyframe.
#[derive(Debug, Clone, PartialEq)]
pub struct FrontEnd {
    /// Finds echoes.
    pub cfar: Cfar,
    /// Puts them in the sensor frame.
    pub fan: Fan,
    /// Thins them.
    pub filter: PointFilter,
}

impl FrontEnd {
    /// The points of `image`, thinned.
    ///
    /// # Errors
    /// Those of [`Fan::points`] and [`PointFilter::apply`].
    pub fn points(&self, image: &PolarImage) -> Result<Vec<Point2<f64>>, Error> {
        self.filter.apply(&self.fan.points(image, &self.cfar.detect(image))?)
    }
}

use nalgebra::Point2;

use super::PolarImage;
use crate::Error;

/// Where the cells of a polar image lie: evenly spaced beams over an aperture, evenly spaced ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fan {
    /// Range of the far end of the last row, metres.
    pub max_range: f64,
    /// Opening angle from the first to the last column's outer edge, radians.
    pub aperture: f64,
}

impl Default for Fan {
    /// 30 m and 120°, as the published simulation.
    fn default() -> Self {
        Self { max_range: 30.0, aperture: 120.0_f64.to_radians() }
    }
}

impl Fan {
    /// Middles of `cells`, given as row and column of `image`, in the sensor frame: x forward, y to port, metres.
    ///
    /// The published system draws the hits into a Cartesian picture and takes its pixels, which gives each far hit
    /// many points; here one hit is one point.
    ///
    /// # Errors
    /// [`Error::Parameter`] when range or aperture is not positive and finite.
    pub fn points(&self, image: &PolarImage, cells: &[(usize, usize)]) -> Result<Vec<Point2<f64>>, Error> {
        for (name, value) in [("max_range", self.max_range), ("aperture", self.aperture)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::Parameter { name, value, reason: "must be positive and finite" });
            }
        }
        let (rows, columns) = (image.rows() as f64, image.columns() as f64);
        let directions: Vec<_> = (0..image.columns())
            .map(|column| (self.aperture * ((column as f64 + 0.5) / columns - 0.5)).sin_cos())
            .collect();
        let point = |&(row, column): &(usize, usize)| {
            let range = self.max_range * (row as f64 + 0.5) / rows;
            let (sin, cos) = directions.get(column)?;
            Some(Point2::new(range * cos, range * sin))
        };
        Ok(cells.iter().filter_map(point).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_an_image_lie_where_the_fan_puts_them() {
        let image = PolarImage::new(2, vec![0; 20]).expect("whole rows");
        let fan = Fan { max_range: 10.0, aperture: std::f64::consts::PI };
        let points = fan.points(&image, &[(0, 0), (9, 1)]).expect("valid");
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!(
            (points[0] - Point2::new(0.5 * half, -0.5 * half)).norm() < 1e-12,
            "first column to starboard"
        );
        assert!((points[1] - Point2::new(9.5 * half, 9.5 * half)).norm() < 1e-12, "last column to port");
    }
}

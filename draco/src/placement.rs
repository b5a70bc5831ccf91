//! Where closures place one map in another.

use nalgebra::{Isometry2, Point2};

/// What one closure says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Implied {
    /// The other map.
    pub(crate) place: Isometry2<f64>,
    /// Where in the other map it was found, metres.
    pub(crate) middle: Point2<f64>,
}

impl Implied {
    /// Where a closure puts the map of its source in that of its target.
    ///
    /// * `target`, `source` – poses of the two keyframes, each in its robot's own map.
    pub(crate) fn by(
        target: &Isometry2<f64>,
        target_from_source: &Isometry2<f64>,
        source: &Isometry2<f64>,
    ) -> Self {
        let place = target * target_from_source * source.inverse();
        Implied { place, middle: Point2::from(source.translation.vector) }
    }

    /// The same of the first map in the other one.
    pub(crate) fn reversed(&self) -> Self {
        Implied { place: self.place.inverse(), middle: self.place * self.middle }
    }
}

/// The one in the middle of all of them: that to which the others are nearest in sum, told where it was found.
///
/// Cost: `O(n²)`.
pub(crate) fn medoid(implied: &[Implied]) -> Option<Implied> {
    let spread = |of: &Implied| -> f64 {
        implied.iter().map(|other| (other.place * of.middle - of.place * of.middle).norm()).sum()
    };
    let spreads: Vec<f64> = implied.iter().map(spread).collect();
    let least = (0..implied.len()).min_by(|&i, &j| spreads[i].total_cmp(&spreads[j]))?;
    Some(implied[least])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_that_of_the_larger_group() {
        let implied =
            |x: f64| Implied { place: Isometry2::translation(x, 0.0), middle: Point2::new(5.0, 0.0) };
        let all = [6.2, 0.1, 6.1, 0.0, -0.1].map(implied);
        assert_eq!(medoid(&all), Some(implied(0.1)));
        assert_eq!(medoid(&[]), None);
    }
}

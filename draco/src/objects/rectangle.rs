use nalgebra::{Point2, Vector2};

/// A rectangle in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Its corners, counter-clockwise; the first edge is a long one.
    pub corners: [Point2<f64>; 4],
    /// Long side, metres.
    pub length: f64,
    /// Short side, metres.
    pub breadth: f64,
}

/// The rectangle of least area around `points`; `None` without points. One point, or points on a line, give a
/// rectangle without breadth.
///
/// One side of the answer lies on an edge of the convex hull (Freeman and Shapira, 1975), so four calipers walk once
/// around the hull (Toussaint, 1983). Cost O(n log n).
///
/// ```
/// use draco::objects::minimum_area_rectangle;
/// use nalgebra::Point2;
///
/// let diamond = [(2.0, 0.0), (0.0, 1.0), (-2.0, 0.0), (0.0, -1.0)].map(|(x, y)| Point2::new(x, y));
/// let rectangle = minimum_area_rectangle(&diamond).ok_or("no points")?;
/// assert!((rectangle.length * rectangle.breadth - 6.4).abs() < 1e-12);
/// # Ok::<(), &str>(())
/// ```
pub fn minimum_area_rectangle(points: &[Point2<f64>]) -> Option<Rectangle> {
    let hull = convex_hull(points);
    let n = hull.len();
    if n < 3 {
        let (first, last) = (*hull.first()?, *hull.last()?);
        return Some(Rectangle {
            corners: [first, last, last, first],
            length: (last - first).norm(),
            breadth: 0.0,
        });
    }
    let edge = |i: usize| (hull[(i + 1) % n] - hull[i % n]).normalize();
    let mut best: Option<(f64, Rectangle)> = None;
    let (mut right, mut top, mut left) = (1, 1, 1);
    for bottom in 0..n {
        let along = edge(bottom);
        let up = Vector2::new(-along.y, along.x);
        let climbs = |i: usize, axis: &Vector2<f64>| (hull[(i + 1) % n] - hull[i % n]).dot(axis) > 0.0;
        // Each caliper only moves forward; none may lag behind the one before it.
        right = right.max(bottom + 1);
        while climbs(right, &along) {
            right += 1;
        }
        top = top.max(right);
        while climbs(top, &up) {
            top += 1;
        }
        left = left.max(top);
        while climbs(left, &-along) {
            left += 1;
        }
        let base = hull[bottom];
        let (from, to) = ((hull[left % n] - base).dot(&along), (hull[right % n] - base).dot(&along));
        let height = (hull[top % n] - base).dot(&up);
        let area = (to - from) * height;
        if best.as_ref().is_none_or(|(least, _)| area < *least) {
            best = Some((area, oriented(base, along, [from, to], height)));
        }
    }
    best.map(|(_, rectangle)| rectangle)
}

fn oriented(base: Point2<f64>, along: Vector2<f64>, [from, to]: [f64; 2], height: f64) -> Rectangle {
    let up = Vector2::new(-along.y, along.x);
    let corner = |x: f64, y: f64| base + along * x + up * y;
    let ring = [corner(from, 0.0), corner(to, 0.0), corner(to, height), corner(from, height)];
    let width = to - from;
    if width >= height {
        Rectangle { corners: ring, length: width, breadth: height }
    } else {
        Rectangle { corners: [ring[1], ring[2], ring[3], ring[0]], length: height, breadth: width }
    }
}

/// The convex hull, counter-clockwise, without points on its edges (Andrew's monotone chain).
fn convex_hull(points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<Point2<f64>> = Vec::new();
    for pass in 0..2 {
        let start = hull.len();
        for &point in &sorted {
            while let [.., a, b] = hull[start..] {
                if (b - a).perp(&(point - a)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        // The last point of one chain is the first of the other.
        hull.pop();
        if pass == 0 {
            sorted.reverse();
        }
    }
    hull
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Relative error of an area computed by way of unit vectors.
    const AREA_TOLERANCE: f64 = 1e-9;

    fn area_at(points: &[Point2<f64>], axis: Vector2<f64>) -> f64 {
        let extent = |axis: Vector2<f64>| {
            let along = || points.iter().map(|point| point.coords.dot(&axis));
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        };
        extent(axis) * extent(Vector2::new(-axis.y, axis.x))
    }

    fn clouds() -> impl Strategy<Value = Vec<Point2<f64>>> {
        let anywhere = (-10.0..10.0_f64, -10.0..10.0_f64).prop_map(|(x, y)| Point2::new(x, y));
        let lattice = (-3..4_i32, -3..4_i32).prop_map(|(x, y)| Point2::new(f64::from(x), f64::from(y)));
        prop_oneof![prop::collection::vec(anywhere, 1..40), prop::collection::vec(lattice, 1..40)]
    }

    proptest! {
        /// The oracle tries the direction through every pair of points, hull or not.
        #[test]
        fn no_direction_through_two_points_gives_a_smaller_area(points in clouds()) {
            let rectangle = minimum_area_rectangle(&points).expect("points");
            let mut least = f64::INFINITY;
            for a in &points {
                for axis in points.iter().map(|b| b - a).filter(|axis| axis.norm() > 0.0) {
                    least = least.min(area_at(&points, axis.normalize()));
                }
            }
            let area = rectangle.length * rectangle.breadth;
            if least.is_finite() {
                prop_assert!((area - least).abs() <= AREA_TOLERANCE * (1.0 + least), "{area} against {least}");
            }
            prop_assert!(rectangle.length >= rectangle.breadth);
        }

        #[test]
        fn every_point_lies_inside(points in clouds()) {
            let rectangle = minimum_area_rectangle(&points).expect("points");
            let [a, b, _, d] = rectangle.corners;
            for point in &points {
                for axis in [b - a, d - a] {
                    let along = (point - a).dot(&axis);
                    prop_assert!(along >= -1e-9 && along <= axis.norm_squared() + 1e-9);
                }
            }
        }
    }
}

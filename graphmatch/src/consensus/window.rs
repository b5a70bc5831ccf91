use nalgebra::{Point2, Vector2};

use super::evidence::middle;

/// The area a map covers: the convex hull of its objects, grown to what objects spread evenly would need.
#[derive(Debug, Clone)]
pub(super) struct Window {
    /// Corners, counter-clockwise, and the way to the next.
    sides: Vec<(Point2<f64>, Vector2<f64>)>,
    pub(super) area: f64,
    /// Centre of the hull's area.
    pub(super) centre: Point2<f64>,
    /// Objects that the hull was drawn about.
    pub(super) objects: usize,
}

impl Window {
    /// * `margin` – metres, at least this much is added all around.
    pub(super) fn new(points: &[Point2<f64>], margin: f64) -> Self {
        let hull = convex_hull(points);
        // A hull misses about h/n of the area its n points are spread over, h being its corners (Efron 1965).
        let n = points.len().max(1) as f64;
        let kept = (1.0 - hull.len() as f64 / n).max(0.3);
        let centre = centre_of_area(&hull);
        let grown = grow(&hull, &centre, kept.sqrt().recip(), margin);
        let area = polygon_area(&grown).max(4.0 * margin * margin);
        let next = grown.iter().cycle().skip(1);
        let sides = grown.iter().zip(next).map(|(corner, next)| (*corner, next - corner)).collect();
        Self { sides, area, centre, objects: points.len() }
    }

    pub(super) fn contains(&self, p: &Point2<f64>) -> bool {
        self.sides.iter().all(|(corner, side)| side.x * (p.y - corner.y) - side.y * (p.x - corner.x) >= 0.0)
    }
}

pub(super) fn polygon_area(corners: &[Point2<f64>]) -> f64 {
    let n = corners.len();
    0.5 * (0..n).map(|k| corners[k].coords.perp(&corners[(k + 1) % n].coords)).sum::<f64>()
}

pub(super) fn perimeter(corners: &[Point2<f64>]) -> f64 {
    let n = corners.len();
    (0..n).map(|k| (corners[(k + 1) % n] - corners[k]).norm()).sum()
}

/// Centre of a convex polygon's area, of its corners if it has none.
fn centre_of_area(corners: &[Point2<f64>]) -> Point2<f64> {
    let n = corners.len();
    let (mut sum, mut area) = (Vector2::zeros(), 0.0);
    for k in 1..n.saturating_sub(1) {
        // Triangles about the first corner.
        let (a, b) = (corners[k] - corners[0], corners[k + 1] - corners[0]);
        sum += (a + b) * a.perp(&b);
        area += a.perp(&b);
    }
    if area > 0.0 { corners[0] + sum / (3.0 * area) } else { middle(corners) }
}

fn grow(hull: &[Point2<f64>], centre: &Point2<f64>, factor: f64, margin: f64) -> Vec<Point2<f64>> {
    // The hull of the grown corners with a square of the margin around each: valid for segments and points too.
    let mut corners = Vec::with_capacity(4 * hull.len());
    for p in hull {
        let q = centre + (p - centre) * factor;
        for (dx, dy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            corners.push(Point2::new(q.x + dx * margin, q.y + dy * margin));
        }
    }
    convex_hull(&corners)
}

/// Corners of the convex hull, counter-clockwise, by the monotone chain.
pub(super) fn convex_hull(points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<Point2<f64>> = Vec::with_capacity(2 * sorted.len());
    let chain = |hull: &mut Vec<Point2<f64>>, p: Point2<f64>, floor: usize| {
        while hull.len() >= floor + 2 {
            let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
            if (b - a).perp(&(p - a)) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(p);
    };
    for p in &sorted {
        chain(&mut hull, *p, 0);
    }
    let floor = hull.len() - 1;
    for p in sorted.iter().rev().skip(1) {
        chain(&mut hull, *p, floor);
    }
    hull.pop();
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_of_a_square_with_inner_points_is_the_square() {
        let points = [(0.0, 0.0), (2.0, 0.0), (1.0, 1.0), (2.0, 2.0), (0.0, 2.0), (1.0, 0.0)];
        let hull = convex_hull(&points.map(|(x, y)| Point2::new(x, y)));
        assert_eq!(hull.len(), 4);
        assert_eq!(polygon_area(&hull), 4.0);
    }

    #[test]
    fn centre_of_area_is_not_that_of_the_corners() {
        // A square of side 2 with a triangle of height 3 on its right side: areas 4 and 3, centres at x = 1 and 3.
        let corners = [(0.0, 0.0), (2.0, 0.0), (5.0, 1.0), (2.0, 2.0), (0.0, 2.0)];
        let centre = centre_of_area(&corners.map(|(x, y)| Point2::new(x, y)));
        assert!((centre - Point2::new(13.0 / 7.0, 1.0)).norm() < 1e-12, "{centre}");
        let segment = [Point2::new(0.0, 0.0), Point2::new(4.0, 2.0)];
        assert_eq!(centre_of_area(&segment), Point2::new(2.0, 1.0));
    }

    #[test]
    fn window_of_collinear_points_has_the_margin_around() {
        let window = Window::new(&[Point2::new(0.0, 0.0), Point2::new(5.0, 0.0), Point2::new(9.0, 0.0)], 1.0);
        assert!(window.contains(&Point2::new(4.0, 0.9)));
        assert!(!window.contains(&Point2::new(4.0, 1.1)));
    }
}

use nalgebra::{Isometry2, Point2, Vector2};

/// A shape the sonar sees.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A round body, such as a pile.
    Disk {
        /// Its middle, metres.
        center: Point2<f64>,
        /// Its radius, metres.
        radius: f64,
    },
    /// A straight wall between two ends.
    Segment([Point2<f64>; 2]),
    /// A closed outline.
    Polygon(Vec<Point2<f64>>),
}

/// A shape and how much of the sound it sends back.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Where it is.
    pub shape: Shape,
    /// Echo strength in [0, 1].
    pub reflectivity: f64,
    /// What it belongs to: parts of one object share a number.
    pub object: u32,
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub range: f64,
    /// Cosine of the angle between the ray and the surface's normal, 0 (grazing) to 1.
    pub cos_incidence: f64,
    /// Echo strength of the surface.
    pub reflectivity: f64,
    /// Number of the object hit.
    pub object: u32,
}

/// All that stands in the water, in two dimensions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct World {
    /// The solids in it.
    pub solids: Vec<Solid>,
}

impl World {
    /// Adds a solid as an object of its own and returns the object's number.
    pub fn add(&mut self, shape: Shape, reflectivity: f64) -> u32 {
        let object = self.solids.iter().map(|solid| solid.object + 1).max().unwrap_or(0);
        self.solids.push(Solid { shape, reflectivity, object });
        object
    }

    /// Adds a solid as part of the object `object`.
    pub fn add_part(&mut self, shape: Shape, reflectivity: f64, object: u32) {
        self.solids.push(Solid { shape, reflectivity, object });
    }

    /// Where the ray from `origin` along the unit vector `direction` first meets a surface, and where it would meet
    /// the next one if it passed the first; at most `max_range` metres away.
    pub fn cast(&self, origin: &Point2<f64>, direction: &Vector2<f64>, max_range: f64) -> [Option<Hit>; 2] {
        let mut nearest: [Option<Hit>; 2] = [None, None];
        for solid in &self.solids {
            solid.shape.crossings(origin, direction, |range, normal| {
                if range <= 0.0 || range > max_range {
                    return;
                }
                let hit = Hit {
                    range,
                    cos_incidence: direction.dot(&normal).abs(),
                    reflectivity: solid.reflectivity,
                    object: solid.object,
                };
                if nearest[0].is_none_or(|first| range < first.range) {
                    nearest = [Some(hit), nearest[0]];
                } else if nearest[1].is_none_or(|second| range < second.range) {
                    nearest[1] = Some(hit);
                }
            });
        }
        nearest
    }

    /// Distance from `point` to the nearest surface, metres; infinite in an empty world, 0 inside a solid.
    pub fn clearance(&self, point: &Point2<f64>) -> f64 {
        self.solids.iter().map(|solid| solid.shape.distance(point)).fold(f64::INFINITY, f64::min)
    }

    /// The solids near enough to `pose` to be seen within `max_range`, so that casting many rays from there is cheap.
    pub fn near(&self, pose: &Isometry2<f64>, max_range: f64) -> Self {
        let here = Point2::from(pose.translation.vector);
        let solids = self.solids.iter().filter(|solid| solid.shape.distance(&here) <= max_range);
        Self { solids: solids.cloned().collect() }
    }
}

impl Shape {
    /// An axis-aligned rectangle of size `length` × `width` centred on and turned by `pose`.
    pub fn rectangle(pose: &Isometry2<f64>, length: f64, width: f64) -> Self {
        let (x, y) = (0.5 * length, 0.5 * width);
        let corners = [(-x, -y), (x, -y), (x, y), (-x, y)];
        Self::Polygon(corners.iter().map(|&(x, y)| pose * Point2::new(x, y)).collect())
    }

    fn corners(&self) -> &[Point2<f64>] {
        match self {
            Self::Disk { .. } => &[],
            Self::Segment(ends) => ends,
            Self::Polygon(corners) => corners,
        }
    }

    /// Edges as pairs of ends; the ring of a segment is its one edge, not there and back.
    fn edges(&self) -> impl Iterator<Item = (&Point2<f64>, &Point2<f64>)> {
        let corners = self.corners();
        let closing = usize::from(matches!(self, Self::Segment(_)));
        corners.iter().zip(corners.iter().cycle().skip(1)).take(corners.len().saturating_sub(closing))
    }

    /// Calls `found` with the distance and the unit normal of every crossing of the line through `origin`, also of
    /// those behind it.
    fn crossings(
        &self,
        origin: &Point2<f64>,
        direction: &Vector2<f64>,
        mut found: impl FnMut(f64, Vector2<f64>),
    ) {
        if let Self::Disk { center, radius } = self {
            let to_center = center - origin;
            let along = to_center.dot(direction);
            let half_chord_sq = radius * radius - (to_center.norm_squared() - along * along);
            if half_chord_sq > 0.0 {
                for range in [along - half_chord_sq.sqrt(), along + half_chord_sq.sqrt()] {
                    found(range, (origin + direction * range - center) / *radius);
                }
            }
        }
        for (a, b) in self.edges() {
            let edge = b - a;
            let determinant = direction.perp(&edge);
            // A ray along the edge sees its end face only, which has no width.
            if determinant.abs() < 1e-12 {
                continue;
            }
            let to_start = a - origin;
            let (range, along) = (to_start.perp(&edge) / determinant, to_start.perp(direction) / determinant);
            if (0.0..=1.0).contains(&along) {
                found(range, Vector2::new(-edge.y, edge.x) / edge.norm());
            }
        }
    }

    /// Distance from `point` to the shape, 0 inside it.
    pub fn distance(&self, point: &Point2<f64>) -> f64 {
        if let Self::Disk { center, radius } = self {
            return ((point - center).norm() - radius).max(0.0);
        }
        if self.encloses(point) {
            return 0.0;
        }
        let to_edge = |(a, b): (&Point2<f64>, &Point2<f64>)| {
            let edge = b - a;
            let along = ((point - a).dot(&edge) / edge.norm_squared()).clamp(0.0, 1.0);
            (point - (a + edge * along)).norm()
        };
        self.edges().map(to_edge).fold(f64::INFINITY, f64::min)
    }

    /// Even-odd rule; a wall encloses nothing.
    fn encloses(&self, point: &Point2<f64>) -> bool {
        let Self::Polygon(_) = self else { return false };
        let crosses = |(a, b): &(&Point2<f64>, &Point2<f64>)| {
            (a.y > point.y) != (b.y > point.y) && point.x < (b.x - a.x) * (point.y - a.y) / (b.y - a.y) + a.x
        };
        self.edges().filter(crosses).count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_first_the_near_and_then_the_far_surface() {
        let mut world = World::default();
        world.add(Shape::Disk { center: Point2::new(10.0, 0.0), radius: 1.0 }, 0.5);
        world.add(Shape::Segment([Point2::new(5.0, -1.0), Point2::new(5.0, 1.0)]), 1.0);
        let [first, second] = world.cast(&Point2::origin(), &Vector2::x(), 30.0);
        let (first, second) = (first.expect("wall"), second.expect("disk"));
        assert_eq!((first.range, first.object, first.cos_incidence), (5.0, 1, 1.0));
        assert_eq!((second.range, second.object, second.reflectivity), (9.0, 0, 0.5));
        assert_eq!(world.cast(&Point2::origin(), &-Vector2::x(), 30.0), [None, None]);
        assert_eq!(world.cast(&Point2::origin(), &Vector2::x(), 4.0), [None, None]);
    }

    #[test]
    fn distance_is_zero_inside_and_straight_outside() {
        let square = Shape::rectangle(&Isometry2::translation(2.0, 0.0), 2.0, 2.0);
        assert_eq!(square.distance(&Point2::new(2.5, 0.3)), 0.0);
        assert!((square.distance(&Point2::new(0.0, 0.0)) - 1.0).abs() < 1e-15);
        assert!((square.distance(&Point2::new(4.0, 2.0)) - 2.0_f64.sqrt()).abs() < 1e-15);
    }
}

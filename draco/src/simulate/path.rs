use nalgebra::{Isometry2, Point2, UnitComplex, Vector2};

/// When a new keyframe is due.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeyframePolicy {
    /// Translation since the last keyframe, metres. Default 3, as the published system.
    pub translation_m: f64,
    /// Rotation since the last keyframe, radians. Default 30°, as the published system.
    pub rotation_rad: f64,
    /// Least time between keyframes, seconds. Default 1, as the published system.
    pub interval_s: f64,
}

impl Default for KeyframePolicy {
    fn default() -> Self {
        Self { translation_m: 3.0, rotation_rad: 30.0_f64.to_radians(), interval_s: 1.0 }
    }
}

impl KeyframePolicy {
    /// Which of the poses, given with their times, become keyframes: the first, and then each that has moved or
    /// turned far enough from the keyframe before it.
    pub fn select(&self, path: &[(f64, Isometry2<f64>)]) -> Vec<(f64, Isometry2<f64>)> {
        let mut kept: Vec<(f64, Isometry2<f64>)> = Vec::new();
        for &(time, pose) in path {
            let due = kept.last().is_none_or(|(last_time, last)| {
                let moved = (pose.translation.vector - last.translation.vector).norm() > self.translation_m;
                let turned = last.rotation.angle_to(&pose.rotation).abs() > self.rotation_rad;
                time - last_time >= self.interval_s && (moved || turned)
            });
            if due {
                kept.push((time, pose));
            }
        }
        kept
    }
}

/// Distance between poses of [`follow`], metres: a hundredth of what makes a keyframe.
const STEP_M: f64 = 0.03;

/// Poses of a vehicle that follows a smooth curve through `way_points` at `speed` metres a second, heading along the
/// curve, with their times. The curve is a centripetal Catmull-Rom spline, which neither loops nor overshoots at
/// uneven way-points.
pub fn follow(way_points: &[Point2<f64>], speed: f64) -> Vec<(f64, Isometry2<f64>)> {
    let curve = resample(&spline(way_points), STEP_M);
    let pose = |(index, pair): (usize, &[Point2<f64>])| {
        let direction = pair[1] - pair[0];
        let heading = UnitComplex::new(direction.y.atan2(direction.x));
        (index as f64 * STEP_M / speed, Isometry2::from_parts(pair[0].coords.into(), heading))
    };
    curve.windows(2).enumerate().map(pose).collect()
}

fn spline(way_points: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let (Some(first), Some(last)) = (way_points.first(), way_points.last()) else { return Vec::new() };
    // The curve needs a neighbour beyond each end: the mirror image of the one before.
    let before = way_points.get(1).map_or(*first, |second| first + (first - second));
    let after = way_points.iter().rev().nth(1).map_or(*last, |second| last + (last - second));
    let mut knots = vec![before];
    knots.extend_from_slice(way_points);
    knots.push(after);
    let mut curve = Vec::new();
    for quad in knots.windows(4) {
        let pieces = ((quad[2] - quad[1]).norm() / (0.5 * STEP_M)).ceil().max(1.0) as usize;
        curve.extend((0..pieces).map(|piece| catmull_rom(quad, piece as f64 / pieces as f64)));
    }
    curve.push(*last);
    curve
}

/// The point at share `u` of the way from `quad[1]` to `quad[2]` (Barry and Goldman's recursion, exponent 1/2).
fn catmull_rom(quad: &[Point2<f64>], u: f64) -> Point2<f64> {
    let knot = |from: f64, a: usize| from + (quad[a + 1] - quad[a]).norm().sqrt().max(1e-6);
    let t0 = 0.0;
    let t1 = knot(t0, 0);
    let t2 = knot(t1, 1);
    let t3 = knot(t2, 2);
    let t = t1 + u * (t2 - t1);
    let mix = |a: Vector2<f64>, b: Vector2<f64>, ta: f64, tb: f64| (a * (tb - t) + b * (t - ta)) / (tb - ta);
    let [p0, p1, p2, p3] = [quad[0].coords, quad[1].coords, quad[2].coords, quad[3].coords];
    let (a1, a2, a3) = (mix(p0, p1, t0, t1), mix(p1, p2, t1, t2), mix(p2, p3, t2, t3));
    let (b1, b2) = (mix(a1, a2, t0, t2), mix(a2, a3, t1, t3));
    Point2::from(mix(b1, b2, t1, t2))
}

/// Points `step` apart along the polyline `curve`.
fn resample(curve: &[Point2<f64>], step: f64) -> Vec<Point2<f64>> {
    let mut points: Vec<Point2<f64>> = curve.first().copied().into_iter().collect();
    let mut travelled = 0.0;
    for pair in curve.windows(2) {
        let (edge, length) = (pair[1] - pair[0], (pair[1] - pair[0]).norm());
        while length > 0.0 && points.len() as f64 * step <= travelled + length {
            points.push(pair[0] + edge * ((points.len() as f64 * step - travelled) / length));
        }
        travelled += length;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_passes_its_way_points_at_the_speed_asked_for() {
        let way_points = [(0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (2.0, 9.0)].map(|(x, y)| Point2::new(x, y));
        let path = follow(&way_points, 0.5);
        for way_point in way_points {
            let nearest = path.iter().map(|(_, pose)| (pose.translation.vector - way_point.coords).norm());
            assert!(nearest.fold(f64::INFINITY, f64::min) < 2.0 * STEP_M);
        }
        for pair in path.windows(2) {
            let moved = (pair[1].1.translation.vector - pair[0].1.translation.vector).norm();
            let speed = moved / (pair[1].0 - pair[0].0);
            assert!((speed - 0.5).abs() < 1e-2, "{speed}");
        }
    }

    #[test]
    fn keyframes_come_every_three_metres_or_thirty_degrees() {
        let straight = follow(&[Point2::origin(), Point2::new(31.0, 0.0)], 0.5);
        assert_eq!(KeyframePolicy::default().select(&straight).len(), 11);
        let turning: Vec<_> =
            (0..=90).map(|deg| (f64::from(deg), Isometry2::rotation(-f64::from(deg).to_radians()))).collect();
        let times: Vec<_> =
            KeyframePolicy::default().select(&turning).iter().map(|(time, _)| *time).collect();
        assert_eq!(times, [0.0, 31.0, 62.0]);
    }
}

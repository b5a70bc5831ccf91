use std::collections::HashSet;

use nalgebra::{Isometry2, Point2};

/// Merges scans at their poses and thins the result: of the points in one cell of `voxel` metres the first stays.
///
/// * `scans` – pose of each scan in some frame, and its points in the scan's own frame.
/// * `frame` – pose, in that same frame, of the frame the result is wanted in.
///
/// Deterministic: points keep the order of the scans.
pub fn merge<'a>(
    scans: impl IntoIterator<Item = (Isometry2<f64>, &'a [Point2<f64>])>,
    frame: &Isometry2<f64>,
    voxel: f64,
) -> Vec<Point2<f64>> {
    let into_frame = frame.inverse();
    let mut taken = HashSet::new();
    let mut merged = Vec::new();
    for (pose, points) in scans {
        let pose = into_frame * pose;
        for point in points {
            let point = pose * point;
            if taken.insert(((point.x / voxel).floor() as i64, (point.y / voxel).floor() as i64)) {
                merged.push(point);
            }
        }
    }
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_meet_in_the_wanted_frame() {
        let scan = [Point2::new(1.0, 0.0)];
        let quarter = std::f64::consts::FRAC_PI_2;
        let poses = [Isometry2::new([2.0, 0.0].into(), quarter), Isometry2::new([1.0, 1.0].into(), 0.0)];
        // Both scans see the point (2, 1); from the frame at (2, 0) it lies one ahead.
        let merged = merge(poses.map(|pose| (pose, scan.as_slice())), &poses[0], 0.35);
        assert_eq!(merged.len(), 1);
        assert!((merged[0] - Point2::new(1.0, 0.0)).norm() < 1e-12);
    }
}

//! The first DRACo-SLAM as a baseline: ring keys find pairs of submaps, global registration joins them.
//!
//! A robot sends a ring key of sixteen bytes a keyframe; the receiver looks for its own keyframes with similar keys,
//! asks for the scans and registers them without any prior. Nothing here is used by [`Robot`](crate::robot::Robot);
//! experiments compare with it.
//!
//! **Source**: McConnell, Huang, Szenher, Collado-Gonzalez, Englot, "DRACo-SLAM: distributed robust acoustic
//! communication-efficient SLAM for imaging sonar equipped underwater robot teams", 2022.

use draco_registration::global::{Draco1Params, draco1};
use draco_registration::{Cloud, StopRule, Target};
use nalgebra::{Isometry2, Point2};

use crate::error::Error;

/// Bearings of the scan context.
const BEARINGS: usize = 100;
/// Ranges of the scan context, the length of a ring key.
pub const RINGS: usize = 16;
/// Largest range of the scan context, metres.
const MAX_RANGE: f64 = 40.0;

/// How many bearings of each ring hold a point.
pub type RingKey = [u8; RINGS];

/// The ring key of a submap in its own frame: a number a ring that no turn of the robot changes.
///
/// Bearings are taken from the size of the angle as in the released code, so both sides of the robot share their cells.
pub fn ring_key(points: &[Point2<f64>]) -> RingKey {
    let mut context = [[false; BEARINGS]; RINGS];
    for point in points {
        let range = point.coords.norm();
        if range < MAX_RANGE {
            let bearing = (point.x.atan2(point.y).abs() / std::f64::consts::PI + 1.0) / 2.0;
            let column = ((bearing * BEARINGS as f64) as usize).min(BEARINGS - 1);
            context[(range / MAX_RANGE * RINGS as f64) as usize][column] = true;
        }
    }
    context.map(|ring| ring.iter().filter(|hit| **hit).count() as u8)
}

/// The `count` keys of `keys` nearest to `key` within Euclidean distance `radius`, nearest first. Cost `O(n log n)`.
pub fn nearest_keys(keys: &[RingKey], key: &RingKey, count: usize, radius: f64) -> Vec<usize> {
    let distance_sq = |other: &RingKey| -> f64 {
        other.iter().zip(key).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum()
    };
    let mut near: Vec<(f64, usize)> = keys.iter().map(distance_sq).zip(0..).collect();
    near.retain(|(distance_sq, _)| *distance_sq <= radius * radius);
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().take(count).map(|(_, index)| index).collect()
}

/// How the transform of a match is put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Composition {
    /// As the released port does: the inverses of search and refinement in the wrong order.
    AsCoded,
    /// As it has to be.
    Corrected,
}

/// A pair of submaps that the baseline has registered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draco1Closure {
    /// The source submap's frame in the target's.
    pub target_from_source: Isometry2<f64>,
    /// Share of the target's points with a source point near, before refinement; the baseline's only gate.
    pub overlap: f64,
}

/// Registers two submaps without prior, as the first DRACo-SLAM does. `None` when a gate before the overlap fails.
///
/// * `target`, `source` – points of the two submaps, each in its own frame.
///
/// # Errors
/// Those of the registration.
pub fn register(
    target: &[Point2<f64>],
    source: &[Point2<f64>],
    composition: Composition,
    params: &Draco1Params,
) -> Result<Option<Draco1Closure>, Error> {
    let (few, many) = (target.len().min(source.len()), target.len().max(source.len()));
    if few < params.min_points || many as f64 > params.max_point_ratio * few as f64 {
        return Ok(None);
    }
    let cloud = |points: &[Point2<f64>]| Cloud::new(points.iter().map(|p| p.coords).collect());
    let (target, source) = (Target::new(&cloud(target)?)?, cloud(source)?);
    let found = draco1(&target, &source, &Isometry2::identity(), params)?;
    let refined = found.registration.target_from_source;
    let target_from_source = match composition {
        Composition::Corrected => refined,
        Composition::AsCoded => {
            // the search alone, so that both parts are at hand
            let mut search_only = params.clone();
            search_only.icp.stop = StopRule { max_iterations: 0, ..search_only.icp.stop };
            let searched = draco1(&target, &source, &Isometry2::identity(), &search_only)?;
            let searched = searched.registration.target_from_source;
            let refinement = refined * searched.inverse();
            (refinement.inverse() * searched.inverse()).inverse()
        }
    };
    Ok(Some(Draco1Closure { target_from_source, overlap: found.search_overlap }))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn a_ring_key_counts_bearings_by_range() {
        let key = ring_key(&[
            Point2::new(1.0, 0.0),
            Point2::new(1.01, 0.0),
            Point2::new(0.0, 1.0),
            Point2::new(39.0, 0.0),
        ]);
        assert_eq!((key[0], key[15], key.iter().map(|k| u32::from(*k)).sum::<u32>()), (2, 1, 3));
        let keys = [[0; RINGS], key, [9; RINGS]];
        assert_eq!(nearest_keys(&keys, &key, 2, 20.0), [1, 0]);
    }

    #[test]
    fn a_submap_is_found_again_and_the_wrong_order_only_agrees_without_refinement() {
        let wall = |i: usize| Point2::new(10.0 + 0.1 * (i % 7) as f64, 0.25 * i as f64 - 8.0);
        let side = |i: usize| Point2::new(0.3 * i as f64 - 5.0, 9.0 - 0.02 * i as f64);
        let target: Vec<_> = (0..70).map(wall).chain((0..60).map(side)).collect();
        let target_from_source = Isometry2::new(Vector2::new(3.0, -1.0), 0.3);
        let source: Vec<_> = target.iter().map(|p| target_from_source.inverse_transform_point(p)).collect();
        let params = Draco1Params { rotation: 0.6, ..Draco1Params::default() };
        let found = register(&target, &source, Composition::Corrected, &params).unwrap().unwrap();
        let error = found.target_from_source.inv_mul(&target_from_source);
        assert!(error.translation.vector.norm() < 0.5 && found.overlap > 0.9, "{error} {}", found.overlap);
        let coded = register(&target, &source, Composition::AsCoded, &params).unwrap().unwrap();
        assert_ne!(coded.target_from_source, found.target_from_source);
        assert!(register(&target[..20], &source, Composition::Corrected, &params).unwrap().is_none());
    }
}

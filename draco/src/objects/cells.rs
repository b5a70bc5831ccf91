use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry2, Point2};

use crate::keyframe::Keyframe;
use crate::message::CellMap;

/// How a map is turned into cells.
#[derive(Debug, Clone, PartialEq)]
pub struct CellParams {
    /// Edge of a cell, metres. Default 2 m: two local maps of the same place differ by about that much, so smaller
    /// cells cost more bits and tell no more.
    pub size: f64,
    /// Keyframes that have to see a cell. Default 3; clutter and moving things are seen less often.
    pub min_keyframes: usize,
}

impl Default for CellParams {
    fn default() -> Self {
        CellParams { size: 2.0, min_keyframes: 3 }
    }
}

/// The cells of a map that several keyframes agree are occupied.
///
/// * `poses` – pose of each keyframe in the map.
///
/// Cost: `O(n log n)` in the number of points.
pub fn persistent_cells(keyframes: &[Keyframe], poses: &[Isometry2<f64>], params: &CellParams) -> CellMap {
    let mut seen: BTreeMap<[i32; 2], usize> = BTreeMap::new();
    for (keyframe, pose) in keyframes.iter().zip(poses) {
        let cell = |p: &Point2<f64>| {
            let p = pose * p;
            [(p.x / params.size).floor() as i32, (p.y / params.size).floor() as i32]
        };
        let cells: BTreeSet<[i32; 2]> = keyframe.points.iter().map(cell).collect();
        for cell in cells {
            *seen.entry(cell).or_default() += 1;
        }
    }
    let cells = seen.into_iter().filter(|(_, count)| *count >= params.min_keyframes).map(|(cell, _)| cell);
    CellMap { size: params.size, keyframes: poses.len() as u32, cells: cells.collect() }
}

/// The cells of a map that several keyframes looked through: rays to their points cross them, and nothing was ever
/// seen in them or next to them.
///
/// * `poses` – pose of each keyframe in the map.
///
/// Cost: `O(n r / size)` for `n` points at range `r`.
pub fn free_cells(
    keyframes: &[Keyframe],
    poses: &[Isometry2<f64>],
    params: &CellParams,
) -> BTreeSet<[i32; 2]> {
    let cell = |p: &Point2<f64>| [(p.x / params.size).floor() as i32, (p.y / params.size).floor() as i32];
    let mut seen_through: BTreeMap<[i32; 2], usize> = BTreeMap::new();
    let mut occupied: BTreeSet<[i32; 2]> = BTreeSet::new();
    for (keyframe, pose) in keyframes.iter().zip(poses) {
        let origin = pose * Point2::origin();
        let mut crossed: BTreeSet<[i32; 2]> = BTreeSet::new();
        for point in &keyframe.points {
            let end = pose * point;
            occupied.insert(cell(&end));
            let ray = end - origin;
            // half a cell a step finds every cell but corners cut
            let steps = (ray.norm() / (0.5 * params.size)).floor() as usize;
            crossed.extend((0..steps).map(|i| cell(&(origin + ray * (i as f64 / steps as f64)))));
        }
        for cell in crossed {
            *seen_through.entry(cell).or_default() += 1;
        }
    }
    let near_occupied =
        |[i, j]: [i32; 2]| (i - 1..=i + 1).any(|i| (j - 1..=j + 1).any(|j| occupied.contains(&[i, j])));
    let free = seen_through.into_iter().filter(|(_, count)| *count >= params.min_keyframes);
    free.map(|(cell, _)| cell).filter(|cell| !near_occupied(*cell)).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn a_cell_needs_its_number_of_keyframes() {
        let scan = |index, points: &[[f64; 2]]| Keyframe {
            index,
            time: 0.0,
            odometry: Isometry2::identity(),
            points: points.iter().map(|p| Point2::from(*p)).collect(),
        };
        // the wall point at x = 5 is seen from all three poses, the others from one each
        let keyframes =
            [scan(0, &[[5.0, 1.0], [9.0, 9.0]]), scan(1, &[[4.0, 1.0], [4.2, 1.0]]), scan(2, &[[3.0, 1.0]])];
        let poses = [0.0, 1.0, 2.0].map(|x| Isometry2::new(Vector2::new(x, 0.0), 0.0));
        let map = persistent_cells(&keyframes, &poses, &CellParams::default());
        assert_eq!(map.cells, [[2, 0]]);
        assert_eq!(map.keyframes, 3);
    }
}

use std::collections::BTreeMap;

use nalgebra::{Isometry2, Point2};

/// How a map is reduced to persistent cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellParams {
    /// Edge of a cell, metres. Default 2 m: the error that a robot's own map has by then.
    pub size: f64,
    /// Least number of keyframes that saw something in the cell. Default 3, which leaves out noise and what moved.
    pub min_keyframes: u32,
}

impl Default for CellParams {
    fn default() -> Self {
        Self { size: 2.0, min_keyframes: 3 }
    }
}

/// Columns and rows of the cells that enough keyframes saw something in, ascending; cell `(i, j)` covers
/// `[i, i + 1) × [j, j + 1)` times the size.
///
/// * `scans` – pose of each scan in the map's frame, and its points in its own frame.
pub fn persistent_cells<'a>(
    scans: impl IntoIterator<Item = (Isometry2<f64>, &'a [Point2<f64>])>,
    params: &CellParams,
) -> Vec<[i32; 2]> {
    // Count of keyframes, and the last one counted.
    let mut seen: BTreeMap<[i32; 2], (u32, usize)> = BTreeMap::new();
    for (index, (pose, points)) in scans.into_iter().enumerate() {
        for point in points {
            let at = pose * point;
            let cell = [(at.x / params.size).floor() as i32, (at.y / params.size).floor() as i32];
            let entry = seen.entry(cell).or_insert((0, usize::MAX));
            if entry.1 != index {
                *entry = (entry.0 + 1, index);
            }
        }
    }
    seen.into_iter().filter(|(_, (count, _))| *count >= params.min_keyframes).map(|(cell, _)| cell).collect()
}

/// Centres of cells, metres.
pub fn cell_centres(cells: &[[i32; 2]], size: f64) -> Vec<Point2<f64>> {
    cells.iter().map(|[i, j]| Point2::new((f64::from(*i) + 0.5) * size, (f64::from(*j) + 0.5) * size)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_counts_keyframes_not_points() {
        let often = [Point2::new(0.1, 0.1), Point2::new(0.2, 0.2), Point2::new(0.3, 0.3)];
        let once = [Point2::new(-0.5, 0.1)];
        let poses = [0.0, 0.4, 0.8].map(|x| Isometry2::translation(x, 0.0));
        let mut scans: Vec<_> = poses.iter().map(|pose| (*pose, often.as_slice())).collect();
        scans.push((poses[0], once.as_slice()));
        let cells = persistent_cells(scans.clone(), &CellParams::default());
        assert_eq!(cells, [[0, 0]]);
        let single = persistent_cells(scans, &CellParams { min_keyframes: 1, ..CellParams::default() });
        assert_eq!(single, [[-1, 0], [0, 0]]);
        assert_eq!(cell_centres(&single, 2.0), [Point2::new(-1.0, 1.0), Point2::new(1.0, 1.0)]);
    }
}

use nalgebra::{Isometry2, Point2, Vector2};

use crate::keyframe::Keyframe;

/// Edge of the cells in which seeing and seeing through are counted, metres: less than anything that moves is wide.
const CELL_M: f64 = 1.0;
/// Largest grid; a map that spreads over more is not judged.
const MOST_CELLS: f64 = 4e6;

/// For each point of each keyframe whether it is part of something that stays.
///
/// A place stays unless more keyframes looked through it than saw something there: what moves is seen at a place by
/// few, and others see what is behind. A keyframe that sees something in a cell or next to it does not count as looking
/// through.
///
/// Cost: `O(n r / cell)` for `n` points at range `r`.
pub(super) fn stays(keyframes: &[Keyframe], poses: &[Isometry2<f64>]) -> Vec<Vec<bool>> {
    let scans: Vec<(Point2<f64>, Vec<Point2<f64>>)> = keyframes
        .iter()
        .zip(poses)
        .map(|(keyframe, pose)| {
            (pose * Point2::origin(), keyframe.points.iter().map(|point| pose * point).collect())
        })
        .collect();
    let Some(mut grid) = Grid::around(&scans) else {
        return scans.iter().map(|(_, points)| vec![true; points.len()]).collect();
    };
    for (number, (origin, points)) in (1..).zip(&scans) {
        grid.add(number, origin, points);
    }
    let keeps = |point: &Point2<f64>| grid.cells[grid.at(point)].stays();
    scans.iter().map(|(_, points)| points.iter().map(keeps).collect()).collect()
}

#[derive(Clone, Copy, Default)]
struct Cell {
    seen: u32,
    through: u32,
    /// The keyframe that has counted here last, and the one that saw something here or next to here.
    counted: u32,
    near: u32,
    hit: u32,
}

impl Cell {
    fn stays(self) -> bool {
        self.through <= self.seen
    }
}

struct Grid {
    low: Point2<f64>,
    columns: usize,
    cells: Vec<Cell>,
}

impl Grid {
    /// `None` for no points, ones that are too far apart, and ones that are nowhere.
    fn around(scans: &[(Point2<f64>, Vec<Point2<f64>>)]) -> Option<Self> {
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        let all = || scans.iter().flat_map(|(origin, points)| points.iter().chain([origin]));
        if !all().all(|point| (point.x + point.y).is_finite()) {
            return None;
        }
        for point in all() {
            low = low.inf(&point.coords);
            high = high.sup(&point.coords);
        }
        let margin = Vector2::repeat(2.0 * CELL_M);
        let sides = ((high - low + 2.0 * margin) / CELL_M).map(f64::ceil);
        // a side that is not finite fails this, too
        if !(sides.x * sides.y <= MOST_CELLS && sides.x >= 1.0) {
            return None;
        }
        let (columns, rows) = (sides.x as usize, sides.y as usize);
        Some(Grid { low: Point2::from(low - margin), columns, cells: vec![Cell::default(); columns * rows] })
    }

    fn at(&self, point: &Point2<f64>) -> usize {
        let offset = (point - self.low) / CELL_M;
        offset.y as usize * self.columns + offset.x as usize
    }

    /// Counts what keyframe `number`, counting from 1, saw and looked through from `origin`.
    fn add(&mut self, number: u32, origin: &Point2<f64>, points: &[Point2<f64>]) {
        for point in points {
            let at = self.at(point);
            // the margin leaves a cell on every side
            for row in [at - self.columns, at, at + self.columns] {
                self.cells[row - 1..=row + 1].iter_mut().for_each(|cell| cell.near = number);
            }
            let cell = &mut self.cells[at];
            if cell.hit != number {
                cell.hit = number;
                cell.seen += 1;
            }
        }
        for point in points {
            let ray = point - origin;
            // half a cell a step finds every cell but corners cut
            let steps = (2.0 * ray.norm() / CELL_M) as usize;
            for step in 0..steps {
                let at = self.at(&(origin + ray * (step as f64 / steps as f64)));
                let cell = &mut self.cells[at];
                if cell.counted != number && cell.near != number {
                    cell.counted = number;
                    cell.through += 1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(index: u32, points: Vec<Point2<f64>>) -> Keyframe {
        Keyframe { index, time: 0.0, odometry: Isometry2::identity(), points }
    }

    #[test]
    fn what_others_look_through_does_not_stay() {
        // a wall 10 m ahead, and something that passes between: each keyframe sees it elsewhere
        let wall = || (-30..=30).map(|i| Point2::new(10.5, 0.3 * f64::from(i)));
        let mut keyframes = Vec::new();
        for index in 0..6_u32 {
            let passing = Point2::new(5.5, 4.0 * f64::from(index) / 3.0 - 3.0);
            let hidden = |p: &Point2<f64>| (p.y / p.x - passing.y / passing.x).abs() < 0.05;
            keyframes.push(scan(index, wall().filter(|p| !hidden(p)).chain([passing]).collect()));
        }
        let poses = vec![Isometry2::identity(); keyframes.len()];
        for (keyframe, stays) in keyframes.iter().zip(stays(&keyframes, &poses)) {
            let (passing, wall) = stays.split_last().unwrap();
            assert!(!passing && wall.iter().all(|s| *s), "{keyframe:?}");
        }
    }

    #[test]
    fn a_map_too_large_to_be_judged_is_kept_whole() {
        let keyframes = [scan(0, vec![Point2::new(1e6, 0.0), Point2::new(0.0, -1e6)]), scan(1, vec![])];
        assert_eq!(stays(&keyframes, &[Isometry2::identity(); 2]), [vec![true; 2], vec![]]);
        assert_eq!(stays(&[], &[]), Vec::<Vec<bool>>::new());
    }
}

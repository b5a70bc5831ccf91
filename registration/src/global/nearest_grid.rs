use nalgebra::Vector3;

use crate::icp::Target;

/// Cells along the longest side.
const CELLS: f64 = 32.0;

/// Free space around the points as a share of the longest side.
const MARGIN: f64 = 0.15;

/// For every cell of a space grid the target point nearest to its centre: a nearest neighbour in one look-up that is
/// wrong by no more than the way to the centre, there and back.
pub(super) struct NearestGrid {
    low: Vector3<f64>,
    cell: f64,
    counts: [usize; 3],
    points: Vec<Vector3<f64>>,
    cells: Vec<Cell>,
}

#[derive(Clone, Copy)]
struct Cell {
    /// The nearest of `points`.
    nearest: u32,
    /// Its distance from the centre of the cell, rounded down.
    distance: f32,
}

/// More than one rounding to `f32` takes.
const ROUNDED_DOWN: f64 = 1.0 - 1e-6;

impl NearestGrid {
    /// The grid of a target, in its coordinates about its origin.
    pub(super) fn new(target: &Target<3>) -> Self {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for i in 0..target.len() {
            (low, high) = (low.inf(target.tree.point_at(i)), high.sup(target.tree.point_at(i)));
        }
        let longest = (high - low).amax().max(f64::MIN_POSITIVE);
        let margin = Vector3::repeat(MARGIN * longest);
        (low, high) = (low - margin, high + margin);
        let cell = longest / CELLS;
        let counts: [usize; 3] = std::array::from_fn(|axis| ((high[axis] - low[axis]) / cell) as usize + 1);
        let mut centres = Vec::with_capacity(counts.iter().product());
        for z in 0..counts[2] {
            for y in 0..counts[1] {
                for x in 0..counts[0] {
                    centres.push(low + Vector3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5) * cell);
                }
            }
        }
        let to_cell = |(nearest, distance_sq): (u32, f64)| Cell {
            nearest,
            distance: (distance_sq.sqrt() * ROUNDED_DOWN) as f32,
        };
        let cells = target.tree.nearest_to_each(&centres).into_iter().map(to_cell).collect();
        let points = (0..target.len()).map(|i| *target.tree.point_at(i)).collect();
        Self { low, cell, counts, points, cells }
    }

    /// The cell of a place and how far its centre is, in units of its side, if the grid has one there.
    ///
    /// A place less than a cell below the grid goes to the lowest cell: bounds hold wherever a place is.
    #[inline]
    fn at(&self, place: &Vector3<f64>) -> Option<(&Cell, f64)> {
        let at = (place - self.low) / self.cell;
        let [nx, ny, nz] = self.counts;
        // a negative number becomes a huge one in the cast through i64
        let [x, y, z] = [at.x, at.y, at.z].map(|v| v as i64 as usize);
        if x >= nx || y >= ny || z >= nz {
            return None;
        }
        let cell = self.cells.get((z * ny + y) * nx + x)?;
        let off = Vector3::new(at.x - (x as f64 + 0.5), at.y - (y as f64 + 0.5), at.z - (z as f64 + 0.5));
        Some((cell, off.norm()))
    }

    /// A point about as near to `place` as the nearest, if the grid reaches there.
    #[inline]
    pub(super) fn near(&self, place: &Vector3<f64>) -> Option<&Vector3<f64>> {
        self.at(place).and_then(|(cell, _)| self.points.get(cell.nearest as usize))
    }

    /// A lower and an upper bound of the distance to the nearest point, if the grid reaches there.
    #[inline]
    pub(super) fn bounds(&self, place: &Vector3<f64>) -> Option<(f64, f64)> {
        let (cell, off) = self.at(place)?;
        let high = (self.points.get(cell.nearest as usize)? - place).norm();
        Some((f64::from(cell.distance) - off * self.cell, high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Cloud;
    use proptest::prelude::*;

    fn places(count: std::ops::Range<usize>, size: f64) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        let one = prop::array::uniform3(-size..size).prop_map(Vector3::from);
        prop::collection::vec(one, count)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn bounds_hold_by_brute_force(points in places(2..30, 1.0), queries in places(200..201, 1.4)) {
            let target = Target::new(&Cloud::new(points.clone()).unwrap()).unwrap();
            let grid = NearestGrid::new(&target);
            let mut answered = 0;
            for query in &queries {
                let place = query - target.origin;
                let nearest = points.iter().map(|p| (p - query).norm()).fold(f64::INFINITY, f64::min);
                let Some((low, high)) = grid.bounds(&place) else { continue };
                answered += 1;
                prop_assert!(low <= nearest + 1e-12 && nearest <= high + 1e-12, "{low} {nearest} {high}");
                prop_assert!((grid.near(&place).unwrap() - place).norm() == high);
                prop_assert!(high - low <= 3.0 * 3f64.sqrt() * grid.cell);
            }
            prop_assert!(answered > 0);
        }
    }
}

use nalgebra::Vector2;

/// Most cells of a grid (two bytes each).
const MOST_CELLS: f64 = 16e6;

/// For every cell of a plane grid the distance from its centre to the nearest point, capped a little beyond `reach`.
pub(super) struct NearGrid {
    origin: Vector2<f64>,
    inverse_cell: f64,
    columns: usize,
    rows: usize,
    cell: f64,
    /// In units of `unit`, rounded down.
    distances: Vec<u16>,
    unit: f64,
}

impl NearGrid {
    pub(super) fn new(
        points: impl Iterator<Item = Vector2<f64>> + Clone,
        reach: f64,
        cells_per_reach: f64,
    ) -> Self {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for p in points.clone() {
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        let extent = high - low + Vector2::repeat(2.0 * reach);
        let cell = (reach / cells_per_reach).max((extent.x * extent.y / MOST_CELLS).sqrt());
        let origin = low - Vector2::repeat(reach + cell);
        let columns = (extent.x / cell) as usize + 3;
        let rows = (extent.y / cell) as usize + 3;
        // capped so that a place anywhere in a cell without a point near is known to be `reach` from all
        let half_diagonal = cell * std::f64::consts::FRAC_1_SQRT_2;
        let unit = (reach + half_diagonal) / f64::from(u16::MAX - 1);
        let mut distances = vec![u16::MAX; columns * rows];
        let around = (reach + half_diagonal) / cell;
        for p in points {
            let at = (p - origin) / cell;
            let clamp = |v: f64, n: usize| (v.max(0.0) as usize).min(n - 1);
            let (r0, r1) = (clamp(at.y - around, rows), clamp(at.y + around, rows));
            let (c0, c1) = (clamp(at.x - around, columns), clamp(at.x + around, columns));
            for row in r0..=r1 {
                let dy = (row as f64 + 0.5 - at.y) * cell;
                for column in c0..=c1 {
                    let dx = (column as f64 + 0.5 - at.x) * cell;
                    let distance = (dx * dx + dy * dy).sqrt() / unit;
                    let slot = &mut distances[row * columns + column];
                    *slot = (*slot).min(distance.min(f64::from(u16::MAX)) as u16);
                }
            }
        }
        Self { origin, inverse_cell: 1.0 / cell, columns, rows, cell, distances, unit }
    }

    /// Half the side of a cell, metres: a bound falls short of the distance by about as much.
    pub(super) fn slack(&self) -> f64 {
        0.5 * self.cell
    }

    /// A lower bound of the distance at a place, and its guess from the centre of the cell, metres.
    #[inline]
    pub(super) fn bound(&self, place: &Vector2<f64>) -> (f64, f64) {
        let at = (place - self.origin) * self.inverse_cell;
        // a negative number becomes a huge one in the cast through i64; the bound holds wherever a place is, so it
        // does not matter that one just below the grid goes to its lowest cell
        let (column, row) = (at.x as i64 as usize, at.y as i64 as usize);
        if column >= self.columns || row >= self.rows {
            let far = f64::from(u16::MAX) * self.unit;
            return (far, far);
        }
        let distance = f64::from(self.distances[row * self.columns + column]) * self.unit;
        let off = Vector2::new(at.x - (column as f64 + 0.5), at.y - (row as f64 + 0.5));
        (distance - off.norm() * self.cell, distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn places(count: std::ops::Range<usize>, size: f64) -> impl Strategy<Value = Vec<Vector2<f64>>> {
        prop::collection::vec((-size..size, -size..size).prop_map(|(x, y)| Vector2::new(x, y)), count)
    }

    proptest! {
        #[test]
        fn bounds_hold_by_brute_force(points in places(1..30, 3.0), queries in places(200..201, 5.0), reach in 0.1..2.0f64) {
            let grid = NearGrid::new(points.iter().copied(), reach, 16.0);
            for query in &queries {
                let nearest = points.iter().map(|p| (p - query).norm()).fold(f64::INFINITY, f64::min);
                let (bound, guess) = grid.bound(query);
                prop_assert!(bound.min(reach) <= nearest + 1e-12, "{bound} {nearest}");
                // within half a diagonal and a unit of the truth, and the guess within that of the bound
                prop_assert!(guess.min(reach) >= nearest.min(reach) - reach / 16.0, "{guess} {nearest}");
                prop_assert!(bound.min(reach) >= nearest.min(reach) - 2.0 * reach / 16.0, "{bound} {nearest}");
            }
        }
    }
}

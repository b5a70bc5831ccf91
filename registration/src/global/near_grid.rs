use nalgebra::Vector2;

/// Most cells of a grid (one byte each).
const MOST_CELLS: f64 = 16e6;

/// For every cell of a plane grid a lower bound of the distance from any place in it to the nearest point,
/// capped at `reach`.
pub(crate) struct NearGrid {
    origin: Vector2<f64>,
    inverse_cell: f64,
    columns: usize,
    rows: usize,
    /// Lower bound in units of `reach / 255`, rounded down.
    bounds: Vec<u8>,
    pub(crate) unit: f64,
    /// By how much the bound may fall short of the distance.
    pub(crate) slack: f64,
}

impl NearGrid {
    pub(crate) fn new(
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
        let unit = reach / 255.0;
        let half_diagonal = cell * std::f64::consts::FRAC_1_SQRT_2;
        let mut bounds = vec![255u8; columns * rows];
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
                    let bound = ((dx * dx + dy * dy).sqrt() - half_diagonal).max(0.0) / unit;
                    let slot = &mut bounds[row * columns + column];
                    *slot = (*slot).min(bound.min(255.0) as u8);
                }
            }
        }
        Self {
            origin,
            inverse_cell: 1.0 / cell,
            columns,
            rows,
            bounds,
            unit,
            slack: 2.0 * half_diagonal + unit,
        }
    }

    /// Lower bound of the distance at a place, metres.
    #[inline]
    pub(crate) fn bound(&self, place: &Vector2<f64>) -> f64 {
        let at = (place - self.origin) * self.inverse_cell;
        // a negative number becomes a huge one in the cast through i64
        let (column, row) = (at.x.floor() as i64 as usize, at.y.floor() as i64 as usize);
        if column < self.columns && row < self.rows {
            f64::from(self.bounds[row * self.columns + column]) * self.unit
        } else {
            255.0 * self.unit
        }
    }
}

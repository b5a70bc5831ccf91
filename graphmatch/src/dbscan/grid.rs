use nalgebra::Point2;

use crate::Error;

/// Square cells whose diagonal stays below `eps`, so that all points of a cell are mutual neighbours and every
/// neighbour lies at most two cells away in each direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    inverse_side: f64,
}

/// Integer coordinates of a cell.
pub(super) type Cell = (i64, i64);

impl Grid {
    pub(super) fn new(eps: f64) -> Self {
        Self { inverse_side: std::f64::consts::SQRT_2 / eps * (1.0 + 1e-9) }
    }

    /// Cell of a finite point, or `None` where the cell number would not be exact.
    pub(super) fn cell(&self, p: &Point2<f64>) -> Option<Cell> {
        const LIMIT: f64 = (1_u64 << 50) as f64;
        let (x, y) = ((p.x * self.inverse_side).floor(), (p.y * self.inverse_side).floor());
        (x.abs() < LIMIT && y.abs() < LIMIT).then_some((x as i64, y as i64))
    }
}

/// Cell of point `index`, or what is wrong with the point.
pub(super) fn cell_of(grid: Grid, p: &Point2<f64>, index: usize, eps: f64) -> Result<Cell, Error> {
    if !(p.x.is_finite() && p.y.is_finite()) {
        return Err(Error::NonFinitePoint { what: "points", index });
    }
    grid.cell(p).ok_or(Error::BadParameter {
        name: "eps",
        value: eps,
        need: "at least 2^-50 of the largest coordinate",
    })
}

/// Squared distance, in the operation order of the k-d tree peers compare with.
#[inline]
pub(super) fn distance_sq(a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let (dx, dy) = (a.x - b.x, a.y - b.y);
    dx * dx + dy * dy
}

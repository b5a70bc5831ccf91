use nalgebra::Point2;

use crate::error::{Error, check};

/// Most cells a field may have: 64 MiB of `f32`.
const CELL_LIMIT: u64 = 1 << 24;

/// How finely a [`DistanceField`] is sampled and how far it looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldParams {
    /// Edge of a cell in metres. Default 0.25 m: half of the 0.5 m to which sonar scans are thinned.
    pub cell: f64,
    /// Distance in metres beyond which a cell counts as having no point near. Default 1.8 m: three times the
    /// default width of the matcher's kernel, where the kernel has fallen to 1 %.
    pub reach: f64,
}

impl Default for FieldParams {
    fn default() -> Self {
        Self { cell: 0.25, reach: 1.8 }
    }
}

/// Square cells over the bounding box of a set of points widened by a reach.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grid {
    pub(super) cell: f64,
    pub(super) origin: Point2<f64>,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    /// # Errors
    /// See [`DistanceField::new`].
    pub(super) fn around(points: &[Point2<f64>], params: &FieldParams) -> Result<Self, Error> {
        for (name, value) in [("cell", params.cell), ("reach", params.reach)] {
            check(name, value, value > 0.0 && value.is_finite(), "positive and finite")?;
        }
        let (low, high) = bounds(points)?;
        let margin = params.reach + params.cell;
        let origin = Point2::new(low.x - margin, low.y - margin);
        let columns = ((high.x - low.x + 2.0 * margin) / params.cell).ceil() + 1.0;
        let rows = ((high.y - low.y + 2.0 * margin) / params.cell).ceil() + 1.0;
        if columns * rows > CELL_LIMIT as f64 {
            return Err(too_large("the target", points, params.cell, columns * rows, CELL_LIMIT));
        }
        Ok(Self { cell: params.cell, origin, columns: columns as usize, rows: rows as usize })
    }

    /// The part of the grid whose cells a box between two corners touches, at least one cell of it.
    pub(super) fn clipped(self, low: &Point2<f64>, high: &Point2<f64>) -> Self {
        let part = |low: f64, high: f64, count: usize| {
            let first = low.floor().clamp(0.0, count as f64 - 1.0) as usize;
            let last = high.floor().clamp(first as f64, count as f64 - 1.0) as usize;
            (first, last + 1 - first)
        };
        let ((left, bottom), (right, top)) = (self.place_of(low), self.place_of(high));
        let ((column, columns), (row, rows)) =
            (part(left, right, self.columns), part(bottom, top, self.rows));
        let corner = nalgebra::Vector2::new(column as f64, row as f64) * self.cell;
        Self { origin: self.origin + corner, columns, rows, ..self }
    }

    /// Place of a point in cells from the origin.
    #[inline(always)]
    pub(super) fn place_of(&self, point: &Point2<f64>) -> (f64, f64) {
        ((point.x - self.origin.x) / self.cell, (point.y - self.origin.y) / self.cell)
    }

    /// Column and row of the cell that holds a point; it may lie outside.
    #[inline(always)]
    pub(super) fn cell_of(&self, point: &Point2<f64>) -> (i64, i64) {
        let (x, y) = self.place_of(point);
        (x.floor() as i64, y.floor() as i64)
    }

    /// Column and row of the cell that holds a point; `None` outside.
    pub(super) fn inside(&self, point: &Point2<f64>) -> Option<(usize, usize)> {
        let (column, row) = self.cell_of(point);
        let within = |index: i64, count: usize| usize::try_from(index).ok().filter(|index| *index < count);
        Some((within(column, self.columns)?, within(row, self.rows)?))
    }

    /// Those of `count` cells of an axis whose centres are at most `reach` metres from a place on it.
    #[inline(always)]
    pub(super) fn near(&self, place: f64, reach: f64, count: usize) -> std::ops::Range<usize> {
        let reach = reach / self.cell;
        let first = (place - reach - 0.5).ceil().max(0.0) as usize;
        let end = ((place + reach + 0.5).floor().max(0.0) as usize).min(count);
        first.min(end)..end
    }
}

/// Distance from the centre of every cell of a grid to the nearest point of a set, exact up to a reach.
///
/// Cost to build: `n (2 reach / cell)²` for `n` points.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceField {
    params: FieldParams,
    grid: Grid,
    distance_sq: Vec<f32>,
}

impl DistanceField {
    /// The field of `points` (metres) over their bounding box widened by the reach.
    ///
    /// # Errors
    /// No point, a coordinate that is not finite, a cell or reach that is not positive, or points so far apart that
    /// the grid would exceed 2²⁴ cells.
    pub fn new(points: &[Point2<f64>], params: &FieldParams) -> Result<Self, Error> {
        let grid = Grid::around(points, params)?;
        let far = (params.reach * params.reach) as f32;
        let mut field = Self { params: *params, distance_sq: vec![far; grid.columns * grid.rows], grid };
        for point in points {
            field.stamp(point);
        }
        Ok(field)
    }

    /// Lowers the distances around one point.
    fn stamp(&mut self, point: &Point2<f64>) {
        let Grid { cell, columns, rows, .. } = self.grid;
        let (x, y) = self.grid.place_of(point);
        let cell_sq = cell * cell;
        for row in self.grid.near(y, self.params.reach, rows) {
            let dy = row as f64 + 0.5 - y;
            let line = &mut self.distance_sq[row * columns..(row + 1) * columns];
            for column in self.grid.near(x, self.params.reach, columns) {
                let dx = column as f64 + 0.5 - x;
                let distance_sq = ((dx * dx + dy * dy) * cell_sq) as f32;
                if distance_sq < line[column] {
                    line[column] = distance_sq;
                }
            }
        }
    }

    /// The parameters the field was built with.
    pub fn params(&self) -> &FieldParams {
        &self.params
    }

    /// Lower left corner of the grid, metres.
    pub fn origin(&self) -> Point2<f64> {
        self.grid.origin
    }

    /// Cells along x.
    pub fn columns(&self) -> usize {
        self.grid.columns
    }

    /// Cells along y.
    pub fn rows(&self) -> usize {
        self.grid.rows
    }

    /// Squared distances in m², row after row, each at most the reach squared.
    pub fn distance_sq(&self) -> &[f32] {
        &self.distance_sq
    }

    /// Distance in metres from the centre of the cell that holds `point` to the nearest point of the set; `None`
    /// where there is none within the reach.
    pub fn distance(&self, point: &Point2<f64>) -> Option<f64> {
        let (column, row) = self.grid.inside(point)?;
        let distance_sq = f64::from(self.distance_sq[row * self.grid.columns + column]);
        let reach_sq = self.params.reach * self.params.reach;
        (distance_sq < reach_sq * (1.0 - 1e-6)).then(|| distance_sq.sqrt())
    }
}

/// Corners of the box around `points`.
pub(super) fn bounds(points: &[Point2<f64>]) -> Result<(Point2<f64>, Point2<f64>), Error> {
    if points.is_empty() {
        return Err(Error::TooFewPoints { what: "the set", found: 0, needed: 1 });
    }
    let mut low = Point2::new(f64::INFINITY, f64::INFINITY);
    let mut high = Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY);
    for (index, point) in points.iter().enumerate() {
        if !(point.x.is_finite() && point.y.is_finite()) {
            return Err(Error::NonFinitePoint { index });
        }
        low = low.inf(point);
        high = high.sup(point);
    }
    Ok((low, high))
}

/// The error for points that would need more cells than the limit.
pub(super) fn too_large(
    what: &'static str,
    points: &[Point2<f64>],
    cell: f64,
    cells: f64,
    limit: u64,
) -> Error {
    let axis = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        match (values.first(), values.last()) {
            (Some(low), Some(high)) => (values[values.len() / 2], high - low),
            _ => (0.0, 0.0),
        }
    };
    let ((x, width), (y, height)) = (axis(0), axis(1));
    let off = |p: &Point2<f64>| (p.x - x).hypot(p.y - y);
    let farthest =
        (0..points.len()).max_by(|&a, &b| off(&points[a]).total_cmp(&off(&points[b])).then(b.cmp(&a)));
    let farthest = farthest.unwrap_or(0);
    Error::GridTooLarge { what, width, height, cell, cells: cells as u64, limit, farthest }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn distances_agree_with_brute_force(
            points in prop::collection::vec((-20.0..20.0f64, -15.0..15.0f64), 1..60),
            at in (-25.0..25.0f64, -20.0..20.0f64),
        ) {
            let points: Vec<_> = points.iter().map(|&(x, y)| Point2::new(x, y)).collect();
            let field = DistanceField::new(&points, &FieldParams::default()).unwrap();
            let cell = field.params().cell;
            let centre = |v: f64, o: f64| o + (((v - o) / cell).floor() + 0.5) * cell;
            let middle = Point2::new(centre(at.0, field.origin().x), centre(at.1, field.origin().y));
            let nearest = points.iter().map(|p| (p - middle).norm()).fold(f64::INFINITY, f64::min);
            match field.distance(&Point2::new(at.0, at.1)) {
                Some(distance) => prop_assert!((distance - nearest).abs() < 1e-5),
                None => prop_assert!(nearest >= field.params().reach * (1.0 - 1e-5)),
            }
        }
    }

    #[test]
    fn bad_points_are_refused() {
        let params = FieldParams::default();
        let far = [Point2::origin(), Point2::new(1e7, 1e7)];
        let error = DistanceField::new(&[far[0], far[0], far[1]], &params).unwrap_err();
        assert!(matches!(error, Error::GridTooLarge { farthest: 2, width: 1e7, cell: 0.25, .. }), "{error}");
        let nan = [Point2::origin(), Point2::new(f64::NAN, 0.0)];
        assert_eq!(DistanceField::new(&nan, &params), Err(Error::NonFinitePoint { index: 1 }));
        assert!(DistanceField::new(&[], &params).is_err());
        assert!(DistanceField::new(&far[..1], &FieldParams { cell: 0.0, ..params }).is_err());
    }
}

use std::ops::Range;

use nalgebra::{Isometry2, Point2};
use pulp::{Arch, Simd, WithSimd};

use super::distance_field::{FieldParams, Grid};
use crate::error::Error;

/// Most numbers that a processor works on at once; what it does is a divisor. Rows have this many columns more than cells,
/// so that a run of them may end late.
const LANES: usize = 16;

/// The kernel `exp(-d² / 2 s²)` of the distance `d` from the centre of every cell to the nearest point of a set, 0 beyond
/// the reach.
///
/// The kernel of two axes is a product, so a point costs two rows of exponentials and a product a cell; no distance is
/// computed. Cost to build: `n (2 reach / cell)²` for `n` points.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct KernelGrid {
    grid: Grid,
    /// Columns are split by their remainder modulo the lattice step, so that the poses of one lattice row read
    /// neighbouring numbers: `values[(remainder · rows + row) · width + column / step]`.
    values: Vec<f32>,
    width: usize,
    step: usize,
}

impl KernelGrid {
    /// * `sigma` – width of the kernel, metres.
    /// * `step` – columns and rows from one pose of a lattice to the next.
    /// * `region` – two corners of the box in which values are wanted; `None` for all.
    ///
    /// # Errors
    /// Those of [`DistanceField::new`](super::DistanceField::new).
    pub(super) fn new(
        points: &[Point2<f64>],
        params: &FieldParams,
        sigma: f64,
        step: usize,
        region: Option<&(Point2<f64>, Point2<f64>)>,
    ) -> Result<Self, Error> {
        let grid = Grid::around(points, params)?;
        let grid = match region {
            Some((low, high)) => grid.clipped(low, high),
            None => grid,
        };
        let width = grid.columns.div_ceil(step) + LANES;
        let values = vec![0.0; step * grid.rows * width];
        let mut kernels = KernelGrid { grid, values, width, step };
        let curvature = -0.5 / (sigma * sigma);
        Arch::new().dispatch(Stamps { kernels: &mut kernels, points, reach: params.reach, curvature });
        Ok(kernels)
    }

    /// Kernel value of the cell that holds `point`, 0 outside.
    pub(super) fn value(&self, point: &Point2<f64>) -> f32 {
        let Some((column, row)) = self.grid.inside(point) else { return 0.0 };
        self.values[self.start(column % self.step, row) + column / self.step]
    }

    /// Mean kernel of `source` placed by `pose`, moved by every shift of a lattice: `(i - half, j - half) · step` cells for
    /// `i, j <= 2 half`, row after row.
    pub(super) fn mean_at_shifts(
        &self,
        source: &[Point2<f64>],
        pose: &Isometry2<f64>,
        half: usize,
    ) -> Vec<f32> {
        Arch::new().dispatch(Shifts { kernels: self, source, pose, half })
    }

    fn start(&self, remainder: usize, row: usize) -> usize {
        (remainder * self.grid.rows + row) * self.width
    }
}

/// Points to be stamped on a grid, as one piece of work that is compiled for the processor's vectors.
struct Stamps<'a> {
    kernels: &'a mut KernelGrid,
    points: &'a [Point2<f64>],
    reach: f64,
    curvature: f64,
}

impl WithSimd for Stamps<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Stamps { kernels, points, reach, curvature } = self;
        let (cell, step) = (kernels.grid.cell, kernels.step);
        // what lies beyond the reach in a corner of a point's square counts as nothing
        let (least, zero) = (simd.splat_f32s((curvature * reach * reach).exp() as f32), simd.splat_f32s(0.0));
        // one line of factors a remainder, each as long as the widest square needs
        let longest = (((2.0 * reach / cell) as usize + 2).div_ceil(step) + 1).next_multiple_of(LANES);
        let mut along = vec![0.0f32; step * longest];
        let bell = Bell { curvature: curvature * cell * cell, ratio: (2.0 * curvature * cell * cell).exp() };
        let (mut factors_x, mut factors_y) = (Vec::new(), Vec::new());
        for point in points {
            let (x, y) = kernels.grid.place_of(point);
            let columns = kernels.grid.near(x, reach, kernels.grid.columns);
            if columns.is_empty() {
                continue;
            }
            along.fill(0.0);
            bell.factors(x, &columns, &mut factors_x);
            for (column, &factor) in columns.clone().zip(&factors_x) {
                let place = column / step - columns.start / step;
                along[(column % step) * longest + place] = factor;
            }
            let length = ((columns.end - 1) / step - columns.start / step + 1).next_multiple_of(LANES);
            let rows = kernels.grid.near(y, reach, kernels.grid.rows);
            bell.factors(y, &rows, &mut factors_y);
            for (row, &factor) in rows.zip(&factors_y) {
                let across = simd.splat_f32s(factor);
                for (remainder, line) in along.chunks_exact(longest).enumerate() {
                    let at = kernels.start(remainder, row) + columns.start / step;
                    let (values, _) = S::as_mut_simd_f32s(&mut kernels.values[at..at + length]);
                    for (value, factor) in values.iter_mut().zip(S::as_simd_f32s(line).0) {
                        let kernel = simd.mul_f32s(*factor, across);
                        let kernel = simd.select_f32s(simd.less_than_f32s(least, kernel), kernel, zero);
                        *value = simd.max_f32s(*value, kernel);
                    }
                }
            }
        }
    }
}

/// The kernel along one axis: `exp(curvature · d²)` of a distance `d` in cells.
struct Bell {
    curvature: f64,
    /// `exp(2 · curvature)`, what the ratio of two neighbours' values changes by from one cell to the next.
    ratio: f64,
}

impl Bell {
    /// The values at the centres of a run of cells, by two exponentials and a product a cell each way from the cell nearest
    /// to the middle, where nothing can underflow that is not zero anyway.
    ///
    /// * `at` – middle of the bell, in cells.
    fn factors(&self, at: f64, cells: &Range<usize>, factors: &mut Vec<f32>) {
        factors.clear();
        factors.resize(cells.len(), 0.0);
        let Some(last) = cells.len().checked_sub(1) else { return };
        let middle = ((at.floor() - cells.start as f64).max(0.0) as usize).min(last);
        let off = (cells.start + middle) as f64 + 0.5 - at;
        let (below, above) = factors.split_at_mut(middle);
        let peak = (self.curvature * off * off).exp();
        self.run(off, peak, above.iter_mut());
        // seen from the other side, and without the cell in the middle, which has its value
        let next = (self.curvature * (off - 1.0) * (off - 1.0)).exp();
        self.run(1.0 - off, next, below.iter_mut().rev());
    }

    /// Values at `off`, `off + 1`, ... cells from the middle, of which the first is `value`.
    fn run<'a>(&self, off: f64, mut value: f64, factors: impl Iterator<Item = &'a mut f32>) {
        let mut change = (self.curvature * (2.0 * off + 1.0)).exp();
        for factor in factors {
            *factor = value as f32;
            value *= change;
            change *= self.ratio;
        }
    }
}

/// A source to be scored at all shifts, as one piece of work that is compiled for the processor's vectors.
struct Shifts<'a> {
    kernels: &'a KernelGrid,
    source: &'a [Point2<f64>],
    pose: &'a Isometry2<f64>,
    half: usize,
}

impl WithSimd for Shifts<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
        let Shifts { kernels, source, pose, half } = self;
        let side = 2 * half + 1;
        let length = side.next_multiple_of(LANES);
        let (step, half) = (kernels.step as i64, half as i64);
        let mut sums = vec![0.0f32; side * length];
        for point in source {
            let (column, row) = kernels.grid.cell_of(&(pose * point));
            let remainder = column.rem_euclid(step) as usize;
            let first = column.div_euclid(step) - half;
            // the part of a lattice row that falls on the grid, in whole lanes where there is room for them
            let skip = (-first).clamp(0, side as i64) as usize;
            let room = (kernels.width as i64 - first).clamp(0, length as i64) as usize;
            if skip >= room.min(side) {
                continue;
            }
            // lattice rows that fall on the grid
            let rows = kernels.grid.rows as i64;
            let above = (row - half * step).min(0).unsigned_abs().div_ceil(step as u64) as usize;
            let row = row + (above as i64 - half) * step;
            if above >= side || row >= rows {
                continue;
            }
            let at = kernels.start(remainder, row as usize) + (first + skip as i64) as usize;
            let end = kernels.start(remainder + 1, 0);
            let lines = kernels.values[at..end].chunks(kernels.step * kernels.width);
            let sums = sums.chunks_exact_mut(length).skip(above);
            if room - skip == length {
                for (sums, values) in sums.zip(lines) {
                    let (sums, values) = (S::as_mut_simd_f32s(sums).0, S::as_simd_f32s(&values[..length]).0);
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum = simd.add_f32s(*sum, *value);
                    }
                }
            } else {
                for (sums, values) in sums.zip(lines) {
                    sums[skip..room].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                }
            }
        }
        let scale = 1.0 / source.len() as f32;
        let rows = sums.chunks_exact(length).flat_map(|row| &row[..side]);
        rows.map(|sum| sum * scale).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::DistanceField;
    use super::*;

    fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Point2<f64>>> {
        prop::collection::vec((-12.0..12.0f64, -9.0..9.0f64).prop_map(|(x, y)| Point2::new(x, y)), count)
    }

    proptest! {
        #[test]
        fn kernels_are_those_of_the_distances(
            target in points(1..40), at in points(20..21), step in 1..5usize, sigma in 0.3..1.0f64, cell in 0.1..0.4f64,
        ) {
            let params = FieldParams { cell, reach: 1.8 };
            let (kernels, field) =
                (KernelGrid::new(&target, &params, sigma, step, None).unwrap(), DistanceField::new(&target, &params).unwrap());
            for point in &at {
                let expected = field.distance(point).map_or(0.0, |d| (-0.5 * d * d / (sigma * sigma)).exp());
                let difference = (f64::from(kernels.value(point)) - expected).abs();
                // the last cell within the reach may fall on either side of it
                let edge = (-0.5 * 1.8 * 1.8 / (sigma * sigma)).exp();
                prop_assert!(difference < 1e-5 || (difference - edge).abs() < 1e-5, "{difference}");
            }
        }

        #[test]
        fn every_shift_is_the_mean_of_its_values(
            target in points(1..40), source in points(1..20), step in 1..5usize, half in 0..13usize,
            x in -30.0..30.0f64, angle in -3.0..3.0f64,
        ) {
            let params = FieldParams { cell: 0.25, reach: 1.8 };
            let kernels = KernelGrid::new(&target, &params, 0.6, step, None).unwrap();
            let pose = Isometry2::new([x, 0.1].into(), angle);
            let means = kernels.mean_at_shifts(&source, &pose, half);
            let side = 2 * half + 1;
            prop_assert_eq!(means.len(), side * side);
            for (index, mean) in means.iter().enumerate() {
                let along = |k: usize| (k as f64 - half as f64) * step as f64 * 0.25;
                let shift = nalgebra::Vector2::new(along(index % side), along(index / side));
                let sum: f32 = source.iter().map(|p| kernels.value(&(pose * p + shift))).sum();
                prop_assert!((mean - sum / source.len() as f32).abs() < 1e-5);
            }
        }
    }
}

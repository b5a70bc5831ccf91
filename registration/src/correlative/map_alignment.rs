use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::{Isometry2, Matrix3, Point2, Rotation2, Vector2};
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use super::distance_field::{DistanceField, FieldParams, bounds, too_large};
use super::matcher::{CorrelativeParams, Start, Target};
use crate::error::{Error, check};

/// Most cells the correlation may have: 64 MiB a buffer.
const CELL_LIMIT: u64 = 1 << 22;

/// How two maps are searched for each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapAlignmentParams {
    /// Cell of the coarse correlation in metres. Default 1.5 m, the width of its kernel.
    pub cell: f64,
    /// Width `s` in metres of the kernel `exp(-d² / 2 s²)` that scores a source point at distance `d` from the
    /// target. Default 1.5 m: cells of 2 m seen from two distorted maps lie about that far apart.
    pub kernel_sigma: f64,
    /// Step in heading of the coarse search, radians. Default 3°, which moves a point 60 m out by twice the kernel.
    pub yaw_step: f64,
    /// Largest heading to try, radians, on both sides of 0. Default π, the full turn; smaller with a compass.
    pub yaw_limit: f64,
    /// Peaks kept of each heading. Default 3.
    pub peaks_per_yaw: usize,
    /// Modes returned. Default 5.
    pub modes: usize,
    /// Two modes are separate when they put the centroid of the source this far apart, metres. Default 6 m.
    pub separate_distance: f64,
    /// ... or differ this much in heading, radians. Default 10°.
    pub separate_angle: f64,
    /// The matcher that refines each mode; its window is that of the coarse steps. Its kernel is
    /// [`MapAlignmentParams::kernel_sigma`].
    pub refine: CorrelativeParams,
}

impl Default for MapAlignmentParams {
    fn default() -> Self {
        Self {
            cell: 1.5,
            kernel_sigma: 1.5,
            yaw_step: 3f64.to_radians(),
            yaw_limit: PI,
            peaks_per_yaw: 3,
            modes: 5,
            separate_distance: 6.0,
            separate_angle: 10f64.to_radians(),
            refine: CorrelativeParams::default(),
        }
    }
}

/// One way in which two maps fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapMode {
    /// Pose of the source's frame in the target's frame.
    pub target_from_source: Isometry2<f64>,
    /// Its covariance, order `[x, y, θ]`, in the source's own frame (right perturbation).
    pub covariance: Matrix3<f64>,
    /// Mean of the kernel over the source's points, 0 to 1.
    pub score: f64,
}

/// The best separate ways to lay one map over another, over all headings and without a start; best first.
///
/// For every heading the source's points are correlated with the target's kernel field by FFT, the best peaks of all
/// headings are refined by [`Target::locate`], and modes that fall together are merged. The score of the second over
/// the score of the first tells how ambiguous the answer is. An empty result means that nothing overlaps at all.
///
/// * `target`, `source` – points of the two maps, metres, each in its own frame; a few hundred suffice.
///
/// Cost: `2 yaws` FFTs over half the cells of the joint extent each.
///
/// # Errors
/// No point, a coordinate that is not finite, a parameter out of its range, maps too large for the correlation grid.
pub fn align_maps(
    target: &[Point2<f64>],
    source: &[Point2<f64>],
    params: &MapAlignmentParams,
) -> Result<Vec<MapMode>, Error> {
    for (name, value) in [("yaw_step", params.yaw_step), ("kernel_sigma", params.kernel_sigma)] {
        check(name, value, value > 1e-4 && value.is_finite(), "above 0.0001 and finite")?;
    }
    let (low, high) = bounds(source)?;
    let middle = Point2::from((low.coords + high.coords) * 0.5);
    let correlation = Correlation::new(target, source, &middle, params)?;
    let mut peaks = correlation.peaks(source, &middle, params);
    // Stable, so equal scores keep the order of headings.
    peaks.sort_by(|a, b| b.score.total_cmp(&a.score));
    let coarse = separate(peaks, &middle, 2 * params.modes, params);
    let refine = CorrelativeParams {
        kernel_sigma: params.kernel_sigma,
        field: FieldParams { reach: 3.0 * params.kernel_sigma, ..params.refine.field },
        ..params.refine
    };
    let prepared = Target::new(target, &refine)?;
    let mut modes = Vec::new();
    for mode in coarse {
        let start = Start { target_from_source: mode.target_from_source, covariance: None };
        let window = (2.0 * params.cell, params.yaw_step);
        let found = prepared.locate_within(source, &start, window.0, window.1)?;
        modes.push(MapMode {
            target_from_source: found.target_from_source,
            covariance: found.covariance,
            score: found.score,
        });
    }
    modes.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(separate(modes, &middle, params.modes, params))
}

/// Keeps the first `count` modes that differ from all kept before them.
fn separate(
    modes: Vec<MapMode>,
    middle: &Point2<f64>,
    count: usize,
    params: &MapAlignmentParams,
) -> Vec<MapMode> {
    let mut kept: Vec<MapMode> = Vec::new();
    for mode in modes {
        let same = |other: &MapMode| {
            let (a, b) = (mode.target_from_source, other.target_from_source);
            let turn = a.rotation.angle_to(&b.rotation).abs();
            (a * middle - b * middle).norm() <= params.separate_distance && turn <= params.separate_angle
        };
        if kept.len() < count && !kept.iter().any(same) {
            kept.push(mode);
        }
    }
    kept
}

/// The kernel field of the target, in frequency space.
struct Correlation {
    origin: Point2<f64>,
    cell: f64,
    /// Cells by which the grid is wider than the field, at the least.
    margin: usize,
    grid: Grid,
    spectrum: Vec<Complex<f32>>,
}

impl Correlation {
    fn new(
        target: &[Point2<f64>],
        source: &[Point2<f64>],
        middle: &Point2<f64>,
        params: &MapAlignmentParams,
    ) -> Result<Self, Error> {
        let field_params = FieldParams { cell: params.cell, reach: 3.0 * params.kernel_sigma };
        let field = DistanceField::new(target, &field_params)?;
        // Wide enough that a source placed half outside on one side does not wrap around to the other.
        let radius = source.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
        let margin = (2.0 * radius / params.cell).ceil() + 2.0;
        let cells = (field.columns() as f64 + margin) * (field.rows() as f64 + margin);
        if cells > CELL_LIMIT as f64 {
            let (what, points) = if margin > field.columns().max(field.rows()) as f64 {
                ("the source", source)
            } else {
                ("the target", target)
            };
            return Err(too_large(what, points, params.cell, cells, CELL_LIMIT));
        }
        let margin = margin as usize;
        let mut grid = Grid::new(smooth(field.columns() + margin), smooth(field.rows() + margin));
        let mut spectrum = vec![Complex::default(); grid.columns * grid.rows];
        let scale = (-0.5 / params.kernel_sigma.powi(2)) as f32;
        let reach_sq = (field_params.reach * field_params.reach) as f32;
        for (row, line) in field.distance_sq().chunks_exact(field.columns()).enumerate() {
            for (column, &distance_sq) in line.iter().enumerate() {
                if distance_sq < reach_sq {
                    spectrum[row * grid.columns + column].re = (distance_sq * scale).exp();
                }
            }
        }
        grid.forward(&mut spectrum);
        let norm = 1.0 / (grid.columns * grid.rows) as f32;
        spectrum.iter_mut().for_each(|value| *value *= norm);
        Ok(Self { origin: field.origin(), cell: params.cell, margin, grid, spectrum })
    }

    /// The best shifts of every heading, two headings at a time: one as the real, one as the imaginary part.
    fn peaks(
        mut self,
        source: &[Point2<f64>],
        middle: &Point2<f64>,
        params: &MapAlignmentParams,
    ) -> Vec<MapMode> {
        let yaws = headings(params);
        let mut found = Vec::new();
        let mut buffer = vec![Complex::default(); self.spectrum.len()];
        for pair in yaws.chunks(2) {
            buffer.fill(Complex::default());
            for (part, &yaw) in pair.iter().enumerate() {
                self.splat(source, middle, yaw, part, &mut buffer);
            }
            self.grid.forward(&mut buffer);
            buffer.iter_mut().zip(&self.spectrum).for_each(|(value, field)| *value *= field);
            self.grid.inverse(&mut buffer);
            for (part, &yaw) in pair.iter().enumerate() {
                let mut sums: Vec<f32> =
                    buffer.iter().map(|value| if part == 0 { value.re } else { value.im }).collect();
                self.take_peaks(&mut sums, source.len(), middle, yaw, params, &mut found);
            }
        }
        found
    }

    /// Adds the source, turned about its middle and mirrored so that the product of spectra correlates.
    fn splat(
        &self,
        source: &[Point2<f64>],
        middle: &Point2<f64>,
        yaw: f64,
        part: usize,
        buffer: &mut [Complex<f32>],
    ) {
        let turn = Rotation2::new(yaw);
        for point in source {
            let at = turn * (point - middle);
            let column = (-(at.x / self.cell).round() as i64).rem_euclid(self.grid.columns as i64) as usize;
            let row = (-(at.y / self.cell).round() as i64).rem_euclid(self.grid.rows as i64) as usize;
            let value = &mut buffer[row * self.grid.columns + column];
            if part == 0 {
                value.re += 1.0;
            } else {
                value.im += 1.0;
            }
        }
    }

    fn take_peaks(
        &self,
        sums: &mut [f32],
        points: usize,
        middle: &Point2<f64>,
        yaw: f64,
        params: &MapAlignmentParams,
        found: &mut Vec<MapMode>,
    ) {
        let (columns, rows) = (self.grid.columns, self.grid.rows);
        let clear = (params.separate_distance / self.cell).ceil() as i64;
        for _ in 0..params.peaks_per_yaw {
            let mut best = 0;
            for (index, sum) in sums.iter().enumerate() {
                if *sum > sums[best] {
                    best = index;
                }
            }
            if sums[best] <= 0.0 {
                return;
            }
            let score = f64::from(sums[best]) / points as f64;
            // Shifts past the field and half of its margin are shifts to the other side, wrapped around.
            let signed = |index: usize, count: usize| {
                let wrapped = if index > count - self.margin / 2 { count } else { 0 };
                index as f64 - wrapped as f64
            };
            let (column, row) = (signed(best % columns, columns), signed(best / columns, rows));
            let placed = self.origin + Vector2::new(column + 0.5, row + 0.5) * self.cell;
            let translation = placed.coords - Rotation2::new(yaw) * middle.coords;
            found.push(MapMode {
                target_from_source: Isometry2::new(translation, yaw),
                covariance: Matrix3::identity(),
                score,
            });
            for dy in -clear..=clear {
                let y = ((best / columns) as i64 + dy).rem_euclid(rows as i64) as usize;
                for dx in -clear..=clear {
                    let x = ((best % columns) as i64 + dx).rem_euclid(columns as i64) as usize;
                    sums[y * columns + x] = 0.0;
                }
            }
        }
    }
}

/// Headings from `-limit` to `limit`, a full turn without its end.
fn headings(params: &MapAlignmentParams) -> Vec<f64> {
    let limit = params.yaw_limit.clamp(0.0, PI);
    if limit >= PI - 1e-9 {
        let count = (TAU / params.yaw_step).ceil() as i32;
        return (0..count).map(|k| f64::from(k) * TAU / f64::from(count)).collect();
    }
    let half = (limit / params.yaw_step).ceil() as i32;
    (-half..=half).map(|k| if half == 0 { 0.0 } else { f64::from(k) * limit / f64::from(half) }).collect()
}

/// Two-dimensional FFT that leaves the spectrum transposed, which its inverse expects.
struct Grid {
    columns: usize,
    rows: usize,
    along_x: [Arc<dyn Fft<f32>>; 2],
    along_y: [Arc<dyn Fft<f32>>; 2],
    turned: Vec<Complex<f32>>,
}

impl Grid {
    fn new(columns: usize, rows: usize) -> Self {
        let mut planner = FftPlanner::new();
        let along_x = [planner.plan_fft_forward(columns), planner.plan_fft_inverse(columns)];
        let along_y = [planner.plan_fft_forward(rows), planner.plan_fft_inverse(rows)];
        Self { columns, rows, along_x, along_y, turned: vec![Complex::default(); columns * rows] }
    }

    fn forward(&mut self, buffer: &mut [Complex<f32>]) {
        self.along_x[0].process(buffer);
        transpose(buffer, &mut self.turned, self.columns);
        self.along_y[0].process(&mut self.turned);
        buffer.copy_from_slice(&self.turned);
    }

    fn inverse(&mut self, buffer: &mut [Complex<f32>]) {
        self.along_y[1].process(buffer);
        transpose(buffer, &mut self.turned, self.rows);
        self.along_x[1].process(&mut self.turned);
        buffer.copy_from_slice(&self.turned);
    }
}

/// Transposes a matrix with rows of length `columns`.
fn transpose(from: &[Complex<f32>], to: &mut [Complex<f32>], columns: usize) {
    let rows = from.len() / columns;
    const BLOCK: usize = 16;
    for row_block in (0..rows).step_by(BLOCK) {
        for column_block in (0..columns).step_by(BLOCK) {
            for row in row_block..(row_block + BLOCK).min(rows) {
                for column in column_block..(column_block + BLOCK).min(columns) {
                    to[column * rows + row] = from[row * columns + column];
                }
            }
        }
    }
}

/// The smallest number from `n` on whose only prime factors are 2, 3 and 5.
fn smooth(n: usize) -> usize {
    let is_smooth = |mut k: usize| {
        for p in [2, 3, 5] {
            while k.is_multiple_of(p) {
                k /= p;
            }
        }
        k == 1
    };
    (n.max(1)..).find(|&k| is_smooth(k)).unwrap_or(n)
}

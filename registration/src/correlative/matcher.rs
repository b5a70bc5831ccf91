use draco_lie::LieGroup;
use nalgebra::{Isometry2, Matrix3, Point2, Rotation2, Vector2, Vector3};

use super::distance_field::{FieldParams, bounds};
use super::kernel_grid::KernelGrid;
use crate::error::{Error, check};

/// Rounds in which the winning mode is centred on its own mean.
const MODE_ROUNDS: usize = 3;

/// Poses whose log posterior is this far below the best are left out of the moments: ten million of them together weigh
/// less than the rounding of the best.
const NEGLIGIBLE: f64 = 55.0;

/// What to search and how much to believe a score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrelativeParams {
    /// Sampling of the target. See [`FieldParams`].
    pub field: FieldParams,
    /// Width `s` in metres of the kernel `exp(-d² / 2 s²)` that scores a point at distance `d` from the target.
    /// Default 0.6 m: points thinned to 0.5 m lie up to 0.35 m from their neighbours, and the maps they are matched
    /// with are good to about half a metre.
    pub kernel_sigma: f64,
    /// Step of the lattice in metres, a multiple of the field's cell. Default 0.5 m, below the kernel's width.
    pub step: f64,
    /// Half width of the search in x and in y, metres. Default 3 m.
    pub radius: f64,
    /// Half width of the search in heading, radians. Default 0.05 rad.
    pub angle: f64,
    /// Number of independent points a scan is worth in the likelihood `(floor + score)^n`. Default 40: neighbours
    /// along a line tell the same thing, so it is far below the number of points.
    pub effective_points: f64,
    /// Score of a point that has nothing near it. Default 0.05, the share of points that are clutter or new.
    pub floor: f64,
    /// A mode counts as another one when it is this far from the best, metres. Default 3 m.
    pub far_distance: f64,
    /// ... or this far in heading, radians. Default 0.1 rad.
    pub far_angle: f64,
    /// Standard deviation in metres added to each axis for what the lattice and the target's own distortion hide.
    /// Default 0.15 m.
    pub extra_sigma: f64,
    /// The same in heading, radians. Default 0.004 rad.
    pub extra_sigma_angle: f64,
}

impl Default for CorrelativeParams {
    fn default() -> Self {
        Self {
            field: FieldParams::default(),
            kernel_sigma: 0.6,
            step: 0.5,
            radius: 3.0,
            angle: 0.05,
            effective_points: 40.0,
            floor: 0.05,
            far_distance: 3.0,
            far_angle: 0.1,
            extra_sigma: 0.15,
            extra_sigma_angle: 0.004,
        }
    }
}

impl CorrelativeParams {
    /// Checks every field's range.
    fn check(&self) -> Result<(), Error> {
        let positive = [
            ("kernel_sigma", self.kernel_sigma),
            ("step", self.step),
            ("effective_points", self.effective_points),
            ("floor", self.floor),
        ];
        for (name, value) in positive {
            check(name, value, value > 0.0 && value.is_finite(), "positive and finite")?;
        }
        let not_negative = [
            ("radius", self.radius),
            ("angle", self.angle),
            ("far_distance", self.far_distance),
            ("far_angle", self.far_angle),
            ("extra_sigma", self.extra_sigma),
            ("extra_sigma_angle", self.extra_sigma_angle),
        ];
        for (name, value) in not_negative {
            check(name, value, value >= 0.0 && value.is_finite(), "finite and at least 0")?;
        }
        let poses = (2.0 * self.radius / self.step + 1.0).powi(2);
        check("radius", self.radius, poses <= 1e7, "at most about 1500 steps")?;
        check("angle", self.angle, self.angle <= std::f64::consts::PI, "at most a half turn")
    }

    /// Cells of the field in one step of the lattice.
    fn step_cells(&self) -> usize {
        ((self.step / self.field.cell).round() as usize).max(1)
    }
}

/// Where the search starts and how well that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Expected pose of the source in the target's frame.
    pub target_from_source: Isometry2<f64>,
    /// Covariance of that pose, order `[x, y, θ]`, in the source's own frame (right perturbation); `None` for a
    /// search in which every pose of the window is equally likely.
    pub covariance: Option<Matrix3<f64>>,
}

/// Where a source lies in a target, as a posterior over the poses of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrelativeMatch {
    /// Posterior mean of the winning mode: the pose of the source in the target's frame.
    pub target_from_source: Isometry2<f64>,
    /// Posterior covariance of the winning mode, order `[x, y, θ]`, in the source's own frame (right perturbation).
    pub covariance: Matrix3<f64>,
    /// Mean of the kernel over the source's points at the best pose, 0 to 1.
    pub score: f64,
    /// Best score far from the winner over the winner's score; 0 when the window holds nothing far.
    pub far_ratio: f64,
    /// Mean score over the whole window: what a pose picked blindly gets.
    pub background: f64,
    /// Whether the best pose lies on the border of the window, so that a better one may lie outside.
    pub at_border: bool,
}

/// A set of points prepared for matching scans with it.
///
/// Cost to build: `n (2 reach / cell)²` for `n` points.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    params: CorrelativeParams,
    kernels: KernelGrid,
}

/// One heading of the lattice with the scores of all shifts.
struct Layer {
    angle: f64,
    scores: Vec<f32>,
}

impl Target {
    /// Prepares `points` (metres, in the target's frame).
    ///
    /// # Errors
    /// Those of [`DistanceField::new`](super::DistanceField::new), and a parameter out of its range.
    pub fn new(points: &[Point2<f64>], params: &CorrelativeParams) -> Result<Self, Error> {
        Self::within(points, params, None)
    }

    /// As [`Target::new`], for nothing but locating `source` around `start`: the same answer, with only the part of the
    /// target prepared that a pose of the window can bring the source to.
    ///
    /// # Errors
    /// Those of [`Target::new`], no source point, or a coordinate that is not finite.
    pub fn for_source(
        points: &[Point2<f64>],
        params: &CorrelativeParams,
        source: &[Point2<f64>],
        start: &Isometry2<f64>,
    ) -> Result<Self, Error> {
        let centroid = centroid(source)?;
        let placed: Vec<Point2<f64>> = source.iter().map(|point| start * point).collect();
        let (low, high) = bounds(&placed)?;
        // a turn about the centroid moves no point farther than the chord of the one farthest out
        let extent = source.iter().map(|point| (point - centroid).norm()).fold(0.0, f64::max);
        let turn = 2.0 * extent * (0.5 * params.angle).sin();
        let margin = Vector2::repeat(turn + params.radius + params.step + params.field.cell);
        Self::within(points, params, Some(&(low - margin, high + margin)))
    }

    fn within(
        points: &[Point2<f64>],
        params: &CorrelativeParams,
        region: Option<&(Point2<f64>, Point2<f64>)>,
    ) -> Result<Self, Error> {
        params.check()?;
        let (sigma, step) = (params.kernel_sigma, params.step_cells());
        let kernels = KernelGrid::new(points, &params.field, sigma, step, region)?;
        Ok(Self { params: *params, kernels })
    }

    /// Mean of the kernel over `points`, given in the target's frame: 1 when each lies on a point of the target.
    pub fn score(&self, points: &[Point2<f64>]) -> f64 {
        let sum: f64 = points.iter().map(|point| f64::from(self.kernels.value(point))).sum();
        sum / points.len().max(1) as f64
    }

    /// Finds `source` (metres, in its own frame) around a start.
    ///
    /// Poses are tried on a lattice of shifts and turns about the *centroid* of the source, so that a turn does not
    /// swing a scan whose points all lie far ahead. The log posterior of a pose is
    /// ```text
    /// n_eff · ln(floor + score) − ½ ξᵀ Σ⁻¹ ξ,    ξ = log(start⁻¹ · pose)
    /// ```
    /// Mean and covariance are its moments over the poses near the best one.
    ///
    /// Cost: `n · poses` look-ups for `n` points.
    ///
    /// **Source** of the idea: E. Olson, Real-time correlative scan matching, ICRA 2009, where the moments are taken
    /// over the whole window; here only over the winning mode, and what lies elsewhere is reported as `far_ratio`.
    ///
    /// # Errors
    /// No source point, a coordinate that is not finite, a covariance that is not positive definite.
    pub fn locate(&self, source: &[Point2<f64>], start: &Start) -> Result<CorrelativeMatch, Error> {
        self.locate_within(source, start, self.params.radius, self.params.angle)
    }

    /// As [`Target::locate`] with another half width of the window, metres and radians.
    ///
    /// # Errors
    /// Those of [`Target::locate`], and a window out of its range.
    pub fn locate_within(
        &self,
        source: &[Point2<f64>],
        start: &Start,
        radius: f64,
        angle: f64,
    ) -> Result<CorrelativeMatch, Error> {
        let params = CorrelativeParams { radius, angle, ..self.params };
        params.check()?;
        let centroid = centroid(source)?;
        let lattice = Lattice::new(source, &centroid, start, &params)?;
        let layer = |angle| {
            let turned = lattice.pose(angle, &Vector2::zeros());
            Layer { angle, scores: self.kernels.mean_at_shifts(source, &turned, lattice.half) }
        };
        let layers: Vec<Layer> = lattice.angles().map(layer).collect();
        Ok(lattice.posterior(&layers, &params))
    }
}

/// The poses tried: shifts `(i, j) · step` and turns about the source's centroid.
struct Lattice {
    start: Isometry2<f64>,
    information: Option<Matrix3<f64>>,
    /// Centroid in the source's frame.
    centroid: Point2<f64>,
    step: f64,
    half: usize,
    angle_step: f64,
    half_angles: i32,
}

impl Lattice {
    fn new(
        source: &[Point2<f64>],
        centroid: &Point2<f64>,
        start: &Start,
        params: &CorrelativeParams,
    ) -> Result<Self, Error> {
        let information = match start.covariance {
            Some(covariance) => Some(
                covariance
                    .cholesky()
                    .ok_or(Error::NotPositiveDefinite { what: "the start's covariance" })?
                    .inverse(),
            ),
            None => None,
        };
        let step = params.step_cells() as f64 * params.field.cell;
        // A turn by one step moves the typical point by half a shift step.
        let spread = source.iter().map(|p| (p - centroid).norm_squared()).sum::<f64>() / source.len() as f64;
        let wanted = 0.5 * step / spread.sqrt().max(step);
        let half_angles = (params.angle / wanted).ceil().max(if params.angle > 0.0 { 1.0 } else { 0.0 });
        let angle_step = if half_angles > 0.0 { params.angle / half_angles } else { 0.0 };
        Ok(Self {
            start: start.target_from_source,
            information,
            centroid: *centroid,
            step,
            half: (params.radius / step).round() as usize,
            angle_step,
            half_angles: half_angles as i32,
        })
    }

    fn angles(&self) -> impl Iterator<Item = f64> + '_ {
        (-self.half_angles..=self.half_angles).map(|k| f64::from(k) * self.angle_step)
    }

    /// The start turned by `angle` about the placed centroid, then moved by `shift` along the target's axes.
    fn pose(&self, angle: f64, shift: &Vector2<f64>) -> Isometry2<f64> {
        let placed = self.start * self.centroid;
        let turn = Rotation2::new(angle);
        let moved = placed + turn * (self.start.translation.vector - placed.coords) + shift;
        Isometry2::new(moved.coords, self.start.rotation.angle() + angle)
    }

    /// What the start says of the shifts at one heading: `log(start⁻¹ · pose)` as a function of the shift, or nothing.
    ///
    /// At a heading the logarithm is linear in the translation, so three of them tell all others.
    fn prior(&self, angle: f64) -> Option<Prior> {
        let information = self.information?;
        let at = |shift: Vector2<f64>| self.start.between(&self.pose(angle, &shift)).log();
        let unmoved = at(Vector2::zeros());
        let along = |axis: Vector2<f64>| at(axis) - unmoved;
        Some(Prior { information, unmoved, along_x: along(Vector2::x()), along_y: along(Vector2::y()) })
    }

    /// The poses with their scores and log posteriors up to a constant, heading after heading and row after row.
    fn samples(&self, layers: &[Layer], params: &CorrelativeParams) -> Vec<Sample> {
        let along = |k: usize| (k as f64 - self.half as f64) * self.step;
        let side = 2 * self.half + 1;
        let mut samples = Vec::with_capacity(layers.len() * side * side);
        for &Layer { angle, ref scores } in layers {
            let prior = self.prior(angle);
            for (row, scores) in scores.chunks_exact(side).enumerate() {
                for (column, &score) in scores.iter().enumerate() {
                    let (shift, score) = (Vector2::new(along(column), along(row)), f64::from(score));
                    let likelihood = params.effective_points * (params.floor + score).ln();
                    let log_posterior = likelihood + prior.as_ref().map_or(0.0, |p| p.log_density(&shift));
                    samples.push(Sample { shift, angle, score, log_posterior });
                }
            }
        }
        samples
    }

    /// Moments over the winning mode, and what lies outside it.
    fn posterior(&self, layers: &[Layer], params: &CorrelativeParams) -> CorrelativeMatch {
        let samples = self.samples(layers, params);
        // Ties go to the first, so the result does not depend on anything but the input.
        let mut best = samples[0];
        for sample in &samples {
            if sample.log_posterior > best.log_posterior {
                best = *sample;
            }
        }
        let near = |s: &Sample, shift: &Vector2<f64>, angle: f64| {
            (s.shift - shift).norm() <= params.far_distance && (s.angle - angle).abs() <= params.far_angle
        };
        let far = samples.iter().filter(|s| !near(s, &best.shift, best.angle));
        let far = far.map(|s| s.score).fold(0.0, f64::max);
        let background = samples.iter().map(|s| s.score).sum::<f64>() / samples.len() as f64;
        let weighed: Vec<(Sample, f64)> = samples
            .iter()
            .filter(|sample| sample.log_posterior > best.log_posterior - NEGLIGIBLE)
            .map(|sample| (*sample, (sample.log_posterior - best.log_posterior).exp()))
            .collect();
        let around = |shift: Vector2<f64>, angle: f64| {
            moments(weighed.iter().filter(|(sample, _)| near(sample, &shift, angle)))
        };
        // The mode is the neighbourhood of its own mean, not of its peak: along a wall the peak may be anywhere.
        let (mut mean, mut covariance) = around(best.shift, best.angle);
        for _ in 0..MODE_ROUNDS {
            (mean, covariance) = around(mean.xy(), mean.z);
        }
        let border = self.half as f64 * self.step - 1e-9;
        CorrelativeMatch {
            target_from_source: self.pose(mean.z, &mean.xy()),
            covariance: self.body_covariance(&mean, &covariance, params),
            score: best.score,
            far_ratio: if best.score > 0.0 { far / best.score } else { 0.0 },
            background,
            at_border: self.half > 0 && best.shift.amax() >= border,
        }
    }

    /// Covariance of shift and turn at the centroid, along the target's axes, as covariance of the pose in its own
    /// frame.
    fn body_covariance(
        &self,
        mean: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        params: &CorrelativeParams,
    ) -> Matrix3<f64> {
        let (extra, extra_angle) = (params.extra_sigma.powi(2), params.extra_sigma_angle.powi(2));
        let floor = Matrix3::from_diagonal(&Vector3::new(extra, extra, extra_angle));
        let heading = self.start.rotation.angle() + mean.z;
        let body_from_target = Isometry2::rotation(-heading).adjoint();
        let body_from_centroid = Isometry2::new(self.centroid.coords, 0.0).adjoint();
        let j = body_from_centroid * body_from_target;
        j * (covariance + floor) * j.transpose()
    }
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    shift: Vector2<f64>,
    angle: f64,
    score: f64,
    log_posterior: f64,
}

/// A start's covariance seen from the shifts at one heading.
struct Prior {
    information: Matrix3<f64>,
    /// `ξ = log(start⁻¹ · pose)` without a shift, and what a metre along either axis adds to it.
    unmoved: Vector3<f64>,
    along_x: Vector3<f64>,
    along_y: Vector3<f64>,
}

impl Prior {
    /// `-½ ξᵀ Σ⁻¹ ξ`.
    fn log_density(&self, shift: &Vector2<f64>) -> f64 {
        let xi = self.unmoved + self.along_x * shift.x + self.along_y * shift.y;
        -0.5 * xi.dot(&(self.information * xi))
    }
}

/// Mean and covariance of `[x, y, θ]` of weighed poses.
fn moments<'a>(samples: impl Iterator<Item = &'a (Sample, f64)>) -> (Vector3<f64>, Matrix3<f64>) {
    let (mut weight, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for &(sample, w) in samples {
        let u = Vector3::new(sample.shift.x, sample.shift.y, sample.angle);
        weight += w;
        first += w * u;
        second += w * u * u.transpose();
    }
    let mean = first / weight;
    (mean, second / weight - mean * mean.transpose())
}

/// Centroid of a set of points.
fn centroid(points: &[Point2<f64>]) -> Result<Point2<f64>, Error> {
    if points.is_empty() {
        return Err(Error::TooFewPoints { what: "the source", found: 0, needed: 1 });
    }
    let mut sum = Vector2::zeros();
    for (index, point) in points.iter().enumerate() {
        if !(point.x.is_finite() && point.y.is_finite()) {
            return Err(Error::NonFinitePoint { index });
        }
        sum += point.coords;
    }
    Ok(Point2::from(sum / points.len() as f64))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_prior_is_that_of_the_pose(
            start in prop::array::uniform3(-3.0..3.0f64), at in prop::array::uniform2(-20.0..20.0f64),
            shift in prop::array::uniform2(-5.0..5.0f64), angle in -3.1..3.1f64,
        ) {
            let [x, y, heading] = start;
            let information = Matrix3::new(4.0, 1.0, 0.3, 1.0, 2.0, -0.2, 0.3, -0.2, 9.0);
            let lattice = Lattice {
                start: Isometry2::new([x, y].into(), heading),
                information: Some(information),
                centroid: Point2::from(at),
                step: 0.5,
                half: 6,
                angle_step: 0.1,
                half_angles: 1,
            };
            let xi: Vector3<f64> = lattice.start.between(&lattice.pose(angle, &shift.into())).log();
            let expected = -0.5 * xi.dot(&(information * xi));
            let found = lattice.prior(angle).expect("has a covariance").log_density(&shift.into());
            prop_assert!((found - expected).abs() <= 1e-9 * (1.0 + expected.abs()), "{found} {expected}");
        }
    }
}

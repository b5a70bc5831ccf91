use super::{Kernel, Rejector};
use crate::Error;
use crate::error::check;

/// How pairs are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Matcher {
    /// The nearest target point of each source point.
    #[default]
    Nearest,
    /// The nearest, kept only if the source point is also the nearest to it. Costs about twice as much.
    Reciprocal,
}

/// What is minimised for a pair of source point `x` (moved) and target point `q`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Residual {
    /// `|q - x|²`. Needs no normals.
    PointToPoint,
    /// `(nᵀ (q - x))²` with the target's normal: point to line in 2-D, point to plane in 3-D.
    #[default]
    PointToPlane,
    /// `(mᵀ (q - x))²` with `m` the unit mean of both normals (after Rusinkiewicz, "A symmetric objective
    /// function for ICP", 2019).
    Symmetric,
    /// Generalised ICP: `(q - x)ᵀ (C_q + R C_x Rᵀ)⁻¹ (q - x)`, both covariances flat with `0.001 : 1` (Segal,
    /// Haehnel, Thrun, "Generalized-ICP", 2009).
    PlaneToPlane,
    /// `(q - x)ᵀ (C_q + R C_x Rᵀ)⁻¹ (q - x)` with the covariances of the points, which one cloud at least must have:
    /// [`crate::RangeBearingNoise`] for sonar, [`crate::Cloud::estimate_covariances`] for dense scans. The residual, and
    /// so a kernel's scale, is in standard deviations and not in metres.
    Mahalanobis,
}

/// How one step is computed from the pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Optimizer {
    /// One Gauss-Newton step on the manifold; directions without information stay untouched.
    #[default]
    GaussNewton,
    /// Levenberg-Marquardt: a step is damped until the cost over its pairs falls.
    LevenbergMarquardt,
    /// The exact rigid fit of the pairs (Kabsch). Only for [`Residual::PointToPoint`].
    ClosedForm,
}

/// Whether iterations learn from those before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Acceleration {
    /// Each step by itself.
    #[default]
    None,
    /// Anderson's mixing of the last three steps, taken back where the cost rises: point-to-point residuals then need
    /// a third to two thirds fewer iterations. Steps are judged by [`StopRule`] as they would be without.
    Anderson,
}

/// When to stop: the mean size of the last `window` steps is below both limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopRule {
    /// Most iterations. Default 30.
    pub max_iterations: usize,
    /// Translation of a step, metres. Default 1e-4.
    pub translation: f64,
    /// Rotation of a step, radians. Default 1e-4.
    pub rotation: f64,
    /// Steps averaged, at least 1. Default 1.
    pub window: usize,
}

impl Default for StopRule {
    fn default() -> Self {
        Self { max_iterations: 30, translation: 1e-4, rotation: 1e-4, window: 1 }
    }
}

/// Which covariance comes with the answer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Covariance {
    /// `K⁻¹ A K⁻¹`: `A` the variance of the score as the residuals show it, one draw a target point, `K` the
    /// curvature found by moving the scan and letting points change partners. The noise is estimated, needs not
    /// be equal everywhere, and uncertain pairs are part of it. Costs `8 N` more
    /// associations, of a part of the points where there are many.
    #[default]
    Sandwich,
    /// `σ² H⁻¹` with `σ²` from the residuals: the pairs taken as right, the noise as equal.
    Residual,
    /// `scale · mean(d²) · I` over the pairs within `radius`, metres and radians alike. It measures the spacing
    /// of the points and not the uncertainty; kept for comparison with systems that use it.
    Spacing {
        /// Factor; the reference system uses 20.
        scale: f64,
        /// Pairs farther apart do not count, metres; the reference uses 0.5.
        radius: f64,
    },
}

/// An ICP composed of named parts. Start from a preset and change what differs.
#[derive(Debug, Clone, PartialEq)]
pub struct IcpParams {
    /// How pairs are found.
    pub matcher: Matcher,
    /// Pairs farther apart are never formed, metres.
    pub max_distance: f64,
    /// Which pairs take part.
    pub rejectors: Vec<Rejector>,
    /// What is minimised.
    pub residual: Residual,
    /// Robust kernel on the residual.
    pub kernel: Kernel,
    /// How a step is computed.
    pub optimizer: Optimizer,
    /// Whether iterations learn from those before.
    pub acceleration: Acceleration,
    /// When to stop.
    pub stop: StopRule,
    /// Which covariance comes with the answer.
    pub covariance: Covariance,
    /// Distance at which a source point counts as overlapping, metres.
    pub overlap_radius: f64,
}

impl IcpParams {
    /// For 2-D sonar scans: point to point, 80 % of the pairs kept, 3 m reach.
    ///
    /// Points of one sonar scan are streaks whose normals mean little, hence no normals.
    pub fn sonar_2d() -> Self {
        Self {
            matcher: Matcher::Nearest,
            max_distance: 3.0,
            rejectors: vec![Rejector::Trimmed { keep: 0.8 }],
            residual: Residual::PointToPoint,
            kernel: Kernel::None,
            optimizer: Optimizer::GaussNewton,
            acceleration: Acceleration::Anderson,
            stop: StopRule { max_iterations: 50, translation: 1e-3, rotation: 1e-4, window: 1 },
            covariance: Covariance::Sandwich,
            overlap_radius: 0.5,
        }
    }

    /// For 2-D laser scans: point to line with a Cauchy kernel. Needs normals on the target; estimated normals on
    /// the source, too, make the covariance better.
    pub fn laser_2d() -> Self {
        Self {
            max_distance: 1.0,
            rejectors: vec![Rejector::Trimmed { keep: 0.9 }],
            residual: Residual::PointToPlane,
            kernel: Kernel::Cauchy { scale: 0.1 },
            overlap_radius: 0.15,
            acceleration: Acceleration::None,
            stop: StopRule::default(),
            ..Self::sonar_2d()
        }
    }

    /// For 3-D lidar clouds of 0.1 to 0.5 m spacing: generalised ICP. Needs normals on both clouds.
    pub fn lidar_3d() -> Self {
        Self {
            max_distance: 1.0,
            rejectors: Vec::new(),
            residual: Residual::PlaneToPlane,
            kernel: Kernel::None,
            acceleration: Acceleration::None,
            stop: StopRule { max_iterations: 30, translation: 1e-3, rotation: 2e-3, window: 1 },
            ..Self::sonar_2d()
        }
    }

    /// The chain of the sonar systems built on libpointmatcher: nearest neighbour within 10 m, pairs within 3 m
    /// and the 80 % quantile, rigid fit by SVD, at most 40 iterations or a mean step over 4 iterations below
    /// 0.1 m and 0.01 rad; covariance from the spacing.
    ///
    /// One difference: the rotation limit is a clean angle here, while that library's 2-D test reads a matrix
    /// block that includes the translation.
    pub fn libpointmatcher_like() -> Self {
        Self {
            matcher: Matcher::Nearest,
            max_distance: 10.0,
            rejectors: vec![Rejector::Distance { max: 3.0 }, Rejector::Trimmed { keep: 0.8 }],
            residual: Residual::PointToPoint,
            kernel: Kernel::None,
            optimizer: Optimizer::ClosedForm,
            acceleration: Acceleration::None,
            stop: StopRule { max_iterations: 40, translation: 0.1, rotation: 0.01, window: 4 },
            covariance: Covariance::Spacing { scale: 20.0, radius: 0.5 },
            overlap_radius: 0.5,
        }
    }

    /// Stages for [`crate::Target::align_in_stages`] whose reach (and kernel, if any) shrinks by halves from
    /// `first_reach` metres to that of these parameters, which are the last stage.
    ///
    /// Early stages let far points pull, and stop early; a reach below the last gives the last stage alone.
    pub fn coarse_to_fine(&self, first_reach: f64) -> Vec<Self> {
        let mut stages = vec![self.clone()];
        let mut factor = 2.0;
        while factor * self.max_distance <= first_reach * (1.0 + 1e-9) && stages.len() < 32 {
            let mut stage = self.clone();
            stage.max_distance *= factor;
            stage.kernel = self.kernel.widened(factor);
            stage.stop.translation *= factor;
            stage.stop.rotation *= factor;
            stages.push(stage);
            factor *= 2.0;
        }
        stages.reverse();
        stages
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let positive = |name, v: f64| check(name, v, v > 0.0 && v.is_finite(), "more than 0");
        let share = |name, v: f64| check(name, v, v > 0.0 && v <= 1.0, "(0, 1]");
        positive("max_distance", self.max_distance)?;
        positive("overlap_radius", self.overlap_radius)?;
        if let Some(scale) = self.kernel.scale() {
            positive("kernel.scale", scale)?;
        }
        for rejector in &self.rejectors {
            match *rejector {
                Rejector::Distance { max } => positive("rejectors.max", max)?,
                Rejector::Trimmed { keep } => share("rejectors.keep", keep)?,
                Rejector::VariableTrimmed { min_keep, max_keep, lambda } => {
                    share("rejectors.min_keep", min_keep)?;
                    share("rejectors.max_keep", max_keep)?;
                    check("rejectors.max_keep", max_keep, max_keep >= min_keep, "min_keep or more")?;
                    check("rejectors.lambda", lambda, lambda >= 0.0 && lambda.is_finite(), "0 or more")?;
                }
                Rejector::NormalAngle { max_angle } => positive("rejectors.max_angle", max_angle)?,
            }
        }
        check("stop.window", self.stop.window as f64, self.stop.window > 0, "1 or more")?;
        if let Covariance::Spacing { scale, radius } = self.covariance {
            positive("covariance.scale", scale)?;
            positive("covariance.radius", radius)?;
        }
        let fits = self.optimizer != Optimizer::ClosedForm || self.residual == Residual::PointToPoint;
        check("optimizer (closed form)", 1.0, fits, "point-to-point residuals")
    }
}

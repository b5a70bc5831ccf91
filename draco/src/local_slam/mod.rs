//! One robot's own map, keyframe by keyframe: odometry, matching of each scan with the last ones, loop closures with
//! PCM, and the calibration of the odometry and of the matches' headings.
//!
//! [`LocalSlam`] is a state machine: [`LocalSlam::add`] takes a keyframe, everything else reads. It has no clock, no
//! thread and no randomness.

mod loops;
mod noise;
mod params;
mod scale;
mod step;
mod submap;

use draco_lie::LieGroup;
use draco_pgo::{Gauge, Kernel, Key, Marginals, PoseGraph2, SolveParams, solve};
use draco_registration::correlative::{CorrelativeParams, Start, Target};
use nalgebra::{Isometry2, Matrix3, Point2, Vector3};
use serde::{Deserialize, Serialize};

pub use params::{LocalSlamParams, LoopParams};
pub use submap::merge;

use crate::Error;
use crate::keyframe::Keyframe;
use crate::matching::centroid;
use loops::OwnClosure;
use scale::{CALIBRATION, ScaledStep, corrected};
use step::ScanFactor;

/// Information of the prior that holds the first keyframe, and of what the calibration may not do.
const HELD: f64 = 1e10;

/// Information given to directions in which nothing was seen, since the solver wants every direction to have some.
const UNKNOWN: f64 = 1e-6;

/// Share of the largest entry that is added to that, so that rounding does not make such a direction negative.
const ROUNDING: f64 = 1e-10;

/// A step is looked for at least this many standard deviations of odometry to each side in heading.
const HEADING_SIGMAS: f64 = 3.0;

/// What a factor of the robot's own graph comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FactorKind {
    /// Odometry alone.
    Odometry,
    /// Odometry and a match with the last keyframes.
    Match,
    /// A loop closure that PCM accepted.
    Loop,
}

/// A relative pose in the robot's own map.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalFactor {
    /// Keyframe the measurement is expressed in.
    pub from: u32,
    /// Keyframe that is measured.
    pub to: u32,
    /// `from_from_to`.
    pub measured: Isometry2<f64>,
    /// Covariance in the frame of `to`, order x, y, heading.
    pub covariance: Matrix3<f64>,
    /// Where it comes from.
    pub kind: FactorKind,
}

/// What one keyframe brought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Whether the scan was matched with the ones before.
    pub matched: bool,
    /// Score of the match, 0 when there was none.
    pub score: f64,
    /// Loop closures found at this step, before PCM.
    pub loops_found: usize,
    /// Loop closures in the map now.
    pub loops_accepted: usize,
}

/// One step from a keyframe to the next.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Step {
    odometry: Isometry2<f64>,
    scan: Option<ScanFactor>,
}

/// SLAM of one robot by itself. The first keyframe is the origin of its map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LocalSlam {
    #[serde(skip)]
    params: LocalSlamParams,
    keyframes: Vec<Keyframe>,
    poses: Vec<Isometry2<f64>>,
    /// `steps[k]` leads from keyframe `k` to `k + 1`.
    steps: Vec<Step>,
    closures: Vec<OwnClosure>,
    scale: f64,
    /// Constant error of the odometry's heading, as calibrated so far, radians a keyframe.
    bias: f64,
    /// Standard deviation of a step of odometry, as calibrated so far, metres.
    sigma: f64,
    /// The same in heading, radians.
    sigma_angle: f64,
    /// Standard deviation of what the matches' headings are off by beyond what they tell, as calibrated so far, radians.
    turn: f64,
    /// Scale of the Cauchy kernel on what scans say about steps, as calibrated so far.
    kernel: f64,
}

impl LocalSlam {
    /// An empty map.
    pub fn new(params: LocalSlamParams) -> Self {
        Self {
            sigma: params.odometry_sigma,
            sigma_angle: params.odometry_sigma_angle,
            kernel: params.step_cauchy,
            params,
            keyframes: Vec::new(),
            poses: Vec::new(),
            steps: Vec::new(),
            closures: Vec::new(),
            scale: 1.0,
            bias: 0.0,
            turn: 0.0,
        }
    }

    /// Settings are no part of a saved state.
    pub(crate) fn set_params(&mut self, params: LocalSlamParams) {
        self.params = params;
    }

    /// Takes in the next keyframe; its index has to be the number of keyframes so far.
    ///
    /// # Errors
    /// A keyframe out of order or with a number that is not finite, and what matching and optimisation refuse.
    pub fn add(&mut self, keyframe: Keyframe) -> Result<StepReport, Error> {
        self.check(&keyframe)?;
        let mut report = StepReport { matched: false, score: 0.0, loops_found: 0, loops_accepted: 0 };
        let Some(last) = self.keyframes.last() else {
            self.poses.push(Isometry2::identity());
            self.keyframes.push(keyframe);
            return Ok(report);
        };
        let odometry = last.odometry.between(&keyframe.odometry);
        let previous = self.poses[self.poses.len() - 1];
        self.steps.push(Step { odometry, scan: None });
        self.poses.push(previous * corrected(&odometry, self.scale, self.bias));
        self.keyframes.push(keyframe);
        let newest = self.keyframes.len() - 1;
        (report.matched, report.score) = self.match_step(newest)?;
        if report.matched {
            self.optimise()?;
        }
        report.loops_found = self.find_loops(newest)?;
        if report.loops_found > 0 {
            self.judge_loops()?;
            self.optimise()?;
        }
        report.loops_accepted = self.closures.iter().filter(|closure| closure.accepted).count();
        Ok(report)
    }

    fn check(&self, keyframe: &Keyframe) -> Result<(), Error> {
        let wanted = self.keyframes.len();
        if keyframe.index as usize != wanted {
            let reason = "keyframes of one robot have to come in order from 0";
            return Err(Error::Parameter {
                name: "keyframe index",
                value: f64::from(keyframe.index),
                reason,
            });
        }
        let pose = keyframe.odometry;
        let numbers = [pose.translation.x, pose.translation.y, pose.rotation.angle()];
        if let Some(value) = numbers.into_iter().find(|v| !v.is_finite()) {
            return Err(Error::Parameter { name: "odometry", value, reason: "has to be finite" });
        }
        Ok(())
    }

    /// A step by odometry as calibrated so far.
    fn predicted(&self, step: &Step) -> Isometry2<f64> {
        corrected(&step.odometry, self.scale, self.bias)
    }

    /// What the scan says about a step, no surer than matches have proved to be.
    fn seen(&self, step: &Step) -> Option<ScanFactor> {
        step.scan.map(|scan| scan.turned(self.turn))
    }

    /// Covariance of a step by odometry, in the frame of the later keyframe.
    fn odometry_covariance(&self) -> Matrix3<f64> {
        noise::covariance(self.sigma, self.sigma_angle)
    }

    /// Matches keyframe `k` with the window before it. Returns whether it worked, and the score.
    fn match_step(&mut self, k: usize) -> Result<(bool, f64), Error> {
        let source = &self.keyframes[k].points;
        if source.len() < self.params.min_points {
            return Ok((false, 0.0));
        }
        let target = self.submap(k.saturating_sub(self.params.window), k - 1, k - 1);
        if target.len() < self.params.min_points {
            return Ok((false, 0.0));
        }
        let start = self.predicted(&self.steps[k - 1]);
        let prior = noise::covariance(self.params.odometry_sigma, self.sigma_angle);
        let start = Start { target_from_source: start, covariance: Some(prior) };
        let locate = |params: &CorrelativeParams| {
            let angle = params.angle.max(HEADING_SIGMAS * self.sigma_angle);
            let params = CorrelativeParams { angle, ..*params };
            Target::for_source(&target, &params, source, &start.target_from_source)?.locate(source, &start)
        };
        let found = locate(&self.params.step)?;
        if found.score < self.params.step_min_score {
            return Ok((false, found.score));
        }
        let (bare, hidden) = without_hidden(&self.params.step_refinement);
        let finer = locate(&bare)?;
        let scan = ScanFactor::without_prior(&finer, &start.target_from_source, &prior, centroid(source));
        self.steps[k - 1].scan = scan.map(|scan| scan.blurred(&hidden));
        Ok((self.steps[k - 1].scan.is_some(), found.score))
    }

    /// Keyframes `first..=last` merged at their present poses, in the frame of keyframe `frame`.
    pub(crate) fn submap(&self, first: usize, last: usize, frame: usize) -> Vec<Point2<f64>> {
        let last = last.min(self.keyframes.len().saturating_sub(1));
        let scans = (first..=last).map(|k| (self.poses[k], self.keyframes[k].points.as_slice()));
        merge(scans, &self.poses[frame], self.params.voxel)
    }

    /// The pose graph at the present poses.
    fn graph(&self) -> Result<PoseGraph2, Error> {
        let mut graph = PoseGraph2::new();
        let held = Matrix3::identity() * HELD;
        for (k, pose) in self.poses.iter().enumerate() {
            graph.add_pose(key(k), *pose)?;
        }
        graph.add_prior(key(0), Isometry2::identity(), held, Kernel::None)?;
        graph.add_pose(CALIBRATION, Isometry2::new([self.scale, 0.0].into(), self.bias))?;
        let unknown = Vector3::new(self.params.scale_sigma.powi(-2), HELD, self.params.bias_sigma.powi(-2));
        graph.add_prior(
            CALIBRATION,
            Isometry2::translation(1.0, 0.0),
            Matrix3::from_diagonal(&unknown),
            Kernel::None,
        )?;
        let sigma = self.odometry_covariance().diagonal().map(f64::sqrt);
        for (k, step) in self.steps.iter().enumerate() {
            let factor = ScaledStep::new(key(k), key(k + 1), step.odometry, sigma);
            graph.add_custom(std::sync::Arc::new(factor), Kernel::None)?;
            if let Some(scan) = self.seen(step) {
                let least = UNKNOWN + ROUNDING * scan.information.amax();
                let information = scan.information + Matrix3::identity() * least;
                let kernel = Kernel::Cauchy(self.kernel);
                graph.add_between(key(k), key(k + 1), scan.measured, information, kernel)?;
            }
        }
        for closure in self.closures.iter().filter(|closure| closure.accepted) {
            let kernel = Kernel::Cauchy(self.params.loops.cauchy);
            let information = closure.information()?;
            graph.add_between(
                key(closure.target),
                key(closure.source),
                closure.measured,
                information,
                kernel,
            )?;
        }
        Ok(graph)
    }

    /// Moves poses and calibration to the optimum.
    fn optimise(&mut self) -> Result<(), Error> {
        let solution = solve(&self.graph()?, &SolveParams::default())?;
        for (k, pose) in self.poses.iter_mut().enumerate() {
            if let Some(solved) = solution.pose(key(k)) {
                *pose = *solved;
            }
        }
        if let Some(calibration) = solution.pose(CALIBRATION) {
            self.scale = calibration.translation.x;
            self.bias = calibration.rotation.angle();
        }
        self.calibrate_noise();
        self.calibrate_kernel();
        self.calibrate_turn();
        self.calibrate_odometry_heading();
        Ok(())
    }

    /// Covariances of the poses at their present values.
    ///
    /// # Errors
    /// Those of the factorisation; not on an optimised map.
    pub fn marginals(&self) -> Result<Marginals<Isometry2<f64>, 3>, Error> {
        Ok(Marginals::new(&self.graph()?, Gauge::Require)?)
    }

    /// Keyframes so far.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// Pose of each keyframe in the robot's map.
    pub fn poses(&self) -> &[Isometry2<f64>] {
        &self.poses
    }

    /// True length over length by odometry, as calibrated so far.
    pub fn odometry_scale(&self) -> f64 {
        self.scale
    }

    /// Standard deviation of a step of odometry along each axis, as calibrated so far, metres.
    pub fn odometry_sigma(&self) -> f64 {
        self.sigma
    }

    /// Standard deviation of the heading of a step of odometry, as calibrated so far, radians.
    pub fn odometry_sigma_angle(&self) -> f64 {
        self.sigma_angle
    }

    /// Scale of the Cauchy kernel on what scans say about steps, in their standard deviations, as calibrated so far.
    pub fn step_kernel(&self) -> f64 {
        self.kernel
    }

    /// Standard deviation of what the matches' headings are off by beyond what they tell, as calibrated so far, radians.
    pub fn match_sigma_angle(&self) -> f64 {
        self.turn
    }

    /// Loop closures in the map, as (earlier, later) keyframe.
    pub fn loop_closures(&self) -> Vec<(u32, u32)> {
        let accepted = self.closures.iter().filter(|closure| closure.accepted);
        accepted.map(|c| (c.target.min(c.source) as u32, c.target.max(c.source) as u32)).collect()
    }

    /// The measurements of the map: one a step, with the calibration of the moment, then the accepted closures.
    ///
    /// # Errors
    /// [`Error::LocalCovariance`] for a step whose information cannot be inverted.
    pub fn factors(&self) -> Result<Vec<LocalFactor>, Error> {
        let prior = self.odometry_covariance();
        let steps = self.steps.iter().enumerate().map(|(k, step)| {
            let odometry = self.predicted(step);
            let (measured, covariance, kind) = match self.seen(step) {
                Some(scan) => {
                    // The weight the kernel gives it in this map, so that a plain graph of these factors has the
                    // same optimum.
                    let relative = self.poses[k].between(&self.poses[k + 1]);
                    let weighed = scan.weighed(&relative, self.kernel);
                    let (from, to) = (k as u32, k as u32 + 1);
                    let (measured, covariance) =
                        weighed.fused(&odometry, &prior).ok_or(Error::LocalCovariance { from, to })?;
                    (measured, covariance, FactorKind::Match)
                }
                None => (odometry, prior, FactorKind::Odometry),
            };
            Ok(LocalFactor { from: k as u32, to: k as u32 + 1, measured, covariance, kind })
        });
        let closures = self.closures.iter().filter(|closure| closure.accepted).map(|closure| {
            Ok(LocalFactor {
                from: closure.target as u32,
                to: closure.source as u32,
                measured: closure.measured,
                covariance: closure.covariance,
                kind: FactorKind::Loop,
            })
        });
        steps.chain(closures).collect()
    }
}

/// The parameters with the smaller part of what the lattice hides, and the covariance of the rest.
///
/// A prior is taken out of the posterior again, and what the lattice hides is not part of that: it comes on afterwards. A
/// quarter of its variance stays, for a posterior that lies on one pose of the lattice has no inverse.
fn without_hidden(params: &CorrelativeParams) -> (CorrelativeParams, Matrix3<f64>) {
    let (sigma, angle) = (0.5 * params.extra_sigma, 0.5 * params.extra_sigma_angle);
    let bare = CorrelativeParams { extra_sigma: sigma, extra_sigma_angle: angle, ..*params };
    (bare, 3.0 * noise::covariance(sigma, angle))
}

fn key(k: usize) -> Key {
    Key::new(0, k as u64)
}

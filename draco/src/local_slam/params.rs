use draco_consistency::PcmParams;
use draco_registration::correlative::CorrelativeParams;

use crate::matching::refinement;

/// What a robot's own SLAM assumes and when it believes a match.
///
/// Lengths in metres, angles in radians. The defaults follow from the sensor and the keyframe policy (range 30 to
/// 50 m, points thinned to 0.5 m, a keyframe every 3 m or 30°) and are the same for every mission, simulated or real.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalSlamParams {
    /// Keyframes merged into the target of a step. Default 15: with 3 m between keyframes and 40 to 50 m of range the
    /// last 15 still see what the newest sees, and a long window keeps the error of a step from adding up.
    pub window: usize,
    /// Points closer than this are merged in a target, metres. Default 0.35 m, below the 0.5 m of one scan.
    pub voxel: f64,
    /// Fewest points of a scan that is matched at all. Default 40.
    pub min_points: usize,
    /// Standard deviation of one step of odometry after calibration, along and across, metres, before anything is known:
    /// matches are looked for with it, and the calibration takes it down as far as the matches agree with odometry, never
    /// up. Default 0.6 m: a fifth of a step, what commanded velocity under current gives.
    pub odometry_sigma: f64,
    /// Standard deviation of the logarithm of the calibrated one around that, in position and in heading. Default 0.7, a
    /// factor of two, so that some ten matches outweigh it.
    pub odometry_spread: f64,
    /// The same in heading, radians. Default 0.015 rad, a compass-aided gyro over some twenty seconds. The calibration takes it
    /// up, never down, where submaps registered over a few steps tell of worse odometry: that of wheels, say.
    pub odometry_sigma_angle: f64,
    /// Standard deviation of the unknown factor by which odometry misjudges lengths; its mean is 1. Default 0.15.
    pub scale_sigma: f64,
    /// Standard deviation of an unknown constant error of the odometry's heading, radians a keyframe. Default 0.003: ten
    /// degrees over 60 keyframes, a gyro whose bias has been taken off at the start.
    pub bias_sigma: f64,
    /// Matching of one scan with the window; its score tells whether to believe the match. Its radius is 5 σ of a step; its
    /// angle grows with what the calibration makes of odometry's heading.
    pub step: CorrelativeParams,
    /// Second, finer matching, also from odometry: it tells the pose and its covariance. Default the window of `step` with the
    /// kernel and the lattice of [`ClosureParams::refinement`](crate::closure::ClosureParams::refinement).
    pub step_refinement: CorrelativeParams,
    /// Least score of a step match. Default 0.35: a third of the points has to lie on the map.
    pub step_min_score: f64,
    /// Largest scale of the Cauchy kernel on what a scan says about a step, in its standard deviations. Default 2: odometry,
    /// once calibrated, is right to half a metre, so a match that contradicts it by more is more likely a scan that slid
    /// along a wall. Where many do, the calibration narrows it.
    pub step_cauchy: f64,
    /// Loop closures within the robot's own map.
    pub loops: LoopParams,
    /// Test of those closures against each other.
    pub pcm: PcmParams,
}

impl Default for LocalSlamParams {
    fn default() -> Self {
        let step = CorrelativeParams::default();
        Self {
            window: 15,
            voxel: 0.35,
            min_points: 40,
            odometry_sigma: 0.6,
            odometry_spread: 0.7,
            odometry_sigma_angle: 0.015,
            scale_sigma: 0.15,
            bias_sigma: 0.003,
            step,
            step_refinement: CorrelativeParams { radius: step.radius, angle: step.angle, ..refinement() },
            step_min_score: 0.35,
            step_cauchy: 2.0,
            loops: LoopParams::default(),
            pcm: PcmParams { minimum: 2, ..PcmParams::default() },
        }
    }
}

/// How a robot looks for places it has seen before.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopParams {
    /// Keyframes merged on each side of the source. Default 2.
    pub source_half: usize,
    /// Keyframes merged on each side of the target. Default 4.
    pub target_half: usize,
    /// Least number of keyframes between source and target, but never so few that the two share a scan. Default 10, so that
    /// the window of the steps does not already hold both.
    pub min_separation: usize,
    /// How many of the submaps right before that of the source it is registered with as well, each of as many keyframes and
    /// with no scan in two of them. Default 2, so that they reach over the window of the steps.
    pub submaps_before: usize,
    /// Largest distance between the two keyframes, metres. Default 30 m, where views of a 50 m sonar still overlap.
    pub max_distance: f64,
    /// Targets tried for one source. Default 3.
    pub per_keyframe: usize,
    /// The search radius is this many standard deviations of the relative pose. Default 3.
    pub sigmas: f64,
    /// Least and largest search radius, metres. Default 2 to 10 m. A match at the border of its window is looked for again
    /// in one twice as wide, and is none if it lies at the border of the widest.
    pub radius: (f64, f64),
    /// Largest search in heading, radians. Default 0.2.
    pub max_angle: f64,
    /// Least score. Default 0.25, less than that of a step: a loop has a submap on either side, and what is wrong is for the
    /// border of the window, the test and the kernel to find.
    pub min_score: f64,
    /// Matching of the source with the target.
    pub matching: CorrelativeParams,
    /// Second, finer search around what the first one found. It moves the closure; the covariance stays that of the first,
    /// because the submaps are bent by more than the finer kernel knows. Default as for closures between robots.
    pub refinement: CorrelativeParams,
    /// Scale of the Cauchy kernel, in standard deviations. Default 1.
    pub cauchy: f64,
}

impl Default for LoopParams {
    fn default() -> Self {
        Self {
            source_half: 2,
            target_half: 4,
            min_separation: 10,
            submaps_before: 2,
            max_distance: 30.0,
            per_keyframe: 3,
            sigmas: 3.0,
            radius: (2.0, 10.0),
            max_angle: 0.2,
            min_score: 0.25,
            matching: CorrelativeParams::default(),
            refinement: refinement(),
            cauchy: 1.0,
        }
    }
}

use nalgebra::{Isometry2, Vector2};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::{Error, Pose, Range, Trajectory, Trajectory2, isotropic_covariance};

/// What is true of a generated range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RangeLabel {
    /// Only its own noise.
    Good,
    /// Any length.
    Random,
    /// An echo off a wall: the distance to the beacon's mirror image, so all echoes agree with each other.
    Echo,
}

/// Ranges from a moving robot to one beacon, with the truth about each.
#[derive(Debug, Clone)]
pub struct RangeProblem {
    /// What the robot believes of its path.
    pub trajectory: Trajectory2,
    /// One range a pose.
    pub ranges: Vec<Range>,
    /// The truth about each range.
    pub labels: Vec<RangeLabel>,
    /// Where the beacon lies, metres.
    pub beacon: Vector2<f64>,
    /// Where its mirror image lies, metres.
    pub mirrored: Vector2<f64>,
}

/// Parameters of [`ranges()`].
#[derive(Debug, Clone, PartialEq)]
pub struct Ranging {
    /// Number of poses, each with one range; default 60.
    pub poses: usize,
    /// Share of ranges that are of any length, uniform from 1 to 35 m; default 0.4.
    pub random_share: f64,
    /// Share of ranges that are echoes; default 0.
    pub echo_share: f64,
    /// σ of a range, metres; default 0.1.
    pub sigma: f64,
    /// σ of an odometry step, metres and radians; default 5 mm, 0.5 mrad.
    pub step: (f64, f64),
}

impl Default for Ranging {
    fn default() -> Self {
        Self { poses: 60, random_share: 0.4, echo_share: 0.0, sigma: 0.1, step: (0.005, 0.0005) }
    }
}

/// Ranges to one beacon from a winding path, some random, some echoes off the wall `y = 20 m`.
///
/// # Errors
/// [`Error::Generator`] for no pose, shares outside [0, 1] together, or a σ that is not positive.
///
/// ```
/// use draco_consistency::simulate::{Ranging, ranges};
/// use rand::SeedableRng;
///
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let problem = ranges(&Ranging::default(), &mut rng)?;
/// assert_eq!(problem.ranges.len(), problem.labels.len());
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn ranges(params: &Ranging, rng: &mut impl Rng) -> Result<RangeProblem, Error> {
    const WALL: f64 = 20.0;
    let shares = params.random_share + params.echo_share;
    if params.poses == 0
        || !(0.0..=1.0).contains(&shares)
        || params.random_share < 0.0
        || params.echo_share < 0.0
    {
        return Err(Error::Generator { reason: "ranges need a pose, and shares of outliers within [0, 1]" });
    }
    let is_positive = |sigma: f64| sigma > 0.0 && sigma.is_finite();
    if !(is_positive(params.sigma) && is_positive(params.step.0) && is_positive(params.step.1)) {
        return Err(Error::Generator { reason: "ranges and steps need a positive sigma" });
    }
    let normal = |sigma: f64, rng: &mut _| -> f64 {
        let z: f64 = StandardNormal.sample(rng);
        z * sigma
    };
    let truth: Vec<Isometry2<f64>> = (0..params.poses)
        .map(|k| {
            let t = k as f64 * 0.1;
            Isometry2::planar(8.0 * t.cos() + 2.0 * t, 8.0 * (1.3 * t).sin(), t)
        })
        .collect();
    let mut believed = vec![truth[0]];
    for pair in truth.windows(2) {
        let (forward, aside, turn) =
            (normal(params.step.0, rng), normal(params.step.0, rng), normal(params.step.1, rng));
        let step = pair[0].inv_mul(&pair[1]) * Isometry2::planar(forward, aside, turn);
        believed.push(believed[believed.len() - 1] * step);
    }
    let steps =
        vec![isotropic_covariance::<3, Isometry2<f64>>(params.step.0, params.step.1); params.poses - 1];
    let beacon = Vector2::new(rng.random_range(3.0..12.0), rng.random_range(10.0..16.0));
    let mirrored = Vector2::new(beacon.x, 2.0 * WALL - beacon.y);
    let (mut measured, mut labels) = (Vec::new(), Vec::new());
    for (pose, place) in truth.iter().enumerate() {
        let kind: f64 = rng.random();
        let label = if kind < params.random_share {
            RangeLabel::Random
        } else if kind < shares {
            RangeLabel::Echo
        } else {
            RangeLabel::Good
        };
        let towards = if label == RangeLabel::Echo { mirrored } else { beacon };
        let distance = (towards - place.translation.vector).norm() + normal(params.sigma, rng);
        let range = if label == RangeLabel::Random { rng.random_range(1.0..35.0) } else { distance.max(0.0) };
        measured.push(Range { pose, range, sigma: params.sigma });
        labels.push(label);
    }
    Ok(RangeProblem {
        trajectory: Trajectory::from_steps(believed, &steps)?,
        ranges: measured,
        labels,
        beacon,
        mirrored,
    })
}

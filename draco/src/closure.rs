//! Candidate loop closures between robots and their registration.
//!
//! [`candidates`] pairs the partner's keyframes with the robot's own that see the same place, [`register`] finds the
//! partner's scan in the surroundings of the robot's keyframe, and says why if it does not believe the result.

use draco_registration::correlative::{CorrelativeParams, Start, Target};
use nalgebra::{Isometry2, Matrix3, Point2};

use crate::Error;

/// Which pairs are tried and which registrations are believed.
///
/// Lengths in metres, angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosureParams {
    /// Largest distance between the two keyframes. Default 20 m: less than half the sensor's range, so that the views
    /// overlap even across each other.
    pub max_distance: f64,
    /// Metres that a radian of difference in heading counts for when candidates are ranked. Default 10.
    pub metres_per_radian: f64,
    /// Own keyframes tried for one of the partner. Default 2.
    pub per_keyframe: usize,
    /// Least number of keyframes between those. Default 5.
    pub separation: usize,
    /// Keyframes of the robot merged on each side of the target. Default 4.
    pub target_half: usize,
    /// Keyframes of the partner merged on each side of the source. Default 0, the scan alone: with a good start it
    /// does as well as five, and it is all that has to be sent.
    pub source_half: usize,
    /// Fewest points of source and target. Default 40.
    pub min_points: usize,
    /// Half width of the search. Default 5 m: the error of an alignment and of two maps.
    pub radius: f64,
    /// Half width of the search in heading. Default 0.12 rad.
    pub angle: f64,
    /// Least score. Default 0.45: nearly half of the scan has to lie on the map.
    pub min_score: f64,
    /// Largest score of another place over that of the best. Default 0.95.
    pub max_far_ratio: f64,
    /// Factor on the covariance of a registration. Default 1.75: the target is itself a map with errors, which the
    /// posterior does not know.
    pub inflation: f64,
    /// The matcher.
    pub matching: CorrelativeParams,
}

impl Default for ClosureParams {
    fn default() -> Self {
        Self {
            max_distance: 20.0,
            metres_per_radian: 10.0,
            per_keyframe: 2,
            separation: 5,
            target_half: 4,
            source_half: 0,
            min_points: 40,
            radius: 5.0,
            angle: 0.12,
            min_score: 0.45,
            max_far_ratio: 0.95,
            inflation: 1.75,
            matching: CorrelativeParams::default(),
        }
    }
}

/// A pair of keyframes that may see the same place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The robot's own keyframe, whose surroundings are the target.
    pub own: u32,
    /// The partner's keyframe, the source.
    pub partner: u32,
    /// Expected pose of the partner's keyframe in the own one.
    pub own_from_partner: Isometry2<f64>,
}

/// The pairs worth trying: for each keyframe of the partner the own ones nearest in position and heading.
///
/// * `own`, `partner` – poses of the keyframes, each robot's in its own map.
/// * `own_from_partner` – where the partner's map lies in the robot's own.
pub fn candidates(
    own: &[Isometry2<f64>],
    partner: &[Isometry2<f64>],
    own_from_partner: &Isometry2<f64>,
    params: &ClosureParams,
) -> Vec<Candidate> {
    let mut all = Vec::new();
    for (j, pose) in partner.iter().enumerate() {
        let placed = own_from_partner * pose;
        let mut near: Vec<(f64, usize)> = own
            .iter()
            .enumerate()
            .filter_map(|(k, mine)| {
                let distance = (mine.translation.vector - placed.translation.vector).norm();
                let turn = mine.rotation.angle_to(&placed.rotation).abs();
                (distance < params.max_distance).then_some((distance + params.metres_per_radian * turn, k))
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        for (_, k) in near {
            if chosen.len() < params.per_keyframe && chosen.iter().all(|c| c.abs_diff(k) >= params.separation) {
                chosen.push(k);
            }
        }
        all.extend(chosen.into_iter().map(|k| Candidate {
            own: k as u32,
            partner: j as u32,
            own_from_partner: own[k].inverse() * placed,
        }));
    }
    all
}

/// Whether a registration is believed, and if not, why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gate {
    /// Believed.
    Passed,
    /// Too few points to register at all.
    FewPoints,
    /// Too little of the scan lies on the map.
    LowScore,
    /// Another place fits nearly as well.
    Ambiguous,
}

/// A registered pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registered {
    /// Pose of the source keyframe in the target keyframe.
    pub target_from_source: Isometry2<f64>,
    /// Covariance in the frame of the source, order x, y, heading.
    pub covariance: Matrix3<f64>,
    /// Share of the source that lies on the target, softly counted, 0 to 1.
    pub score: f64,
    /// Best score elsewhere over the best score.
    pub far_ratio: f64,
    /// Whether to believe it.
    pub gate: Gate,
}

/// Finds the partner's scan in the surroundings of one of the robot's own keyframes.
///
/// * `target` – points around the own keyframe, in its frame.
/// * `source` – the partner's points, in the frame of its keyframe.
/// * `start` – expected pose of the source in the target.
///
/// # Errors
/// What the matcher refuses, such as points that are not finite.
pub fn register(
    target: &[Point2<f64>],
    source: &[Point2<f64>],
    start: &Isometry2<f64>,
    params: &ClosureParams,
) -> Result<Registered, Error> {
    if target.len().min(source.len()) < params.min_points.max(1) {
        return Ok(Registered {
            target_from_source: *start,
            covariance: Matrix3::identity(),
            score: 0.0,
            far_ratio: 0.0,
            gate: Gate::FewPoints,
        });
    }
    let matching = CorrelativeParams { radius: params.radius, angle: params.angle, ..params.matching };
    let start = Start { target_from_source: *start, covariance: None };
    let found = Target::new(target, &matching)?.locate(source, &start)?;
    let gate = if found.score < params.min_score {
        Gate::LowScore
    } else if found.far_ratio > params.max_far_ratio {
        Gate::Ambiguous
    } else {
        Gate::Passed
    };
    Ok(Registered {
        target_from_source: found.target_from_source,
        covariance: found.covariance * params.inflation,
        score: found.score,
        far_ratio: found.far_ratio,
        gate,
    })
}

//! Candidate loop closures between robots and their registration.

use std::ops::RangeInclusive;

use draco_registration::correlative::{CorrelativeParams, Start, Target};
use nalgebra::{Isometry2, Matrix3, Point2};

use crate::error::Error;
use crate::matching::{centroid, refinement, turn_covariance};

/// Which keyframe pairs to register, and which results to believe.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosureParams {
    /// Largest distance of the two keyframes under the alignment, metres. Default 20 m: half the range of the sonar,
    /// so that the two see the same things.
    pub max_distance: f64,
    /// Metres that a radian of heading difference counts when candidates are ranked. Default 10.
    pub metres_per_radian: f64,
    /// Own keyframes tried for each of the partner's. Default 2.
    pub per_keyframe: usize,
    /// Least number of keyframes between those. Default 5.
    pub separation: usize,
    /// Keyframes merged on each side of the partner's. Default 2.
    pub source_half: u32,
    /// Keyframes merged on each side of the own one. Default 4.
    pub target_half: u32,
    /// Fewest points of source and target. Default 40.
    pub min_points: usize,
    /// Half width of the search, metres and radians. Default 5 m and 0.12 rad, for an alignment good to 1 to 2 m.
    pub matching: CorrelativeParams,
    /// Second, finer search around what the first one found. Its narrower kernel tells the heading two to three times as
    /// sharply. Default kernel 0.3 m, steps of 0.2 m within 1.2 m and 0.05 rad.
    pub refinement: CorrelativeParams,
    /// Least score. Default 0.45.
    pub min_score: f64,
    /// Largest score far from the best over the best. Default 0.95.
    pub max_far_ratio: f64,
    /// Factor on the matcher's covariance. Default 1.3: both submaps are bent, which the posterior does not know. With it
    /// the mean normalised error of accepted closures is 0.5 to 1.2 in the scenarios.
    pub covariance_factor: f64,
    /// Scale of the Cauchy kernel, in standard deviations, on closures that a test of the published system passes, and on
    /// those that `gcm` passes but the team's estimate speaks against. Default 1, as published: some are wrong.
    pub cauchy: f64,
    /// The same on closures that `gcm` believes and the team's estimate bears out. Default 2.385, which keeps 95 % of the
    /// efficiency where all errors are normal (Z. Zhang, *Parameter estimation techniques*, 1997, table 1).
    pub cauchy_believed: f64,
    /// Farthest that an accepted closure may be from the team's estimate, in medians of how far the accepted ones are, in
    /// position and in heading; one beyond is no longer believed. Default 4.5: of normal errors, one heading in four hundred.
    pub max_residual_medians: f64,
    /// The same in metres, whatever the median; one beyond is taken back. Default 2.5 m, past which a closure does not count
    /// as right.
    pub max_residual: f64,
    /// The same in heading, radians. Default 2°: short of the 2.5° past which a closure does not count as right, since the
    /// estimate's own headings are good to half a degree.
    pub max_residual_angle: f64,
    /// Pairs of others that a robot considers for each of them; it considers all of its own. Default 3: teams of up to five
    /// leave out nothing, and larger ones pay by the robots they meet and not by the pairs among these.
    pub witnesses: usize,
}

impl Default for ClosureParams {
    fn default() -> Self {
        ClosureParams {
            max_distance: 20.0,
            metres_per_radian: 10.0,
            per_keyframe: 2,
            separation: 5,
            source_half: 2,
            target_half: 4,
            min_points: 40,
            matching: CorrelativeParams { radius: 5.0, angle: 0.12, ..CorrelativeParams::default() },
            refinement: refinement(),
            min_score: 0.45,
            max_far_ratio: 0.95,
            covariance_factor: 1.3,
            cauchy: 1.0,
            cauchy_believed: 2.385,
            max_residual_medians: 4.5,
            max_residual: 2.5,
            max_residual_angle: 2f64.to_radians(),
            witnesses: 3,
        }
    }
}

impl ClosureParams {
    /// The partner's keyframes merged around `keyframe`, of `count`.
    pub fn source_range(&self, keyframe: u32, count: u32) -> RangeInclusive<u32> {
        around(keyframe, self.source_half, count)
    }

    /// The own keyframes merged around `keyframe`, of `count`.
    pub fn target_range(&self, keyframe: u32, count: u32) -> RangeInclusive<u32> {
        around(keyframe, self.target_half, count)
    }
}

fn around(keyframe: u32, half: u32, count: u32) -> RangeInclusive<u32> {
    keyframe.saturating_sub(half)..=(keyframe + half).min(count.saturating_sub(1))
}

/// A pair of keyframes that should see the same place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// Own keyframe.
    pub own: u32,
    /// The partner's.
    pub partner: u32,
}

/// The best own keyframes for each of the partner's, nearest first.
///
/// * `own`, `partner` – poses of both robots in one frame.
pub fn candidates(
    own: &[Isometry2<f64>],
    partner: &[Isometry2<f64>],
    params: &ClosureParams,
) -> Vec<Candidate> {
    let mut found = Vec::new();
    for (k, theirs) in partner.iter().enumerate() {
        let mut near: Vec<(f64, usize)> = own
            .iter()
            .enumerate()
            .filter_map(|(i, mine)| {
                let distance = (mine.translation.vector - theirs.translation.vector).norm();
                let turn = mine.rotation.angle_to(&theirs.rotation).abs();
                (distance < params.max_distance).then_some((distance + params.metres_per_radian * turn, i))
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        for (_, i) in near {
            if chosen.len() < params.per_keyframe && chosen.iter().all(|c| c.abs_diff(i) >= params.separation)
            {
                chosen.push(i);
            }
        }
        found.extend(chosen.into_iter().map(|i| Candidate { own: i as u32, partner: k as u32 }));
    }
    found
}

/// A registered keyframe pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registered {
    /// The source keyframe seen from the target keyframe, refined if it passed.
    pub target_from_source: Isometry2<f64>,
    /// Covariance in the frame of the source, order x, y, theta.
    pub covariance: Matrix3<f64>,
    /// Score of the match, 0 to 1.
    pub score: f64,
    /// Best score far away over that score.
    pub far_ratio: f64,
    /// Whether score and far ratio pass their gates.
    pub passed: bool,
}

impl Registered {
    /// The same, known to be off in heading by more than the matcher tells.
    ///
    /// * `source` – the points that were registered, metres, in the frame of the source keyframe; the turn is about their
    ///   centroid.
    /// * `sigma` – standard deviation of the turn, radians.
    pub fn turned(mut self, source: &[Point2<f64>], sigma: f64) -> Self {
        self.covariance += turn_covariance(&centroid(source), sigma);
        self
    }
}

/// Registers the points around one keyframe with those around another; `None` when either has too few.
///
/// * `target`, `source` – points in the frame of their own keyframe.
/// * `start` – where the source keyframe should lie in the target's frame.
///
/// # Errors
/// Those of the matcher.
pub fn register(
    target: &[Point2<f64>],
    source: &[Point2<f64>],
    start: &Isometry2<f64>,
    params: &ClosureParams,
) -> Result<Option<Registered>, Error> {
    if target.len().min(source.len()) < params.min_points {
        return Ok(None);
    }
    let locate = |params: &CorrelativeParams, around: &Isometry2<f64>| {
        let start = Start { target_from_source: *around, covariance: None };
        Target::for_source(target, params, source, around)?.locate(source, &start)
    };
    let found = locate(&params.matching, start)?;
    let passed =
        found.score >= params.min_score && found.far_ratio <= params.max_far_ratio && !found.at_border;
    let placed = if passed { locate(&params.refinement, &found.target_from_source)? } else { found };
    Ok(Some(Registered {
        target_from_source: placed.target_from_source,
        covariance: placed.covariance * params.covariance_factor,
        score: found.score,
        far_ratio: found.far_ratio,
        passed,
    }))
}

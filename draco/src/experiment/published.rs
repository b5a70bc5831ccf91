//! The published system, as far as this crate's settings reach it, under each consistency test; ours beside it.
//!
//! What our front end does against wrong places of maps leaves a consistency test little to find. The published
//! comparison is one of systems, and there the tests meet the closures of the published front end.

use super::ate::{FrontEnd, Variant, ate_in_team, compare, own_ate};
use super::missions::{Flown, mean};
use super::{Outcome, Settings};
use crate::alignment::{AlignmentParams, MapKind};
use crate::closure::ClosureParams;
use crate::consistency::Method;
use crate::error::Error;
use crate::objects::ObjectParams;
use crate::robot::RobotParams;
use crate::simulate::Scenario;
use crate::two_step::Optimisation;

/// A robot of the published system, as far as settings go.
///
/// As published (DRACo-SLAM2, its released code):
/// - objects are whole clusters with the mean of their points, moving or not, from one keyframe on;
/// - they are matched spectrally as in the code, and the newest match replaces the last one, without a ratio test,
///   without repeated agreement, without being confirmed by registrations and without closing cycles with other robots';
/// - registrations outlive the match they were made under;
/// - keyframes within 40 m (harbor) or 20 m (wreck) are candidates; one scan of at least 30 points is registered in
///   seven (the window the code means to take), without a test for rivals;
/// - the team is estimated in the two steps of the code, closures under a Cauchy kernel of scale 1.
///
/// Set for our points, half a metre apart, where the published objects are made of dense pixels: objects count from 2 m
/// on instead of 3, which would leave no group of piles, and scans of the wreck from 30 points on instead of 100.
///
/// Ours all the same: each robot's own map; the correlative matcher with its gate on the score and its covariance (the
/// published system has ICP, a gate on overlap and the spacing of points as covariance); at most two own keyframes for
/// each of the partner's; each pair once, whatever came of it (published: failed pairs are tried again under every new
/// match); the team's estimate as the place of a merged map (published: the raw match); a second match before the first
/// counts; PCM with both covariances; closures judged anew at every step; the link with its traffic. With `gcm` comes
/// what belongs to it: closures far from the team's estimate are no longer believed, or taken back.
pub(super) fn settings(scenario: Scenario) -> RobotParams {
    let max_distance = match scenario {
        Scenario::Harbor => 40.0,
        Scenario::Wreck => 20.0,
    };
    RobotParams {
        objects: ObjectParams { min_length_m: 2.0, ..ObjectParams::published() },
        alignment: AlignmentParams {
            maps: MapKind::Objects,
            // all places count as the same one: none is doubted, and each replaces the last
            same_distance: f64::INFINITY,
            same_angle: f64::INFINITY,
            min_streak: 1,
            min_tested: 0,
            min_share: 0.0,
            ..AlignmentParams::default()
        },
        closure: ClosureParams {
            max_distance,
            min_points: 30,
            source_half: 0,
            target_half: 3,
            max_far_ratio: f64::INFINITY,
            cauchy_believed: 1.0,
            ..ClosureParams::default()
        },
        optimisation: Optimisation::AsCoded,
        ..RobotParams::default()
    }
}

/// The tests that are compared.
const METHODS: [Method; 3] = [Method::Pcm, Method::GcmPooled, Method::Gcm];

fn published(method: Method) -> Variant {
    let (front_end, way) = (FrontEnd::Published, Optimisation::AsCoded);
    Variant { front_end, way, ..Variant::ours(method) }
}

/// Both scenarios with the published system under PCM, the pooled rule and `gcm`, and with all of ours.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let ours = Variant::ours(Method::Gcm);
    let variants: Vec<Variant> = METHODS.map(published).into_iter().chain([ours]).collect();
    let (mut outcome, flown) = compare(&variants, settings)?;
    for scenario in Scenario::ALL {
        for (what, variant) in [("published front end with gcm", published(Method::Gcm)), ("ours", ours)] {
            for against in [Method::Pcm, Method::GcmPooled] {
                outcome.notes.push(below(&flown, scenario, (what, variant), published(against)));
            }
        }
    }
    Ok(outcome)
}

/// By how much the mean errors of one variant lie below another's, robot by robot.
fn below(
    flown: &[Flown<Variant>],
    scenario: Scenario,
    (what, variant): (&str, Variant),
    other: Variant,
) -> String {
    let share = |ate: fn(&Flown<Variant>, usize) -> Option<f64>| {
        let of = |variant: Variant, at: usize| {
            let of_variant =
                flown.iter().filter(|f| f.plan.scenario == scenario && f.plan.variant == variant);
            mean(of_variant.map(|f| ate(f, at)))
        };
        let robot = |at| match (of(variant, at), of(other, at)) {
            (Some(a), Some(b)) => format!("{:.0} %", 100.0 * (1.0 - a / b)),
            _ => "-".into(),
        };
        (0..3).map(robot).collect::<Vec<_>>().join(", ")
    };
    format!(
        "{}: {what} lies below published {} by {} (own alignment) and {} (in the team's frame)",
        scenario.name(),
        other.method,
        share(own_ate),
        share(ate_in_team)
    )
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry2, Point2, Vector2};

    use super::*;

    #[test]
    fn the_newest_match_stands_wherever_it_is() {
        for scenario in Scenario::ALL {
            let params = settings(scenario).alignment;
            let (near, far) = (Isometry2::identity(), Isometry2::new(Vector2::new(80.0, 0.0), 3.0));
            assert!(params.same(&near, &far, &Point2::origin()));
            assert_eq!(params.judge(0, 0), Some(true));
        }
    }
}

use draco_graphmatch::{AsCodedParams, Match, Method, Object, Verdict as Found, match_objects};
use draco_registration::correlative::MapMode;

use super::Verdict;
use crate::error::Error;
use crate::message::ObjectEntry;

/// Compares two maps by their objects instead of their cells: the light way, for where things stand apart.
///
/// A match that several transforms explain is [`Verdict::Ambiguous`]; its ratio is that of the explanations'
/// probabilities. Transforms come with the share of the partner's objects that they pair as score.
///
/// # Errors
/// Those of the matcher: an object that is not finite, or has a negative side.
pub fn align_objects(
    own: &[ObjectEntry],
    partner: &[ObjectEntry],
    matcher: ObjectMatcher,
) -> Result<Verdict, Error> {
    let object = |o: &ObjectEntry| Object::new(o.centroid, o.length, o.breadth);
    let (map1, map2): (Vec<_>, Vec<_>) =
        (own.iter().map(object).collect(), partner.iter().map(object).collect());
    let method = match matcher {
        ObjectMatcher::Consensus => Method::default(),
        ObjectMatcher::AsCoded => Method::AsCoded(AsCodedParams::default()),
    };
    let found = match_objects(&map1, &map2, &method)?;
    Ok(verdict(&found, partner.len()))
}

/// How objects are matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectMatcher {
    /// Transform hypotheses weighed by their evidence.
    Consensus,
    /// Spectral matching as in the published system's code.
    AsCoded,
}

fn verdict(found: &Match, partner_objects: usize) -> Verdict {
    let Some(best) = found.modes.first() else { return Verdict::None };
    let second = found.modes.get(1).map_or(0.0, |mode| mode.probability);
    match found.verdict {
        Found::None => Verdict::None,
        Found::Ambiguous => Verdict::Ambiguous { ratio: second / best.probability.max(f64::MIN_POSITIVE) },
        Found::Unique => Verdict::Clear(MapMode {
            target_from_source: *best.map1_from_map2.mean(),
            covariance: *best.map1_from_map2.covariance(),
            score: best.pairs.len() as f64 / partner_objects.max(1) as f64,
        }),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry2, Point2, Vector2};

    use super::*;

    #[test]
    fn both_matchers_find_a_map_again() {
        let places =
            [(0.0, 0.0), (9.0, 2.0), (4.0, 12.0), (-6.0, 7.0), (15.0, -8.0), (3.0, -11.0), (20.0, 9.0)];
        let own: Vec<_> = (0..)
            .zip(places)
            .map(|(id, (x, y))| ObjectEntry {
                id,
                centroid: Point2::new(x, y),
                length: 4.0 + f64::from(id),
                breadth: 2.0,
            })
            .collect();
        let own_from_partner = Isometry2::new(Vector2::new(30.0, -5.0), 2.0);
        let moved = |o: &ObjectEntry| ObjectEntry {
            centroid: own_from_partner.inverse_transform_point(&o.centroid),
            ..o.clone()
        };
        let partner: Vec<_> = own.iter().map(moved).collect();
        for matcher in [ObjectMatcher::Consensus, ObjectMatcher::AsCoded] {
            let Verdict::Clear(mode) = align_objects(&own, &partner, matcher).unwrap() else {
                panic!("{matcher:?} found nothing clear");
            };
            let error = mode.target_from_source.inv_mul(&own_from_partner);
            assert!(
                error.translation.vector.norm() < 0.5 && error.rotation.angle().abs() < 0.05,
                "{matcher:?}"
            );
        }
    }
}

use draco_lie::GaussianPose2;
use nalgebra::{Isometry2, Point2, Vector2};

use super::ConsensusParams;
use super::alike::Alike;
use super::continuation::{APART, Continuation};
use super::evidence::{Explanation, middle, refine, ties};
use super::hypotheses::{Hypotheses, Ray, rays};
use super::polish::polish;
use super::problem::Problem;
use super::repeated::{central, repeated};
use crate::object::check_map;
use crate::rigid::information;
use crate::{Error, Match, Mode, Object, Pair, Similarity, Verdict};

/// Matches two object maps with a likeness of your own.
///
/// # Errors
/// As [`match_objects`](crate::match_objects).
pub fn consensus(
    map1: &[Object],
    map2: &[Object],
    similarity: &impl Similarity,
    params: &ConsensusParams,
) -> Result<Match, Error> {
    params.check()?;
    check_map(map1, "map1")?;
    check_map(map2, "map2")?;
    let mut problem = Problem::new(map1, map2, similarity, params);
    let rays1 = rays(&problem.p1, params.min_edge);
    let rays2 = rays(&problem.p2, params.min_edge);
    let structure1 = repeated(map1, &rays1, &Alike::of_map1(&problem), params);
    let structure2 = repeated(map2, &rays2, &Alike::of_map2(&problem), params);
    (problem.repeated1, problem.repeated2) = (structure1.repeated, structure2.repeated);
    let mut found = separate_modes(&problem, &rays1, &rays2);
    favour_one_structure(&problem, &structure1.shifts, &mut found);
    Ok(judge(&problem, found))
}

/// Evidence, in nats, behind the best that no detection term makes up for.
const HOPELESS: f64 = 20.0;

/// Pairs of repeated objects that are tried as pivots, times the objects of map 1 that each looks at: what a large map may cost. All
/// pairs of forty pilings; of 150 six hundred. Each turns the map by whole shifts of its structure, as its neighbours do; which
/// shift it is, only pairs of other objects tell, and those are all tried.
const REPEATED_PIVOTS: usize = 90_000;

/// Objects of map 1 that are pivots even with a repeated object of map 2: all where they are few, else some near the middle as
/// well as some at the rim, where the other map may begin.
fn pivots(problem: &Problem) -> Vec<bool> {
    let count = |repeated: &[bool]| repeated.iter().filter(|r| **r).count();
    let (own, partners) = (count(&problem.repeated1), count(&problem.repeated2));
    let wanted = REPEATED_PIVOTS.div_ceil((partners * problem.p1.len()).max(1));
    let order = central(&problem.p1).into_iter().filter(|&i| problem.repeated1[i]);
    let mut pivots: Vec<bool> = problem.repeated1.iter().map(|r| !r).collect();
    for i in order.step_by(own.div_ceil(wanted).max(1)) {
        pivots[i] = true;
    }
    pivots
}

/// Explanations that differ in their transform, best first.
fn separate_modes(problem: &Problem, rays1: &[Vec<Ray>], rays2: &[Vec<Ray>]) -> Vec<Explanation> {
    let pivots = pivots(problem);
    let may_turn = |i: usize, a: usize| pivots[i] || !problem.repeated2[a];
    let centre = middle(&problem.p2);
    let mut found: Vec<Explanation> = Vec::new();
    let mut refined = 0;
    let mut best_sum = f64::NEG_INFINITY;
    for hypothesis in Hypotheses::new(problem, rays1, rays2, may_turn) {
        // A hypothesis' score is more than its pairs will be worth, so nothing below can come near the best.
        if refined >= problem.params.max_hypotheses || hypothesis.score < best_sum - HOPELESS {
            break;
        }
        let known = found.iter().any(|e| {
            same_mode(problem.params, &centre, &e.map1_from_map2, &hypothesis.map1_from_map2)
                && e.pairs.binary_search(&hypothesis.pivot).is_ok()
        });
        if known {
            continue;
        }
        refined += 1;
        let Some(explanation) = refine(problem, &hypothesis.map1_from_map2) else { continue };
        best_sum = best_sum.max(explanation.pair_sum);
        let twin = found
            .iter()
            .position(|e| same_mode(problem.params, &centre, &e.map1_from_map2, &explanation.map1_from_map2));
        match twin {
            Some(k) if found[k].log_evidence >= explanation.log_evidence => {}
            Some(k) => found[k] = explanation,
            None => found.push(explanation),
        }
    }
    polished(problem, &centre, found)
}

/// Evidence, in nats, behind the best that leaving out wrong pairs may make up for.
const WITHIN_REACH: f64 = 10.0;

/// Explanations, best first, those near the best without their wrong pairs.
fn polished(problem: &Problem, centre: &Point2<f64>, mut found: Vec<Explanation>) -> Vec<Explanation> {
    if problem.repeats() {
        // Which pairs of a structure stand for it is not told by their worth, which counts for little.
        sort(&mut found);
        return found;
    }
    let best = found.iter().map(|e| e.log_evidence).fold(f64::NEG_INFINITY, f64::max);
    let (near, mut rest): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|e| e.log_evidence >= best - WITHIN_REACH);
    let mut near: Vec<Explanation> = near.into_iter().map(|e| polish(problem, e)).collect();
    sort(&mut near);
    sort(&mut rest);
    let mut separate: Vec<Explanation> = Vec::with_capacity(near.len() + rest.len());
    for e in near {
        let same =
            |known: &Explanation| same_mode(problem.params, centre, &known.map1_from_map2, &e.map1_from_map2);
        if !separate.iter().any(same) {
            separate.push(e);
        }
    }
    separate.append(&mut rest);
    separate
}

/// The best first.
fn sort(found: &mut [Explanation]) {
    found.sort_by(|x, y| y.log_evidence.total_cmp(&x.log_evidence));
}

/// Adds to the evidence of explanations, the best first, what the way in which both maps' structures lie tells; of those that it
/// cannot bring near the best it is not asked.
fn favour_one_structure(problem: &Problem, shifts: &[Vector2<f64>], found: &mut [Explanation]) {
    let Some(continuation) = Continuation::new(problem, shifts) else { return };
    let mut best = f64::NEG_INFINITY;
    for explanation in found.iter_mut() {
        let hopeless = explanation.log_evidence + Continuation::MOST < best - WITHIN_REACH;
        explanation.log_evidence += if hopeless { APART } else { continuation.log_odds(explanation) };
        best = best.max(explanation.log_evidence);
    }
    sort(found);
}

pub(super) fn same_mode(
    params: &ConsensusParams,
    centre: &Point2<f64>,
    a: &Isometry2<f64>,
    b: &Isometry2<f64>,
) -> bool {
    (a * centre - b * centre).norm() < params.mode_distance
        && a.rotation.angle_to(&b.rotation).abs() < params.mode_angle
}

/// Weighs the explanations against each other and against chance.
fn judge(problem: &Problem, found: Vec<Explanation>) -> Match {
    let largest = found.first().map_or(0.0, |e| e.log_evidence.max(problem.params.log_odds_nothing));
    let nothing = (problem.params.log_odds_nothing - largest).exp();
    let something: f64 = found.iter().map(|e| (e.log_evidence - largest).exp()).sum();
    let verdict = match found.first() {
        // Repeated structure that fits shows an overlap, though not which.
        Some(best) if best.log_evidence + best.discounted > problem.params.log_odds_nothing => {
            let share = (best.log_evidence - largest).exp() / something;
            // On a map that repeats itself the count of pairs says little; what is left must carry the answer.
            let told = best.distinct_sum >= DISTINCT_PAIRS * problem.place;
            if told && share >= problem.params.unique_probability {
                Verdict::Unique
            } else {
                Verdict::Ambiguous
            }
        }
        _ => Verdict::None,
    };
    let modes = found
        .into_iter()
        .take(problem.params.max_modes)
        .filter_map(|e| mode(problem, e, largest, nothing + something))
        .collect();
    Match::from_modes(modes, verdict)
}

/// Pairs' worth of evidence that a unique answer needs beside repeated structure.
const DISTINCT_PAIRS: f64 = 2.5;

fn mode(problem: &Problem, e: Explanation, largest: f64, total: f64) -> Option<Mode> {
    let covariance = information(&ties(problem, &e.pairs)).try_inverse()?;
    let map1_from_map2 =
        GaussianPose2::new(e.map1_from_map2, 0.5 * (covariance + covariance.transpose())).ok()?;
    let probability = (e.log_evidence - largest).exp() / total;
    let pairs = e.pairs.into_iter().map(|(first, second)| Pair { first, second }).collect();
    Some(Mode { map1_from_map2, pairs, score: e.log_likelihood, probability })
}

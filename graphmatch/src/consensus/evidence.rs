use std::f64::consts::TAU;

use nalgebra::{Isometry2, Point2};

use super::overlap::Overlap;
use super::problem::Problem;
use crate::rigid::{Tie, fit_rigid, information};

/// Pairs that a transform brings together, and the transform fitted to them.
#[derive(Debug, Clone)]
pub(super) struct Explanation {
    pub(super) map1_from_map2: Isometry2<f64>,
    /// Pairs in order of the first index.
    pub(super) pairs: Vec<(usize, usize)>,
    /// Objects in the common area, the mean of both maps' counts, repeated ones by their weight.
    pub(super) inside: f64,
    /// Evidence of the pairs alone.
    pub(super) pair_sum: f64,
    /// Evidence of the pairs that are no repeated structure.
    pub(super) distinct_sum: f64,
    /// What being repeated took off the evidence of the pairs.
    pub(super) discounted: f64,
    /// Logarithm of the likelihood of both maps given the transform, over their likelihood as unrelated maps.
    pub(super) log_likelihood: f64,
    /// The same with the transform unknown beforehand: times prior and width of the peak.
    pub(super) log_evidence: f64,
}

const PASSES: usize = 4;

/// Matches, fits, and matches again from a first guess; `None` if fewer than `min_pairs` fall together.
pub(super) fn refine(problem: &Problem, guess: &Isometry2<f64>) -> Option<Explanation> {
    settle(problem, gather(problem, guess)?)
}

/// The pairs that a first guess brings roughly together; `None` if they are fewer than `min_pairs`.
pub(super) fn gather(problem: &Problem, guess: &Isometry2<f64>) -> Option<Vec<(usize, usize)>> {
    let pairs = matches(problem, guess, 2.0 * problem.params.gate);
    (pairs.len() >= problem.fewest_pairs()).then_some(pairs)
}

/// Fits and matches again from first pairs.
pub(super) fn settle(problem: &Problem, mut pairs: Vec<(usize, usize)>) -> Option<Explanation> {
    let mut transform = fit_rigid(&ties(problem, &pairs));
    for pass in 1..PASSES {
        let next = matches(problem, &transform, problem.params.gate);
        if next.len() < problem.fewest_pairs() {
            return None;
        }
        if pass > 1 && next == pairs {
            break;
        }
        pairs = next;
        transform = fit_rigid(&ties(problem, &pairs));
    }
    let found = weigh(problem, transform, pairs)?;
    Some(match without_strays(problem, &found) {
        Some(other) if other.log_evidence > found.log_evidence => other,
        _ => found,
    })
}

/// The same without the pairs at the rim of the gate: one that is wrong bends the fit so that it stays within.
fn without_strays(problem: &Problem, found: &Explanation) -> Option<Explanation> {
    let near = |transform: &Isometry2<f64>, (i, a): (usize, usize)| {
        (problem.p1[i] - transform * problem.p2[a]).norm_squared() / problem.variance(i, a) <= STRAY_CHI2
    };
    let core: Vec<(usize, usize)> =
        found.pairs.iter().copied().filter(|&pair| near(&found.map1_from_map2, pair)).collect();
    if core.len() == found.pairs.len() || core.len() < problem.fewest_pairs() {
        return None;
    }
    let transform = fit_rigid(&ties(problem, &core));
    let pairs = matches(problem, &transform, problem.params.gate);
    if pairs.len() < problem.fewest_pairs() {
        return None;
    }
    let transform = fit_rigid(&ties(problem, &pairs));
    weigh(problem, transform, pairs)
}

/// 95 % of χ² with 2 degrees.
const STRAY_CHI2: f64 = 5.99;

/// One-to-one pairs within `gate` standard deviations under `transform`, the best pair first come.
pub(super) fn matches(problem: &Problem, transform: &Isometry2<f64>, gate: f64) -> Vec<(usize, usize)> {
    let mut close = Vec::with_capacity(2 * problem.p2.len());
    let mut partner = vec![None; problem.p1.len()];
    let mut rivals = false;
    for (a, p) in problem.p2.iter().enumerate() {
        let moved = transform * p;
        let first = close.len();
        problem.buckets.around(&moved, |i| {
            let chi2 = (problem.p1[i] - moved).norm_squared() / problem.variance(i, a);
            let gain = problem.gain(i, a);
            if (chi2 <= gate * gate || chi2 <= farther(problem, i, a)) && gain > f64::NEG_INFINITY {
                close.push((gain - 0.5 * chi2, i, a));
                rivals |= partner[i].replace(a).is_some();
            }
        });
        rivals |= close.len() > first + 1;
    }
    if rivals {
        best_first(&mut close, &mut partner, problem.p2.len());
    }
    let mut pairs = Vec::with_capacity(close.len());
    pairs.extend(partner.iter().enumerate().filter_map(|(i, a)| Some((i, (*a)?))));
    pairs
}

/// Partners of map 1's objects, one to one, among pairs with what they are worth.
fn best_first(close: &mut [(f64, usize, usize)], partner: &mut [Option<usize>], others: usize) {
    close.sort_unstable_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    partner.fill(None);
    let mut used = vec![false; others];
    for &mut (_, i, a) in close {
        if partner[i].is_none() && !used[a] {
            partner[i] = Some(a);
            used[a] = true;
        }
    }
}

/// χ² up to which a pair's looks make up for its distance, within what the buckets reach.
fn farther(problem: &Problem, i: usize, a: usize) -> f64 {
    (2.0 * problem.looks(i, a)).min((2.0 * problem.params.gate).powi(2))
}

pub(super) fn ties(problem: &Problem, pairs: &[(usize, usize)]) -> Vec<Tie> {
    pairs
        .iter()
        .map(|&(i, a)| Tie {
            first: problem.p1[i],
            second: problem.p2[a],
            weight: problem.variance(i, a).recip(),
        })
        .collect()
}

/// Pairs' worth of a repeated structure that falls together. As many as it takes to pin a transform: which shift
/// of the structure it is, no number of such pairs can tell.
pub(super) const ONCE: f64 = 2.0;

/// Pairs as ties, repeated ones by their share of [`ONCE`].
pub(super) fn weigh_repeated(problem: &Problem, pairs: &[(usize, usize)]) -> Vec<Tie> {
    let repeated = pairs.iter().filter(|&&(i, a)| problem.is_repeated(i, a)).count();
    let weight = (ONCE / repeated as f64).min(1.0);
    let mut weighed = ties(problem, pairs);
    for (tie, &(i, a)) in weighed.iter_mut().zip(pairs) {
        tie.weight *= if problem.is_repeated(i, a) { weight } else { 1.0 };
    }
    weighed
}

pub(super) fn weigh(
    problem: &Problem,
    transform: Isometry2<f64>,
    pairs: Vec<(usize, usize)>,
) -> Option<Explanation> {
    let (mut distinct_sum, mut repeated_sum, mut repeated) = (0.0, 0.0, 0);
    for &(i, a) in &pairs {
        let distance_sq = (problem.p1[i] - transform * problem.p2[a]).norm_squared();
        let worth = problem.gain(i, a) - 0.5 * distance_sq / problem.variance(i, a);
        if problem.is_repeated(i, a) {
            repeated_sum += worth;
            repeated += 1;
        } else {
            distinct_sum += worth;
        }
    }
    let weight = (ONCE / f64::from(repeated)).min(1.0);
    let pair_sum = distinct_sum + weight * repeated_sum;
    if pair_sum < problem.least_sum(pairs.len()) {
        return None;
    }
    let overlap = Overlap::new(problem, &transform, &pairs);
    let log_likelihood = pair_sum + overlap.log_likelihood;
    // The peak is that of the likelihood as weighed.
    let determinant = information(&weigh_repeated(problem, &pairs)).determinant();
    if !(determinant.is_finite() && determinant > 0.0) {
        return None;
    }
    let peak = 1.5 * TAU.ln() - 0.5 * determinant.ln();
    let log_evidence = log_likelihood + peak + overlap.log_prior;
    let discounted = (1.0 - weight) * repeated_sum;
    Some(Explanation {
        map1_from_map2: transform,
        pairs,
        inside: overlap.inside,
        pair_sum,
        distinct_sum,
        discounted,
        log_likelihood,
        log_evidence,
    })
}

/// Middle of a set of points.
pub(super) fn middle(points: &[Point2<f64>]) -> Point2<f64> {
    let sum = points.iter().fold(nalgebra::Vector2::zeros(), |sum, p| sum + p.coords);
    Point2::from(sum / points.len().max(1) as f64)
}

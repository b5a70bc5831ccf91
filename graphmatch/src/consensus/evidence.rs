use nalgebra::{Isometry2, Point2};

use super::problem::Problem;
use crate::rigid::{Tie, fit_rigid, information};

/// Pairs that a transform brings together, and the transform fitted to them.
#[derive(Debug, Clone)]
pub(super) struct Explanation {
    pub(super) map1_from_map2: Isometry2<f64>,
    /// Pairs in order of the first index.
    pub(super) pairs: Vec<(usize, usize)>,
    /// Logarithm of the likelihood of both maps given the transform, over their likelihood as unrelated maps.
    pub(super) log_likelihood: f64,
    /// The same with the transform unknown beforehand: times prior and width of the peak.
    pub(super) log_evidence: f64,
}

const PASSES: usize = 4;

/// Matches, fits, and matches again from a first guess; `None` if fewer than `min_pairs` fall together.
pub(super) fn refine(problem: &Problem, guess: &Isometry2<f64>) -> Option<Explanation> {
    let mut transform = *guess;
    let mut pairs = Vec::new();
    for pass in 0..PASSES {
        let gate = problem.params.gate * if pass == 0 { 2.0 } else { 1.0 };
        let next = matches(problem, &transform, gate);
        if next.len() < problem.params.min_pairs {
            return None;
        }
        if pass > 1 && next == pairs {
            break;
        }
        pairs = next;
        transform = fit_rigid(&ties(problem, &pairs));
    }
    weigh(problem, transform, pairs)
}

/// One-to-one pairs within `gate` standard deviations under `transform`, the best pair first come.
fn matches(problem: &Problem, transform: &Isometry2<f64>, gate: f64) -> Vec<(usize, usize)> {
    let mut close = Vec::new();
    for (a, p) in problem.p2.iter().enumerate() {
        let moved = transform * p;
        problem.buckets.around(&moved, |i| {
            let chi2 = (problem.p1[i] - moved).norm_squared() / problem.variance(i, a);
            let gain = problem.gain(i, a);
            if chi2 <= gate * gate && gain > f64::NEG_INFINITY {
                close.push((gain - 0.5 * chi2, i, a));
            }
        });
    }
    close.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let (mut used1, mut used2) = (vec![false; problem.p1.len()], vec![false; problem.p2.len()]);
    let mut pairs = Vec::with_capacity(close.len());
    for (_, i, a) in close {
        if !used1[i] && !used2[a] {
            used1[i] = true;
            used2[a] = true;
            pairs.push((i, a));
        }
    }
    pairs.sort_unstable();
    pairs
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

fn weigh(problem: &Problem, transform: Isometry2<f64>, pairs: Vec<(usize, usize)>) -> Option<Explanation> {
    let pair_sum: f64 = pairs
        .iter()
        .map(|&(i, a)| {
            let distance_sq = (problem.p1[i] - transform * problem.p2[a]).norm_squared();
            problem.gain(i, a) - 0.5 * distance_sq / problem.variance(i, a)
        })
        .sum();
    let log_likelihood = pair_sum + log_detection(problem, &transform, pairs.len());
    let information = information(&ties(problem, &pairs));
    let determinant = information.determinant();
    if !(determinant.is_finite() && determinant > 0.0) {
        return None;
    }
    let peak = 1.5 * std::f64::consts::TAU.ln() - 0.5 * determinant.ln();
    let side = problem.window1.area.sqrt() + problem.window2.area.sqrt();
    let log_prior = -(std::f64::consts::TAU * side * side).ln();
    let log_evidence = log_likelihood + peak + log_prior;
    Some(Explanation { map1_from_map2: transform, pairs, log_likelihood, log_evidence })
}

/// What the unmatched objects say: with detection probability q, uniform on 0 … 1, of a shared object
///
/// ```text
/// log ∫ exp(q Λ) q^k (1 − q)^(m₁ + m₂ − 2k) dq
/// ```
///
/// where m₁, m₂ objects lie in the area that both maps cover, k of them are paired, and Λ = (m₁ + m₂)/2: the
/// ratio of a Poisson field thinned to the common objects over two independent fields of the same density.
fn log_detection(problem: &Problem, transform: &Isometry2<f64>, paired: usize) -> f64 {
    let inverse = transform.inverse();
    let inside1 = problem.p1.iter().filter(|p| problem.window2.contains(&(inverse * **p))).count();
    let inside2 = problem.p2.iter().filter(|p| problem.window1.contains(&(transform * **p))).count();
    log_detection_of(inside1.max(paired), inside2.max(paired), paired)
}

fn log_detection_of(m1: usize, m2: usize, k: usize) -> f64 {
    const STEPS: usize = 48;
    let (k, lone, mean) = (k as f64, (m1 + m2 - 2 * k) as f64, 0.5 * (m1 + m2) as f64);
    let value = |step: usize| {
        let q = (step as f64 + 0.5) / STEPS as f64;
        mean * q + k * q.ln() + lone * (-q).ln_1p()
    };
    let largest = (0..STEPS).map(value).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = (0..STEPS).map(|step| (value(step) - largest).exp()).sum();
    largest + (sum / STEPS as f64).ln()
}

/// Middle of a set of points.
pub(super) fn middle(points: &[Point2<f64>]) -> Point2<f64> {
    let sum = points.iter().fold(nalgebra::Vector2::zeros(), |sum, p| sum + p.coords);
    Point2::from(sum / points.len().max(1) as f64)
}

use std::f64::consts::TAU;
use std::sync::LazyLock;

use nalgebra::{Isometry2, Point2};

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
    let common = Common::new(problem, &transform, &pairs);
    let inside = 0.5 * (common.inside1 + common.inside2);
    let log_likelihood = pair_sum + log_detection(common.inside1 + common.inside2, common.paired);
    // The peak is that of the likelihood as weighed.
    let determinant = information(&weigh_repeated(problem, &pairs)).determinant();
    if !(determinant.is_finite() && determinant > 0.0) {
        return None;
    }
    let peak = 1.5 * TAU.ln() - 0.5 * determinant.ln();
    let log_evidence = log_likelihood + peak + log_prior(problem, &transform, common.share);
    let discounted = (1.0 - weight) * repeated_sum;
    Some(Explanation {
        map1_from_map2: transform,
        pairs,
        inside,
        pair_sum,
        distinct_sum,
        discounted,
        log_likelihood,
        log_evidence,
    })
}

/// Objects in the area that both maps cover. A map's repeated ones count for [`ONCE`] together, as their pairs do: which shift of
/// a structure it is, neither its overlap nor its missing members can tell.
struct Common {
    inside1: f64,
    inside2: f64,
    paired: f64,
    /// Share of all objects that lie in the common area.
    share: f64,
}

impl Common {
    fn new(problem: &Problem, transform: &Isometry2<f64>, pairs: &[(usize, usize)]) -> Self {
        let inverse = transform.inverse();
        let mut inside1: Vec<bool> =
            problem.p1.iter().map(|p| problem.window2.contains(&(inverse * p))).collect();
        let mut inside2: Vec<bool> =
            problem.p2.iter().map(|p| problem.window1.contains(&(transform * p))).collect();
        // A pair at the rim may have an end outside.
        for &(i, a) in pairs {
            inside1[i] = true;
            inside2[a] = true;
        }
        let (weights1, weights2) = (Weights::new(&problem.repeated1), Weights::new(&problem.repeated2));
        let of_pair = |&(i, a): &(usize, usize)| 0.5 * (weights1.of(i) + weights2.of(a));
        let (count1, count2) = (weights1.sum(|i| inside1[i]), weights2.sum(|a| inside2[a]));
        Self {
            inside1: count1,
            inside2: count2,
            paired: pairs.iter().map(of_pair).sum(),
            share: 0.5 * (count1 / weights1.sum(|_| true) + count2 / weights2.sum(|_| true)),
        }
    }
}

/// What each object of a map counts for.
struct Weights<'a> {
    repeated: &'a [bool],
    weight: f64,
}

impl<'a> Weights<'a> {
    fn new(repeated: &'a [bool]) -> Self {
        let all = repeated.iter().filter(|r| **r).count() as f64;
        Self { repeated, weight: (ONCE / all).min(1.0) }
    }

    fn of(&self, object: usize) -> f64 {
        if self.repeated[object] { self.weight } else { 1.0 }
    }

    fn sum(&self, counts: impl Fn(usize) -> bool) -> f64 {
        (0..self.repeated.len()).filter(|&k| counts(k)).map(|k| self.of(k)).sum()
    }
}

/// Density of the transform before looking at the objects: any angle; as likely as not both robots were sent over one area, else
/// any overlap is as likely as any other.
///
/// ```text
/// 1 / (2π s²) · ( ½ / (−ln f) + ½ (s / σ)² exp(−d² / 2σ²) / 2π )
/// ```
/// where s is the sum of both areas' sides, f the share of the objects in the common area, d the distance of the areas' middles
/// and σ what this distance is known to; the second term only where no map repeats itself.
/// Poses spread evenly over the plane would overlap by a share f with density −ln f (two squares), mostly hardly at
/// all; robots that compare maps were not dropped at random, so poses are weighed by 1/(−ln f).
fn log_prior(problem: &Problem, transform: &Isometry2<f64>, share: f64) -> f64 {
    let (window1, window2) = (&problem.window1, &problem.window2);
    let sides = window1.area.sqrt() + window2.area.sqrt();
    let objects = [window1, window2].map(|w| (w.objects.max(1) as f64).recip()).iter().sum::<f64>();
    let scatter = SAME_AREA.powi(2) + HULL_CENTRE.powi(2) * objects;
    let variance = 0.25 * sides * sides * scatter;
    let apart = (window1.centre - transform * window2.centre).norm_squared();
    let same = sides * sides / (TAU * variance) * (-0.5 * apart / variance).exp();
    let partly = (-share.min(0.95).ln()).recip();
    // A map that repeats itself is a stretch of something longer: where its middle lies tells nothing.
    let one_area = if problem.repeats() { 0.0 } else { 0.5 };
    -(TAU * sides * sides).ln() + ((1.0 - one_area) * partly + one_area * same).ln()
}

/// Standard deviation of the middle of an area from where a robot is sent, in sides of the area.
const SAME_AREA: f64 = 0.03;
/// Standard deviation of a coordinate of the centre of the hull of n points spread over a square, in sides over √n.
const HULL_CENTRE: f64 = 0.15;

/// What the unmatched objects say: with detection probability q, uniform on 0 … 1, of a shared object
///
/// ```text
/// log ∫ exp(q Λ) q^k (1 − q)^(m₁ + m₂ − 2k) dq
/// ```
///
/// where m₁, m₂ objects lie in the area that both maps cover, k of them are paired, and Λ = (m₁ + m₂)/2: the
/// ratio of a Poisson field thinned to the common objects over two independent fields of the same density.
fn log_detection(inside: f64, paired: f64) -> f64 {
    let (lone, mean) = ((inside - 2.0 * paired).max(0.0), 0.5 * inside);
    let values = DETECTION.map(|[q, log_q, log_rest]| mean * q + paired * log_q + lone * log_rest);
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = values.iter().map(|value| (value - largest).exp()).sum();
    largest + (sum / STEPS as f64).ln()
}

const STEPS: usize = 32;
/// q, log q and log(1 − q) at the middles of equal steps.
static DETECTION: LazyLock<[[f64; 3]; STEPS]> = LazyLock::new(|| {
    std::array::from_fn(|step| {
        let q = (step as f64 + 0.5) / STEPS as f64;
        [q, q.ln(), (-q).ln_1p()]
    })
});

/// Middle of a set of points.
pub(super) fn middle(points: &[Point2<f64>]) -> Point2<f64> {
    let sum = points.iter().fold(nalgebra::Vector2::zeros(), |sum, p| sum + p.coords);
    Point2::from(sum / points.len().max(1) as f64)
}

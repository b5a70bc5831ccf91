use std::f64::consts::TAU;
use std::sync::LazyLock;

use nalgebra::Isometry2;

use super::evidence::ONCE;
use super::problem::Problem;

/// What a transform tells by the way in which it lays the areas of both maps.
pub(super) struct Overlap {
    /// Objects in the common area, the mean of both maps' counts, repeated ones by their weight.
    pub(super) inside: f64,
    /// Likelihood of the objects left unpaired, over that of unrelated maps.
    pub(super) log_likelihood: f64,
    /// Density of the transform before looking at the objects.
    pub(super) log_prior: f64,
}

impl Overlap {
    /// Either both robots were sent over one area, with probability w, or their areas overlap in part; any angle is as likely as any
    /// other.
    ///
    /// ```text
    /// 1 / (2π s²) · ( (1 − w) 2 (1 − f) / (−ln f) + w (s / σ)² exp(−d² / 2σ²) / 2π )
    /// ```
    /// where s is the sum of both areas' sides, f the share of the objects in the common area, d the distance of the areas' middles
    /// and σ what this distance is known to. In one area all objects could have been paired, else those in the common area.
    /// Poses spread evenly over the plane would overlap by a share f with density −ln f (two squares), mostly hardly at all;
    /// robots that compare maps were not dropped at random, so poses are weighed by 1/(−ln f), and by 2 (1 − f), as areas that
    /// differ do not nearly coincide. A map that repeats itself is a stretch of something longer: where its middle lies tells
    /// nothing, and any overlap is as likely as any other.
    pub(super) fn new(problem: &Problem, transform: &Isometry2<f64>, pairs: &[(usize, usize)]) -> Self {
        let common = Common::new(problem, transform, pairs);
        let inside = common.inside1 + common.inside2;
        let sides = problem.window1.area.sqrt() + problem.window2.area.sqrt();
        let flat = -(TAU * sides * sides).ln();
        let share = common.share.min(0.95);
        let any = (-share.ln()).recip();
        let in_part = log_detection(inside, common.paired);
        let inside = 0.5 * inside;
        if problem.repeats() {
            return Self { inside, log_likelihood: in_part, log_prior: flat + any.ln() };
        }
        let part = (1.0 - problem.params.one_area) * 2.0 * (1.0 - share) * any;
        let whole = problem.params.one_area * middles_agree(problem, transform);
        let in_whole = log_detection((problem.p1.len() + problem.p2.len()) as f64, common.paired);
        let most = in_part.max(in_whole);
        let joint = part * (in_part - most).exp() + whole * (in_whole - most).exp();
        let log_likelihood = most + (joint / (part + whole)).ln();
        Self { inside, log_likelihood, log_prior: flat + (part + whole).ln() }
    }
}

/// How much likelier than one spread over s² the distance of the areas' middles is if both areas are one.
fn middles_agree(problem: &Problem, transform: &Isometry2<f64>) -> f64 {
    let (window1, window2) = (&problem.window1, &problem.window2);
    let sides_sq = (window1.area.sqrt() + window2.area.sqrt()).powi(2);
    let objects = [window1, window2].map(|w| (w.objects.max(1) as f64).recip()).iter().sum::<f64>();
    let variance = 0.25 * sides_sq * (SAME_AREA.powi(2) + HULL_CENTRE.powi(2) * objects);
    let apart_sq = (window1.centre - transform * window2.centre).norm_squared();
    sides_sq / (TAU * variance) * (-0.5 * apart_sq / variance).exp()
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

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};

    use super::*;
    use crate::{ConsensusParams, NoSimilarity, Object};

    #[test]
    fn prior_sums_to_one_over_all_transforms() {
        // A square so full that shares of objects are shares of areas.
        let square: Vec<Object> = (0..400)
            .map(|k| Object::new(Point2::new((k % 20) as f64, f64::from(k / 20)), 1.0, 1.0))
            .collect();
        let params = ConsensusParams::default();
        let problem = Problem::new(&square, &square, &NoSimilarity, &params);
        let step = 0.4;
        let mut sum = 0.0;
        for x in -60..=60 {
            for y in -60..=60 {
                // Every angle would give as much, but for corners.
                let transform = Isometry2::new(step * Vector2::new(f64::from(x), f64::from(y)), 0.0);
                let density = Overlap::new(&problem, &transform, &[]).log_prior.exp();
                sum += TAU * step * step * density;
            }
        }
        assert!((sum - 1.0).abs() < 0.05, "{sum}");
    }

    #[test]
    fn lone_objects_speak_against_a_transform() {
        let all_seen = log_detection(8.0, 4.0);
        let half_seen = log_detection(16.0, 4.0);
        let hardly_seen = log_detection(40.0, 4.0);
        assert!(all_seen > half_seen && half_seen > hardly_seen, "{all_seen} {half_seen} {hardly_seen}");
    }
}

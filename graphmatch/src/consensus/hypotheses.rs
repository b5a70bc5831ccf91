use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Point2, UnitComplex};

use super::evidence::ONCE;
use super::problem::Problem;

/// A transform that turns about one assumed pair so that as much as possible else falls together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub(super) score: f64,
    pub(super) pivot: (usize, usize),
    pub(super) map1_from_map2: Isometry2<f64>,
}

/// One other object of a map as seen from an object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    distance: f64,
    angle: f64,
    object: usize,
}

/// The best turn about every admissible pair that may be a pivot, best first.
///
/// For each pair (i, a) taken as the pivot, each other pair (j, b) of equal distance from the pivot votes for the
/// turn that brings b onto j, with a width that its noise allows; the turn with the largest sum of votes wins.
/// Cost O(N M k) for k votes a pivot. Repeated pairs have most of the votes and together count for little: they are counted only
/// once a pivot's distinct votes, with all that repeated ones can add, make it the best of those left.
pub(super) struct Hypotheses<'a> {
    problem: &'a Problem<'a>,
    rays1: &'a [Vec<Ray>],
    rays2: &'a [Vec<Ray>],
    votes: Votes,
    left: BinaryHeap<Candidate>,
}

impl<'a> Hypotheses<'a> {
    /// * `rays1`, `rays2` – [`rays`] of both maps; `may_turn` – which pairs, by their indices, are taken as pivots.
    pub(super) fn new(
        problem: &'a Problem<'a>,
        rays1: &'a [Vec<Ray>],
        rays2: &'a [Vec<Ray>],
        may_turn: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let longest = rays1.iter().filter_map(|r| r.last()).map(|r| r.distance).fold(0.0, f64::max);
        let mut votes = Votes::new(problem, longest);
        let repeats = problem.repeats();
        let distinct2: Vec<Vec<Ray>> = rays2.iter().map(|rays| distinct(rays, &problem.repeated2)).collect();
        let mut left = Vec::new();
        for (i, from1) in rays1.iter().enumerate() {
            let distinct1 = distinct(from1, &problem.repeated1);
            for (a, from2) in distinct2.iter().enumerate() {
                let pivot = (i, a);
                if problem.gain(i, a) == f64::NEG_INFINITY || !may_turn(i, a) {
                    continue;
                }
                votes.collect(problem, pivot, &distinct1, from2);
                if repeats {
                    left.push(Candidate { score: votes.bound(problem, pivot), angle: None, pivot });
                } else if let Some((score, angle)) = votes.best(problem, pivot) {
                    left.push(Candidate { score, angle: Some(angle), pivot });
                }
            }
        }
        Self { problem, rays1, rays2, votes, left: left.into() }
    }
}

impl Iterator for Hypotheses<'_> {
    type Item = Hypothesis;

    fn next(&mut self) -> Option<Hypothesis> {
        loop {
            let Candidate { score, angle, pivot } = self.left.pop()?;
            let (i, a) = pivot;
            if let Some(angle) = angle {
                let rotation = UnitComplex::new(angle);
                let translation = self.problem.p1[i].coords - rotation * self.problem.p2[a].coords;
                let map1_from_map2 = Isometry2::from_parts(translation.into(), rotation);
                return Some(Hypothesis { score, pivot, map1_from_map2 });
            }
            self.votes.collect(self.problem, pivot, &self.rays1[i], &self.rays2[a]);
            if let Some((score, angle)) = self.votes.best(self.problem, pivot) {
                self.left.push(Candidate { score, angle: Some(angle), pivot });
            }
        }
    }
}

/// A pivot with the angle of its best turn and this turn's score; without an angle, all votes are not counted yet and the score is
/// more than it can be.
struct Candidate {
    score: f64,
    angle: Option<f64>,
    pivot: (usize, usize),
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.score.total_cmp(&other.score).then_with(|| other.pivot.cmp(&self.pivot))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

/// The rays to objects that are not repeated.
fn distinct(rays: &[Ray], repeated: &[bool]) -> Vec<Ray> {
    rays.iter().filter(|ray| !repeated[ray.object]).copied().collect()
}

/// The other objects of a map as seen from each of them, nearest first, but for those nearer than `shortest`.
pub(super) fn rays(points: &[Point2<f64>], shortest: f64) -> Vec<Vec<Ray>> {
    points
        .iter()
        .map(|p| {
            let mut rays: Vec<Ray> = points
                .iter()
                .enumerate()
                .map(|(object, q)| (object, q - p, (q - p).norm()))
                .filter(|(_, _, distance)| *distance >= shortest)
                .map(|(object, d, distance)| Ray { distance, angle: d.y.atan2(d.x), object })
                .collect();
            rays.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.object.cmp(&b.object)));
            rays
        })
        .collect()
}

/// Sums of votes for every turn, as their changes from bin to bin: those of repeated pairs apart, because all of them
/// together count for a few.
struct Votes {
    distinct: Vec<f64>,
    repeated: Vec<f64>,
    any_repeated: bool,
    /// A bit for each bin with a change.
    touched: Vec<u64>,
}

impl Votes {
    /// As many bins as the narrowest vote, of the longest edge, asks for; a first pass of a refinement looks
    /// further than a bin is wide.
    fn new(problem: &Problem, longest: f64) -> Self {
        let narrowest = problem.params.gate * problem.largest_sigma / longest.max(1e-9);
        let bins = ((TAU / narrowest).min(1024.0) as usize).next_power_of_two().clamp(64, 1024);
        Self {
            distinct: vec![0.0; bins],
            repeated: vec![0.0; bins],
            any_repeated: false,
            touched: vec![0; bins.div_ceil(64)],
        }
    }

    fn clear(&mut self) {
        for k in set_bits(&self.touched) {
            self.distinct[k] = 0.0;
            self.repeated[k] = 0.0;
        }
        self.touched.fill(0);
        self.any_repeated = false;
    }

    fn collect(&mut self, problem: &Problem, (i, a): (usize, usize), from1: &[Ray], from2: &[Ray]) {
        self.clear();
        let cut = problem.params.gate * std::f64::consts::SQRT_2 * problem.largest_sigma;
        let own_variance = problem.variance(i, a);
        // Votes over the circle's end begin once more at bin 0. Summed apart: in place, each would wait for the last.
        let mut around_end = [0.0; 2];
        // Most pairs are as accurate as the last.
        let (mut known_variance, mut deviation) = (0.0, 0.0);
        let mut low = 0;
        for ray1 in from1 {
            while low < from2.len() && from2[low].distance < ray1.distance - cut {
                low += 1;
            }
            let (gains, variances) = problem.row(ray1.object);
            let repeated1 = problem.repeated1[ray1.object];
            let per_deviation = 2.0 / ray1.distance;
            for ray2 in from2[low..].iter().take_while(|ray2| ray2.distance <= ray1.distance + cut) {
                let gain = gains[ray2.object];
                if gain <= 0.0 {
                    continue;
                }
                // The difference of two edges of equal pairs has the variance of both their ends.
                let variance = own_variance + variances[ray2.object];
                let difference = ray1.distance - ray2.distance;
                let weight = gain - 0.5 * difference * difference / variance;
                if weight > 0.0 {
                    // Two standard deviations: wider votes make more turns look alike than right ones gain.
                    if variance != known_variance {
                        (known_variance, deviation) = (variance, variance.sqrt());
                    }
                    let half_width = (per_deviation * deviation).min(0.5 * PI);
                    let repeated = repeated1 || problem.repeated2[ray2.object];
                    self.any_repeated |= repeated;
                    let changes = if repeated { &mut self.repeated } else { &mut self.distinct };
                    let [from, to] = vote(changes.len(), ray1.angle - ray2.angle, half_width);
                    changes[from] += weight;
                    changes[to] -= weight;
                    self.touched[from / 64] |= 1 << (from % 64);
                    self.touched[to / 64] |= 1 << (to % 64);
                    around_end[usize::from(repeated)] += if to < from { weight } else { 0.0 };
                }
            }
        }
        self.distinct[0] += around_end[0];
        self.repeated[0] += around_end[1];
        self.touched[0] |= 1;
    }

    /// Largest sum, that of the pivot included, and its turn; `None` without votes.
    fn best(&self, problem: &Problem, (i, a): (usize, usize)) -> Option<(f64, f64)> {
        let bins = self.distinct.len();
        if !self.any_repeated {
            let (votes, angle) = self.distinct_peak()?;
            return Some((votes + problem.gain(i, a), angle));
        }
        let most = ONCE * problem.place;
        let (own_distinct, own_repeated) = own(problem, (i, a));
        let (mut distinct, mut repeated, mut last) = (0.0, 0.0, 0.0);
        let sums = set_bits(&self.touched).map(|k| {
            distinct += self.distinct[k];
            repeated += self.repeated[k];
            let sum = distinct + (own_repeated + repeated).min(most.max(own_repeated));
            let change = sum - last;
            last = sum;
            (k, change)
        });
        let (sum, angle) = peak(bins, sums)?;
        Some((sum + own_distinct, angle))
    }

    /// More than the sum can be when repeated pairs vote as well.
    fn bound(&self, problem: &Problem, pivot: (usize, usize)) -> f64 {
        let (own_distinct, own_repeated) = own(problem, pivot);
        let votes = self.distinct_peak().map_or(0.0, |(votes, _)| votes);
        votes + own_distinct + (ONCE * problem.place).max(own_repeated) + ROUNDING
    }

    fn distinct_peak(&self) -> Option<(f64, f64)> {
        peak(self.distinct.len(), set_bits(&self.touched).map(|k| (k, self.distinct[k])))
    }
}

/// More than sums of votes are rounded by.
const ROUNDING: f64 = 1e-6;

/// What the pivot itself is worth, as a distinct pair and as a repeated one.
fn own(problem: &Problem, (i, a): (usize, usize)) -> (f64, f64) {
    let gain = problem.gain(i, a);
    if problem.is_repeated(i, a) { (0.0, gain) } else { (gain, 0.0) }
}

/// Bins where a vote for the turns about `angle` begins and ends, on a circle of `bins`, a power of two. If it ends before it
/// begins, it also holds from bin 0.
#[inline]
fn vote(bins: usize, angle: f64, half_width: f64) -> [usize; 2] {
    let scale = bins as f64 / TAU;
    // Angles lie in (-2π, 2π) and widths below π/2: three turns up makes all positive.
    let bin = |x: f64| ((x + 3.0 * TAU) * scale) as u32 as usize & (bins - 1);
    [bin(angle - half_width), (bin(angle + half_width) + 1) & (bins - 1)]
}

/// Largest running sum of changes over a circle and the turn in the middle of where it holds; `None` if it is not
/// above 0.
///
/// * `changes` – of the bins that have one, in order.
fn peak(bins: usize, changes: impl Iterator<Item = (usize, f64)>) -> Option<(f64, f64)> {
    let (mut sum, mut best, mut from, mut to) = (0.0, 0.0, 0, None);
    for (k, change) in changes {
        sum += change;
        if sum > best + 1e-9 {
            (best, from, to) = (sum, k, None);
        } else if to.is_none() && sum < best - 1e-9 {
            to = Some(k);
        }
    }
    let middle = 0.5 * (from + to.unwrap_or(bins)) as f64 * TAU / bins as f64;
    (best > 0.0).then_some((best, middle))
}

/// Indices of the bits that are set, ascending.
fn set_bits(words: &[u64]) -> impl Iterator<Item = usize> + '_ {
    words.iter().enumerate().flat_map(|(number, &word)| {
        std::iter::successors((word != 0).then_some(word), |left| {
            let left = left & (left - 1);
            (left != 0).then_some(left)
        })
        .map(move |left| number * 64 + left.trailing_zeros() as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_that_are_set_come_in_order() {
        let words = [0b1001, 0, 1 << 63, 1];
        assert_eq!(set_bits(&words).collect::<Vec<_>>(), [0, 3, 191, 192]);
    }

    #[test]
    fn peak_is_where_most_votes_overlap() {
        // Turns from -0.1 to 0.1 (around the circle's end) and from 0.0 to 0.2: both hold from 0.0 to 0.1.
        let bins = 1024;
        let mut changes = vec![0.0; bins];
        for (at, weight) in [(0.0, 2.0), (0.1, 3.0)] {
            let [from, to] = vote(bins, at, 0.1);
            changes[from] += weight;
            changes[to] -= weight;
            changes[0] += if to < from { weight } else { 0.0 };
        }
        let (votes, angle) = peak(bins, changes.into_iter().enumerate()).unwrap();
        assert_eq!(votes, 5.0);
        assert!((angle - 0.05).abs() < TAU / bins as f64, "{angle}");
    }
}

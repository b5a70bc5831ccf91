use nalgebra::{Isometry2, Point2, UnitComplex, Vector2};
use std::f64::consts::{PI, TAU};

use super::problem::Problem;

/// A transform that turns about one assumed pair so that as much as possible else falls together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub(super) score: f64,
    pub(super) pivot: (usize, usize),
    pub(super) map1_from_map2: Isometry2<f64>,
}

/// The other objects of a map as seen from one of them, nearest first.
struct Ray {
    distance: f64,
    angle: f64,
    object: usize,
}

/// The best turn about every admissible pair whose first object is among `pivots`, best first.
///
/// For each pair (i, a) taken as the pivot, each other pair (j, b) of equal distance from the pivot votes for the
/// turn that brings b onto j, with a width that its noise allows; the turn with the largest sum of votes wins.
/// Cost O(N M k) for k votes a pivot.
pub(super) fn hypotheses(problem: &Problem, pivots: impl Iterator<Item = usize>) -> Vec<Hypothesis> {
    let rays1 = rays(&problem.p1, problem.params.min_edge);
    let rays2 = rays(&problem.p2, problem.params.min_edge);
    let longest = rays1.iter().filter_map(|r| r.last()).map(|r| r.distance).fold(0.0, f64::max);
    let mut votes = Votes::new(problem, longest);
    let mut found = Vec::new();
    for i in pivots {
        for (a, from2) in rays2.iter().enumerate() {
            if problem.gain(i, a) == f64::NEG_INFINITY {
                continue;
            }
            votes.collect(problem, (i, a), &rays1[i], from2);
            if let Some((score, angle)) = votes.best() {
                let rotation = UnitComplex::new(angle);
                let translation = problem.p1[i].coords - rotation * problem.p2[a].coords;
                found.push(Hypothesis {
                    score: score + problem.worth(i, a, 0.0),
                    pivot: (i, a),
                    map1_from_map2: Isometry2::from_parts(translation.into(), rotation),
                });
            }
        }
    }
    found.sort_by(|x, y| y.score.total_cmp(&x.score));
    found
}

fn rays(points: &[Point2<f64>], shortest: f64) -> Vec<Vec<Ray>> {
    points
        .iter()
        .map(|p| {
            let mut rays: Vec<Ray> = points
                .iter()
                .enumerate()
                .map(|(object, q)| (object, q - p))
                .filter(|(_, d): &(usize, Vector2<f64>)| d.norm() >= shortest)
                .map(|(object, d)| Ray { distance: d.norm(), angle: d.y.atan2(d.x), object })
                .collect();
            rays.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.object.cmp(&b.object)));
            rays
        })
        .collect()
}

/// Sum of votes for every turn, as its changes from bin to bin.
struct Votes {
    changes: Vec<f64>,
}

impl Votes {
    /// As many bins as the narrowest vote, of the longest edge, asks for; a first pass of a refinement looks
    /// further than a bin is wide.
    fn new(problem: &Problem, longest: f64) -> Self {
        let narrowest = problem.params.gate * problem.largest_sigma / longest.max(1e-9);
        let bins = ((TAU / narrowest).min(1024.0) as usize).next_power_of_two().clamp(64, 1024);
        Self { changes: vec![0.0; bins] }
    }

    fn collect(&mut self, problem: &Problem, (i, a): (usize, usize), from1: &[Ray], from2: &[Ray]) {
        self.changes.fill(0.0);
        let cut = problem.params.gate * std::f64::consts::SQRT_2 * problem.largest_sigma;
        let mut low = 0;
        for ray1 in from1 {
            while low < from2.len() && from2[low].distance < ray1.distance - cut {
                low += 1;
            }
            for ray2 in from2[low..].iter().take_while(|ray2| ray2.distance <= ray1.distance + cut) {
                // The difference of two edges of equal pairs has the variance of both their ends.
                let variance = problem.variance(i, a) + problem.variance(ray1.object, ray2.object);
                let difference = ray1.distance - ray2.distance;
                let weight = problem.worth(ray1.object, ray2.object, difference * difference / variance);
                if weight > 0.0 {
                    // Two standard deviations: wider votes make more turns look alike than right ones gain.
                    let width = 2.0 * variance.sqrt() / ray1.distance;
                    self.add(ray1.angle - ray2.angle, width.min(0.5 * PI), weight);
                }
            }
        }
    }

    fn add(&mut self, angle: f64, half_width: f64, weight: f64) {
        let bins = self.changes.len();
        let scale = bins as f64 / TAU;
        // Angles lie in (-2π, 2π) and widths below π/2: three turns up makes all positive.
        let bin = |x: f64| ((x + 3.0 * TAU) * scale) as usize & (bins - 1);
        let (from, to) = (bin(angle - half_width), (bin(angle + half_width) + 1) & (bins - 1));
        self.changes[from] += weight;
        self.changes[to] -= weight;
        if to < from {
            self.changes[0] += weight;
        }
    }

    /// Largest sum and its turn; `None` without votes.
    fn best(&self) -> Option<(f64, f64)> {
        let (mut sum, mut best, mut from, mut to) = (0.0, 0.0, 0, 0);
        for (k, change) in self.changes.iter().enumerate() {
            sum += change;
            if sum > best + 1e-9 {
                (best, from, to) = (sum, k, k);
            } else if to + 1 == k && sum >= best - 1e-9 {
                to = k;
            }
        }
        let middle = 0.5 * (from + to + 1) as f64 * TAU / self.changes.len() as f64;
        (best > 0.0).then_some((best, middle))
    }
}

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

/// The best turn about every admissible pair, best first.
///
/// For each pair (i, a) taken as the pivot, each other pair (j, b) of equal distance from the pivot votes for the
/// turn that brings b onto j, with a width that its noise allows; the turn with the largest sum of votes wins.
/// Cost O(N M k log k) for k votes a pivot.
pub(super) fn hypotheses(problem: &Problem) -> Vec<Hypothesis> {
    let rays1 = rays(&problem.p1, problem.params.min_edge);
    let rays2 = rays(&problem.p2, problem.params.min_edge);
    let mut found = Vec::with_capacity(problem.p1.len() * problem.p2.len());
    let mut votes = Votes::default();
    for (i, from1) in rays1.iter().enumerate() {
        for (a, from2) in rays2.iter().enumerate() {
            let gain = problem.gain(i, a);
            if gain == f64::NEG_INFINITY {
                continue;
            }
            votes.collect(problem, (i, a), from1, from2);
            if let Some((score, angle)) = votes.best() {
                let rotation = UnitComplex::new(angle);
                let translation = problem.p1[i].coords - rotation * problem.p2[a].coords;
                found.push(Hypothesis {
                    score: score + gain,
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

/// Weighted intervals of turns.
#[derive(Default)]
struct Votes {
    /// Angle and change of the sum at it.
    ends: Vec<(f64, f64)>,
    /// Sum at angle -π.
    wrapped: f64,
}

impl Votes {
    fn collect(&mut self, problem: &Problem, (i, a): (usize, usize), from1: &[Ray], from2: &[Ray]) {
        self.ends.clear();
        self.wrapped = 0.0;
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
                let weight =
                    problem.gain(ray1.object, ray2.object) - 0.5 * difference * difference / variance;
                if weight > 0.0 {
                    let width = problem.params.gate * variance.sqrt() / ray1.distance;
                    self.add(ray1.angle - ray2.angle, width.min(0.5 * PI), weight);
                }
            }
        }
    }

    fn add(&mut self, angle: f64, half_width: f64, weight: f64) {
        let wrap = |x: f64| x - TAU * (x / TAU).round();
        let (from, to) = (wrap(angle - half_width), wrap(angle + half_width));
        if from > to {
            self.wrapped += weight;
        }
        self.ends.push((from, weight));
        self.ends.push((to, -weight));
    }

    /// Largest sum and the middle of the interval that has it.
    fn best(&mut self) -> Option<(f64, f64)> {
        self.ends.sort_unstable_by(|x, y| x.0.total_cmp(&y.0));
        let (mut sum, mut best) = (self.wrapped, None::<(f64, f64)>);
        for (k, &(angle, change)) in self.ends.iter().enumerate() {
            sum += change;
            if best.is_none_or(|(s, _)| sum > s) {
                let next = self.ends.get(k + 1).map_or(angle, |e| e.0);
                best = Some((sum, 0.5 * (angle + next)));
            }
        }
        best
    }
}

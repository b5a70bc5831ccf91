use super::Affinity;
use crate::graph::Adjacency;

/// Where the ascent starts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Start {
    /// At the leading eigenvector of the affinities.
    #[default]
    Spectral,
    /// With all measurements alike.
    Uniform,
}

/// Knobs of [`densest`].
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Where the ascent starts. Default [`Start::Spectral`].
    pub start: Start,
    /// Largest number of ascent steps for one penalty. Default 200.
    pub steps: usize,
    /// Change of the unit vector below which an ascent ends. Default 1e-8.
    pub tolerance: f64,
    /// Factor by which the penalty grows. Default 2.
    pub growth: f64,
    /// Largest number of penalties. Default 60.
    pub rounds: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self { start: Start::Spectral, steps: 200, tolerance: 1e-8, growth: 2.0, rounds: 60 }
    }
}

/// Why the ascent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The support holds no two measurements that contradict each other.
    Converged,
    /// The largest number of penalties was reached.
    MaxIterations,
}

/// What the relaxation found.
#[derive(Clone, Debug, PartialEq)]
pub struct Relaxation {
    /// A clique, ascending, verified: no two of its members contradict each other.
    pub clique: Vec<usize>,
    /// The relaxation's own set, ascending: its `round(x'Mx)` largest entries. It need not be a clique.
    pub support: Vec<usize>,
    /// Entry of each measurement, not negative, squares summing to one.
    pub scores: Vec<f64>,
    /// `x'Mx`: for a perfect clique its size.
    pub value: f64,
    /// Matrix products made.
    pub iterations: usize,
    /// Why it ended.
    pub termination: Termination,
}

/// Maximises the relaxed density of a consistent set,
///
/// ```text
/// max x'Mx − d · Σ x_i x_j over contradicting pairs,   x ≥ 0, |x| = 1,
/// ```
///
/// by projected ascent while `d` grows until no two measurements of the support contradict each other. Deterministic.
/// A product costs the number of pairs with an affinity: contradicting pairs are counted through `(Σx)²`.
///
/// # Panics
/// If the set found is not a clique, which would be an error of this crate.
///
/// **Source**: Lusk and How, *CLIPPER: Robust Data Association without an Initial Guess*, 2024 (the problem and
/// its penalty). Here the step is the shifted power step, which never lowers the objective and needs no line search,
/// and the set is repaired to a clique.
///
/// ```
/// use draco_consistency::relaxed::{Affinity, Params, densest};
/// let pairs = [(0, 1, 0.9), (1, 2, 0.9), (0, 2, 0.9), (2, 3, 1.0), (3, 4, 0.2)];
/// let found = densest(&Affinity::from_pairs(5, &pairs)?, &Params::default());
/// assert_eq!(found.clique, [0, 1, 2]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn densest(affinity: &Affinity, params: &Params) -> Relaxation {
    let n = affinity.graph().len();
    let mut iterations = 0;
    let mut x = match params.start {
        Start::Uniform => vec![1.0 / (n.max(1) as f64).sqrt(); n],
        Start::Spectral => leading(affinity, params, &mut iterations),
    };
    let mut penalty = 0.0;
    for _ in 0..params.rounds {
        if contradictions(affinity, &x) <= CONTRADICTION {
            return finish(affinity, x, iterations, Termination::Converged);
        }
        penalty = if penalty == 0.0 { FIRST_PENALTY } else { penalty * params.growth.max(1.0 + 1e-3) };
        ascend(affinity, &mut x, penalty, params, &mut iterations);
    }
    finish(affinity, x, iterations, Termination::MaxIterations)
}

const FIRST_PENALTY: f64 = 0.05;

/// Share of contradicting products at which the support counts as consistent.
const CONTRADICTION: f64 = 1e-6;

/// The leading eigenvector of the affinities and the clique read off it: one shot, no penalty.
///
/// # Panics
/// If the set found is not a clique, which would be an error of this crate.
pub fn spectral(affinity: &Affinity) -> Relaxation {
    let mut iterations = 0;
    let x = leading(affinity, &Params::default(), &mut iterations);
    finish(affinity, x, iterations, Termination::Converged)
}

fn leading(affinity: &Affinity, params: &Params, iterations: &mut usize) -> Vec<f64> {
    let n = affinity.graph().len();
    let mut x = vec![1.0 / (n.max(1) as f64).sqrt(); n];
    ascend(affinity, &mut x, 0.0, params, iterations);
    x
}

/// Shifted power steps: with the shift the objective is convex on the sphere, so a step never lowers it.
fn ascend(affinity: &Affinity, x: &mut [f64], penalty: f64, params: &Params, iterations: &mut usize) {
    for _ in 0..params.steps {
        *iterations += 1;
        let sum: f64 = x.iter().sum();
        let (mut step, mut norm_sq) = (vec![0.0; x.len()], 0.0);
        for (v, next) in step.iter_mut().enumerate() {
            let (agree, joined) =
                affinity.neighbors(v).fold((x[v], x[v]), |(m, c), (u, w)| (m + w * x[u], c + x[u]));
            // A gradient below zero on a zero entry stays zero: the projection onto x ≥ 0.
            *next = (agree - penalty * (sum - joined) + penalty * x[v]).max(0.0);
            norm_sq += *next * *next;
        }
        if norm_sq <= 0.0 {
            return;
        }
        let scale = norm_sq.sqrt().recip();
        let mut change = 0.0f64;
        for (old, new) in x.iter_mut().zip(step) {
            change = change.max((*old - new * scale).abs());
            *old = new * scale;
        }
        if change < params.tolerance {
            return;
        }
    }
}

/// `Σ x_i x_j` over contradicting ordered pairs.
fn contradictions(affinity: &Affinity, x: &[f64]) -> f64 {
    let sum: f64 = x.iter().sum();
    x.iter()
        .enumerate()
        .map(|(v, &value)| {
            let joined: f64 = affinity.neighbors(v).map(|(u, _)| x[u]).sum();
            value * (sum - value - joined).max(0.0)
        })
        .sum()
}

fn finish(affinity: &Affinity, x: Vec<f64>, iterations: usize, termination: Termination) -> Relaxation {
    let graph = affinity.graph();
    let value: f64 =
        (0..x.len()).map(|v| x[v] * affinity.neighbors(v).fold(x[v], |sum, (u, w)| sum + w * x[u])).sum();
    let mut order: Vec<usize> = (0..x.len()).collect();
    order.sort_by(|&a, &b| x[b].total_cmp(&x[a]).then(a.cmp(&b)));
    let mut support: Vec<usize> = order.iter().copied().take(value.round() as usize).collect();
    support.sort_unstable();
    let mut clique: Vec<usize> = Vec::new();
    for &v in &order {
        if clique.iter().all(|&u| graph.has_edge(u, v)) {
            clique.push(v);
        }
    }
    clique.sort_unstable();
    assert!(graph.is_clique(&clique), "the set found is not a clique");
    Relaxation { clique, support, scores: x, value, iterations, termination }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_cliques_the_one_of_more_affinity_wins() {
        let mut pairs = Vec::new();
        for (members, affinity) in [(0..6, 0.3), (6..11, 0.95)] {
            for a in members.clone() {
                pairs.extend((a + 1..members.end).map(|b| (a, b, affinity)));
            }
        }
        pairs.push((0, 6, 1.0));
        let affinity = Affinity::from_pairs(11, &pairs).unwrap();
        for start in [Start::Spectral, Start::Uniform] {
            let found = densest(&affinity, &Params { start, ..Params::default() });
            assert_eq!(found.clique, [6, 7, 8, 9, 10], "{start:?}");
            assert_eq!((found.support, found.termination), (found.clique, Termination::Converged));
            assert!((found.value - 4.8).abs() < 1e-3);
        }
        assert_eq!(spectral(&affinity).clique, [6, 7, 8, 9, 10]);
        assert!((affinity.density(&[6, 7, 8, 9, 10]) - 4.8).abs() < 1e-12);
    }

    #[test]
    fn nothing_and_one_are_answered() {
        for n in [0, 1, 3] {
            let found = densest(&Affinity::from_pairs(n, &[]).unwrap(), &Params::default());
            assert_eq!(found.clique.len(), n.min(1));
        }
    }
}

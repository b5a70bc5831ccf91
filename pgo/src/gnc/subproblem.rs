use std::sync::Arc;

use draco_lie::LieGroup;

use super::Candidate;
use crate::optimizer::{Optimizer, Outcome};
use crate::pattern::Elimination;
use crate::problem::Problem;
use crate::sparse::{Cholesky, Symbolic};
use crate::{Error, Key, PoseGraph, SolveParams, Termination};

/// The problem over the known inliers and those candidates that take part.
pub(super) struct Subproblem<G, const N: usize> {
    pub(super) problem: Problem<G, N>,
    pub(super) cholesky: Cholesky<N>,
    /// For each candidate that takes part its position and that of its factor in the problem.
    members: Vec<(usize, usize)>,
    candidates: usize,
}

impl<const N: usize, G: LieGroup<N>> Subproblem<G, N> {
    pub(super) fn new(
        graph: &PoseGraph<G, N>,
        held: &[Key],
        candidates: &[Candidate<G, N>],
        weights: &[f64],
    ) -> Result<Self, Error> {
        let mut part = graph.clone();
        for (candidate, weight) in candidates.iter().zip(weights) {
            if *weight <= 0.0 {
                part.remove_factor(candidate.id)?;
            }
        }
        let problem = Problem::new(&part, held)?;
        let mut members = Vec::new();
        let mut position = candidates.iter().enumerate().peekable();
        for (index, id) in problem.between_ids().enumerate() {
            while position.next_if(|(_, c)| c.id < id).is_some() {}
            if let Some((candidate, _)) = position.next_if(|(_, c)| c.id == id) {
                members.push((candidate, index));
            }
        }
        let cholesky = factor_of(&problem, &part.elimination);
        Ok(Self { problem, cholesky, members, candidates: candidates.len() })
    }

    /// Whether all that weighs takes part, and not too much else.
    pub(super) fn serves(&self, weights: &[f64]) -> bool {
        let active = weights.iter().filter(|w| **w > 0.0).count();
        let inside = self.members.iter().filter(|(candidate, _)| weights[*candidate] > 0.0).count();
        weights.len() == self.candidates && inside == active && 10 * active >= 8 * self.members.len()
    }

    pub(super) fn weigh(&mut self, weights: &[f64]) {
        for (candidate, index) in &self.members {
            self.problem.set_scale(*index, weights[*candidate]);
        }
    }

    pub(super) fn optimise(
        &mut self,
        graph: &PoseGraph<G, N>,
        params: &SolveParams,
        poses: &mut [G],
    ) -> Result<Outcome, Error> {
        if self.problem.free() == 0 {
            let cost = self.problem.cost(poses);
            return Ok(Outcome { termination: Termination::Converged, ..Outcome::at_start(cost) });
        }
        Optimizer::new(&mut self.problem, &mut self.cholesky, params)
            .run(poses)
            .map_err(|slot| Error::Indefinite { key: graph.keys[slot] })
    }
}

/// Room for the factor of a problem. Minimum degree eliminates a chain from its ends, which leaves one long path to
/// the root; what is little more than a chain is bisected instead, so that paths are short.
fn factor_of<const N: usize, G: LieGroup<N>>(
    problem: &Problem<G, N>,
    elimination: &Elimination,
) -> Cholesky<N> {
    let pairs = &problem.pattern.pairs;
    let columns = problem.free();
    if columns == 0 || 20 * pairs.len() > 21 * columns {
        return problem.cholesky(elimination);
    }
    let mut order = Vec::with_capacity(columns);
    bisect(0, columns as u32, &mut order);
    Cholesky::new(Arc::new(Symbolic::with_order(order, pairs, N)), pairs)
}

fn bisect(begin: u32, end: u32, order: &mut Vec<u32>) {
    if begin < end {
        let middle = begin + (end - begin) / 2;
        bisect(begin, middle, order);
        bisect(middle + 1, end, order);
        order.push(middle);
    }
}

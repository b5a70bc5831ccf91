use std::collections::BTreeMap;

use draco_lie::LieGroup;
use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::{Candidate, Run, Subproblem};
use crate::marginals::{PathColumns, PathWork};
use crate::pattern::HELD;
use crate::problem::Problem;
use crate::sparse::SelectedInverse;
use crate::{Error, PoseGraph, SolveParams};

/// Rounds, at most.
const ROUNDS: usize = 60;
/// Steps of the optimisation after each round.
const STEPS: usize = 6;
/// Share of false ones expected among those that pass tests of a like sharpness, for which they are taken in; the
/// loosest is used only when the strictest leaves nothing to take in, since a false one in a part of the map that
/// nothing else holds yet can bend it for good.
const FALSE_SHARES: [f64; 2] = [1e-3, 1e-2];
/// While the set grows, and at the end, when the map is firm.
const GROWING: Stage = Stage { odds: 1e-3, hopeless: 100.0 };
const AT_LAST: Stage = Stage { odds: 1e-2, hopeless: 4.0 };
/// Tests whose probabilities to pass by chance are within this factor are of a like sharpness.
const LIKE: f64 = 4.0;
/// Largest probability to pass by chance of a test that tells right from false by itself.
const SHARP: f64 = 0.1;
/// Largest variance of a rotation, in rad², at which its distribution still is near enough to a Gaussian one to
/// judge by.
const LARGEST_TURN: f64 = 0.1;

/// How hard to judge.
#[derive(Debug, Clone, Copy)]
struct Stage {
    /// Odds of being false with which a candidate is taken in by itself.
    odds: f64,
    /// A candidate this many times over the limit is not looked at again.
    hopeless: f64,
}

/// What is known of the candidates.
#[derive(Debug, Clone)]
pub(super) struct Consensus {
    pub(super) accepted: Vec<bool>,
    /// So far off, where the map was loose already, that they are not looked at again.
    hopeless: Vec<bool>,
}

impl Consensus {
    pub(super) fn new(candidates: usize) -> Self {
        Self { accepted: vec![false; candidates], hopeless: vec![false; candidates] }
    }

    /// One for what is accepted, else zero.
    pub(super) fn weights(&self) -> Vec<f64> {
        self.accepted.iter().map(|inside| f64::from(u8::from(*inside))).collect()
    }
}

/// Grows the set of accepted candidates from the known inliers and moves `poses` to their optimum; `None` when the
/// known inliers do not join what all measurements join.
///
/// Each round compares the residual of each candidate with its covariance, that of the relative pose as it follows
/// from what is accepted plus that of the measurement. How much of the space a random measurement could fall in the
/// gate covers tells how likely it is to pass by chance; the sharpest gates are trusted first. Nothing here is
/// final: the graduation looks at every candidate again.
pub(super) fn consensus<const N: usize, G: LieGroup<N>>(
    run: &Run<G, N>,
    poses: &mut [G],
) -> Result<Option<Consensus>, Error> {
    let none = vec![0.0; run.candidates.len()];
    let Some(known) = known_only(run)? else { return Ok(None) };
    let mut sub = Subproblem::new(run.graph, run.held, run.candidates, &none)?;
    let mut composed = known;
    crate::spanning_tree(&mut composed)?;
    if sub.problem.cost(&composed.poses) < sub.problem.cost(poses) {
        poses.copy_from_slice(&composed.poses);
    }
    sub.optimise(run.graph, &solver(run), poses)?;
    let mut consensus = Consensus::new(run.candidates.len());
    grow(run, sub, poses, &mut consensus, GROWING)?;
    Ok(Some(consensus))
}

fn solver<const N: usize, G: LieGroup<N>>(run: &Run<G, N>) -> SolveParams {
    SolveParams { max_iterations: STEPS, ..run.params.solver.clone() }
}

/// Takes candidates in as long as there are some to trust, `sub` being the problem of those accepted so far and
/// `poses` near its optimum.
fn grow<const N: usize, G: LieGroup<N>>(
    run: &Run<G, N>,
    mut sub: Subproblem<G, N>,
    poses: &mut [G],
    consensus: &mut Consensus,
    stage: Stage,
) -> Result<(), Error> {
    let solver = solver(run);
    let mut space = None;
    for _ in 0..ROUNDS {
        let volume = *space.get_or_insert_with(|| log_volume::<N, G>(poses));
        let tested = test(run, &mut sub, poses, consensus, (volume, stage.hopeless * run.limit));
        let count = |list: &[bool]| list.iter().filter(|is| **is).count();
        let settled = [count(&consensus.accepted), count(&consensus.hopeless)];
        let together = FALSE_SHARES.iter().map(|share| agreeing(&tested, *share));
        let alone = std::iter::once_with(|| credible(&tested, settled, stage.odds));
        let Some(new) = together.chain(alone).find(|new| !new.is_empty()) else { break };
        new.iter().for_each(|candidate| consensus.accepted[*candidate] = true);
        // twice: what turns out not to agree leaves again
        for _ in 0..2 {
            sub = Subproblem::new(run.graph, run.held, run.candidates, &consensus.weights())?;
            sub.optimise(run.graph, &solver, poses)?;
            let mut left = false;
            for (candidate, inside) in run.candidates.iter().zip(&mut consensus.accepted) {
                if *inside && candidate.chi2(poses) > run.limit {
                    (*inside, left) = (false, true);
                }
            }
            if !left {
                break;
            }
        }
    }
    Ok(())
}

/// Looks once more at what was rejected: the poses follow from what was accepted, and where that is little they are
/// known no better than its covariance tells, so a right measurement may be far off. Grows the accepted set.
pub(super) fn readmit<const N: usize, G: LieGroup<N>>(
    run: &Run<G, N>,
    poses: &mut [G],
    consensus: &mut Consensus,
) -> Result<(), Error> {
    let sub = Subproblem::new(run.graph, run.held, run.candidates, &consensus.weights())?;
    grow(run, sub, poses, consensus, AT_LAST)
}

/// The graph of the known inliers, when it has as few connected parts as the whole.
fn known_only<const N: usize, G: LieGroup<N>>(run: &Run<G, N>) -> Result<Option<PoseGraph<G, N>>, Error> {
    let mut known = run.graph.clone();
    for candidate in run.candidates {
        known.remove_factor(candidate.id)?;
    }
    Ok((known.components().len() == run.graph.components().len()).then_some(known))
}

/// A candidate whose residual could be judged.
struct Tested {
    candidate: usize,
    /// Probability that a random measurement passes.
    by_chance: f64,
    passes: bool,
}

fn test<const N: usize, G: LieGroup<N>>(
    run: &Run<G, N>,
    sub: &mut Subproblem<G, N>,
    poses: &[G],
    consensus: &mut Consensus,
    (space, hopeless): (f64, f64),
) -> Vec<Tested> {
    sub.problem.linearise(poses);
    if sub.problem.free() == 0 || sub.cholesky.factor(&sub.problem.hessian, None).is_err() {
        return Vec::new();
    }
    let inverse = SelectedInverse::new(&sub.cholesky);
    let symbolic = sub.cholesky.symbolic();
    let marginal = |column: u32| match column {
        HELD => SMatrix::zeros(),
        column => inverse.block(symbolic, column, column).unwrap_or_else(SMatrix::zeros),
    };
    let mut gates = Gates {
        marginals: sub.problem.pattern.columns.iter().map(|column| marginal(*column)).collect(),
        problem: &sub.problem,
        cholesky: &sub.cholesky,
        last: None,
        work: PathWork::new(&sub.cholesky),
    };
    let mut tested = Vec::new();
    for (index, candidate) in run.candidates.iter().enumerate() {
        if consensus.accepted[index] || consensus.hopeless[index] {
            continue;
        }
        let far = |gate: &Gate| gate.turn <= LARGEST_TURN && gate.chi2 > hopeless;
        if gates.widest(candidate, poses).is_some_and(|gate| far(&gate)) {
            consensus.hopeless[index] = true;
            continue;
        }
        let Some(gate) = gates.gate(candidate, poses) else { continue };
        if gate.turn > LARGEST_TURN {
            continue;
        }
        consensus.hopeless[index] = gate.chi2 > hopeless;
        let log_chance = gate.log_det_half + 0.5 * N as f64 * run.limit.ln() + log_unit_ball(N) - space;
        tested.push(Tested {
            candidate: index,
            by_chance: log_chance.exp().min(1.0),
            passes: gate.chi2 <= run.limit,
        });
    }
    tested
}

/// The candidates that pass tests of a like sharpness, where at most a share of so many would pass by chance: many
/// right ones that close the same long loop speak for each other, a false one stands alone.
fn agreeing(tested: &[Tested], share: f64) -> Vec<usize> {
    let mut classes: BTreeMap<i64, (f64, Vec<usize>)> = BTreeMap::new();
    for t in tested.iter().filter(|t| t.by_chance <= SHARP) {
        let class = (t.by_chance.max(f64::MIN_POSITIVE).ln() / LIKE.ln()).floor() as i64;
        let (expected, passing) = classes.entry(class).or_default();
        *expected += t.by_chance;
        passing.extend(t.passes.then_some(t.candidate));
    }
    let few = |(expected, passing): &(f64, Vec<usize>)| *expected <= share * passing.len() as f64;
    let mut chosen: Vec<usize> = classes.into_values().filter(few).flat_map(|(_, passing)| passing).collect();
    chosen.sort_unstable();
    chosen
}

/// The candidates that pass and are false with odds of at most `odds`.
///
/// Of a candidate that passes they are the probability to pass by chance, times those of a candidate that is not
/// known; and these follow from how many are accepted and how many more pass the sharp tests than would by chance.
/// `settled` are the candidates accepted so far, and those found hopeless.
fn credible(tested: &[Tested], settled: [usize; 2], odds: f64) -> Vec<usize> {
    let sharp = || tested.iter().filter(|t| t.by_chance <= SHARP);
    let by_chance: f64 = sharp().map(|t| t.by_chance).sum();
    let passing = sharp().filter(|t| t.passes).count() as f64;
    let right = settled[0] as f64 + (passing - by_chance).max(0.0);
    let all = (settled[0] + settled[1] + sharp().count()) as f64;
    // one of each kind more, so that nothing is certain
    let odds_before = (all - right + 1.0) / (right + 1.0);
    tested.iter().filter(|t| t.passes && t.by_chance * odds_before <= odds).map(|t| t.candidate).collect()
}

struct Gate {
    chi2: f64,
    /// Half the logarithm of the determinant of the covariance.
    log_det_half: f64,
    /// Largest variance of the rotation.
    turn: f64,
}

struct Gates<'a, G, const N: usize> {
    /// Covariance of each pose, by slot.
    marginals: Vec<SMatrix<f64, N, N>>,
    problem: &'a Problem<G, N>,
    cholesky: &'a crate::sparse::Cholesky<N>,
    /// The columns of the last first pose: candidates often share it with their neighbours in the list.
    last: Option<(u32, PathColumns<N>)>,
    work: PathWork<N>,
}

impl<const N: usize, G: LieGroup<N>> Gates<'_, G, N> {
    /// Residual of a candidate against the covariance of the residual.
    fn gate(&mut self, candidate: &Candidate<G, N>, poses: &[G]) -> Option<Gate> {
        let relative = self.relative(candidate.slots, &adjoint_of(candidate, poses));
        gate(candidate, poses, &relative)
    }

    /// A gate that is at least as wide, at next to no cost: the covariance of a difference is at most twice the sum
    /// of both.
    fn widest(&self, candidate: &Candidate<G, N>, poses: &[G]) -> Option<Gate> {
        let adjoint = adjoint_of(candidate, poses);
        let [a, b] = candidate.slots.map(|s| &self.marginals[s as usize]);
        let bound = (adjoint * a * adjoint.transpose() + b) * 2.0;
        gate(candidate, poses, &bound)
    }

    /// Covariance of `a⁻¹ b` with `adjoint` that of `b⁻¹ a`.
    fn relative(&mut self, slots: [u32; 2], adjoint: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        let [a, b] = slots.map(|s| self.problem.pattern.columns[s as usize]);
        if a != HELD && self.last.as_ref().is_none_or(|(column, _)| *column != a) {
            self.last = Some((a, PathColumns::new(self.cholesky, &mut self.work, a)));
        }
        let first = self.last.as_ref().filter(|_| a != HELD).map(|(_, columns)| columns);
        let second = (b != HELD).then(|| PathColumns::new(self.cholesky, &mut self.work, b));
        match (first, second) {
            (Some(a), Some(b)) => {
                let difference = b.minus(a, adjoint);
                difference.product(&difference)
            }
            (Some(a), None) => adjoint * a.product(a) * adjoint.transpose(),
            (None, Some(b)) => b.product(&b),
            (None, None) => SMatrix::zeros(),
        }
    }
}

/// Adjoint of `b⁻¹ a`.
fn adjoint_of<const N: usize, G: LieGroup<N>>(
    candidate: &Candidate<G, N>,
    poses: &[G],
) -> SMatrix<f64, N, N> {
    let [a, b] = candidate.slots.map(|s| &poses[s as usize]);
    b.between(a).adjoint()
}

/// Residual of a candidate against the covariance of the residual, with `relative` that of `a⁻¹ b`.
fn gate<const N: usize, G: LieGroup<N>>(
    candidate: &Candidate<G, N>,
    poses: &[G],
    relative: &SMatrix<f64, N, N>,
) -> Option<Gate> {
    let [a, b] = candidate.slots.map(|s| &poses[s as usize]);
    let e = candidate.measured.between(&a.between(b)).log();
    let jacobian = G::right_jacobian_inverse(&e);
    let noise = Cholesky::<f64, Const<N>>::new(candidate.information)?.inverse();
    let total = jacobian * relative * jacobian.transpose() + noise;
    let factor = Cholesky::<f64, Const<N>>::new((total + total.transpose()) * 0.5)?;
    let whitened: SVector<f64, N> = factor.l().solve_lower_triangular(&e)?;
    Some(Gate {
        chi2: whitened.norm_squared(),
        log_det_half: (0..N).map(|k| factor.l_dirty()[(k, k)].ln()).sum(),
        turn: (turns_from(N)..N).map(|k| total[(k, k)]).fold(0.0, f64::max),
    })
}

/// Index of the first rotation in a tangent vector of the plane or of space.
fn turns_from(n: usize) -> usize {
    n.div_ceil(2)
}

/// Logarithm of the volume a random relative pose falls into: the extent of the map, and all rotations.
fn log_volume<const N: usize, G: LieGroup<N>>(poses: &[G]) -> f64 {
    let Some(first) = poses.first() else { return 0.0 };
    let mut extent = SVector::<f64, N>::zeros();
    let mut lowest = SVector::<f64, N>::zeros();
    for pose in poses {
        let at = first.between(pose).log();
        extent = extent.sup(&at);
        lowest = lowest.inf(&at);
    }
    let extent = extent - lowest;
    let places = turns_from(N);
    let widest = extent.rows(0, places).max();
    // along a corridor the other directions count a tenth
    let translations: f64 =
        (0..places).map(|k| extent[k].max(0.1 * widest).max(f64::MIN_POSITIVE).ln()).sum();
    let pi = std::f64::consts::PI;
    let rotations = if N - places == 1 { 2.0 * pi } else { 8.0 * pi * pi };
    translations + rotations.ln()
}

/// Logarithm of the volume of the unit ball.
fn log_unit_ball(n: usize) -> f64 {
    let mut volume = [1.0, 2.0];
    for k in 2..=n {
        volume[k % 2] *= std::f64::consts::TAU / k as f64;
    }
    volume[n % 2].ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_balls_have_their_known_volumes() {
        let pi = std::f64::consts::PI;
        for (n, volume) in [(1, 2.0), (2, pi), (3, 4.0 / 3.0 * pi), (6, pi.powi(3) / 6.0)] {
            assert!((log_unit_ball(n).exp() - volume).abs() < 1e-12 * volume, "{n}");
        }
    }

    #[test]
    fn the_odds_decide_and_follow_from_the_share_that_passes() {
        let tested = |candidate, by_chance, passes| Tested { candidate, by_chance, passes };
        let list = [
            tested(0, 1e-4, true),
            tested(1, 1e-3, false),
            tested(2, 1e-3, true),
            tested(3, 0.5, true),
            tested(4, 1e-5, true),
        ];
        // three of four sharp tests pass: odds of one half before
        assert_eq!(credible(&list, [0, 0], 1e-4), [0, 4]);
        assert_eq!(credible(&list, [0, 0], 1e-3), [0, 2, 4]);
        // many hopeless ones make a new one less credible, many right ones more
        assert_eq!(credible(&list, [0, 50], 1e-3), [4]);
        assert_eq!(credible(&list, [50, 0], 0.05), [0, 2, 3, 4]);
        assert!(credible(&list[3..4], [0, 0], 1e-2).is_empty());
    }

    #[test]
    fn many_that_agree_are_taken_in_where_one_is_not() {
        let class = |passing: usize| -> Vec<Tested> {
            (0..200)
                .map(|candidate| Tested { candidate, by_chance: 2e-3, passes: candidate < passing })
                .collect()
        };
        assert!(agreeing(&class(1), 1e-2).is_empty());
        assert_eq!(agreeing(&class(60), 1e-2).len(), 60);
        // sharper tests beside them do not help
        let mut mixed = class(1);
        mixed.extend((200..400).map(|candidate| Tested { candidate, by_chance: 1e-6, passes: true }));
        assert_eq!(agreeing(&mixed, 1e-2), (200..400).collect::<Vec<usize>>());
    }
}

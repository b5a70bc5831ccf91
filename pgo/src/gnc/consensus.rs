use draco_lie::LieGroup;
use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::{Candidate, Run, Subproblem};
use crate::marginals::{PathColumns, PathWork};
use crate::problem::{HELD, Problem};
use crate::{Error, PoseGraph};

/// Rounds, at most.
const ROUNDS: usize = 30;
/// Steps of the optimisation after each round.
const STEPS: usize = 6;
/// Share of random measurements expected among those taken in.
const FALSE_SHARE: f64 = 0.01;
/// Largest variance of a rotation, in rad², at which its distribution still is near enough to a Gaussian one to
/// judge by.
const LARGEST_TURN: f64 = 0.1;
/// A candidate this many times over the limit is not looked at again in this stage.
const HOPELESS: f64 = 100.0;

/// Grows the set of accepted candidates from the known inliers and moves `poses` to their optimum; `None` when the
/// known inliers do not join what all measurements join.
///
/// Each round compares the residual of each candidate with its covariance, that of the relative pose as it follows
/// from what is accepted plus that of the measurement. How much of the space a random measurement could fall in the
/// gate covers tells how likely it is to pass by chance; the sharpest gates are trusted first, as far as the false
/// ones expected stay a small share of those that pass. Nothing here is final: the graduation looks at every
/// candidate again.
pub(super) fn consensus<const N: usize, G: LieGroup<N>>(
    run: &Run<G, N>,
    poses: &mut [G],
) -> Result<Option<Vec<bool>>, Error> {
    let none = vec![0.0; run.candidates.len()];
    let Some(known) = known_only(run)? else { return Ok(None) };
    let mut sub = Subproblem::new(run.graph, run.held, run.candidates, &none)?;
    let mut composed = known;
    crate::spanning_tree(&mut composed)?;
    if sub.problem.cost(&composed.poses) < sub.problem.cost(poses) {
        poses.copy_from_slice(&composed.poses);
    }
    let solver = crate::SolveParams { max_iterations: STEPS, ..run.params.solver.clone() };
    sub.optimise(run.graph, &solver, poses)?;
    let mut accepted = vec![false; run.candidates.len()];
    let mut hopeless = vec![false; run.candidates.len()];
    let mut space = None;
    for _ in 0..ROUNDS {
        let volume = *space.get_or_insert_with(|| log_volume::<N, G>(poses));
        let tested = test(run, &mut sub, poses, &accepted, &mut hopeless, volume);
        let new = choose(&tested);
        if new.is_empty() {
            break;
        }
        new.iter().for_each(|candidate| accepted[*candidate] = true);
        // twice: what turns out not to agree leaves again
        for _ in 0..2 {
            let weights: Vec<f64> = accepted.iter().map(|a| f64::from(u8::from(*a))).collect();
            sub = Subproblem::new(run.graph, run.held, run.candidates, &weights)?;
            sub.optimise(run.graph, &solver, poses)?;
            let mut left = false;
            for (candidate, inside) in run.candidates.iter().zip(&mut accepted) {
                if *inside && candidate.chi2(poses) > run.limit {
                    (*inside, left) = (false, true);
                }
            }
            if !left {
                break;
            }
        }
    }
    Ok(Some(accepted))
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
    accepted: &[bool],
    hopeless: &mut [bool],
    space: f64,
) -> Vec<Tested> {
    sub.problem.linearise(poses);
    if sub.problem.free() == 0 || sub.cholesky.factor(&sub.problem.hessian, None).is_err() {
        return Vec::new();
    }
    let mut gates = Gates {
        problem: &sub.problem,
        cholesky: &sub.cholesky,
        last: None,
        work: PathWork::new(&sub.cholesky),
    };
    let mut tested = Vec::new();
    for (index, candidate) in run.candidates.iter().enumerate() {
        if accepted[index] || hopeless[index] {
            continue;
        }
        let Some(gate) = gates.gate(candidate, poses) else { continue };
        if gate.turn > LARGEST_TURN {
            continue;
        }
        hopeless[index] = gate.chi2 > HOPELESS * run.limit;
        let log_chance = gate.log_det_half + 0.5 * N as f64 * run.limit.ln() + log_unit_ball(N) - space;
        tested.push(Tested {
            candidate: index,
            by_chance: log_chance.exp().min(1.0),
            passes: gate.chi2 <= run.limit,
        });
    }
    tested
}

/// The candidates to take in: the longest list, sharpest first, of whose passing ones few are expected to be false.
fn choose(tested: &[Tested]) -> Vec<usize> {
    let mut order: Vec<&Tested> = tested.iter().collect();
    order.sort_by(|a, b| a.by_chance.total_cmp(&b.by_chance).then(a.candidate.cmp(&b.candidate)));
    let (mut expected, mut passing, mut longest) = (0.0, 0usize, 0);
    for (k, t) in order.iter().enumerate() {
        expected += t.by_chance;
        passing += usize::from(t.passes);
        if expected <= FALSE_SHARE * passing as f64 {
            longest = k + 1;
        }
    }
    order[..longest].iter().filter(|t| t.passes).map(|t| t.candidate).collect()
}

struct Gate {
    chi2: f64,
    /// Half the logarithm of the determinant of the covariance.
    log_det_half: f64,
    /// Largest variance of the rotation.
    turn: f64,
}

struct Gates<'a, G, const N: usize> {
    problem: &'a Problem<G, N>,
    cholesky: &'a crate::sparse::Cholesky<N>,
    /// The columns of the last first pose: candidates often share it with their neighbours in the list.
    last: Option<(u32, PathColumns<N>)>,
    work: PathWork<N>,
}

impl<const N: usize, G: LieGroup<N>> Gates<'_, G, N> {
    /// Residual of a candidate against the covariance of the residual.
    fn gate(&mut self, candidate: &Candidate<G, N>, poses: &[G]) -> Option<Gate> {
        let [a, b] = candidate.slots.map(|s| &poses[s as usize]);
        let relative = a.between(b);
        let e = candidate.measured.between(&relative).log();
        let covariance = self.relative(candidate.slots, &relative.inverse().adjoint());
        let jacobian = G::right_jacobian_inverse(&e);
        let noise = Cholesky::<f64, Const<N>>::new(candidate.information)?.inverse();
        let total = jacobian * covariance * jacobian.transpose() + noise;
        let factor = Cholesky::<f64, Const<N>>::new((total + total.transpose()) * 0.5)?;
        let whitened: SVector<f64, N> = factor.l().solve_lower_triangular(&e)?;
        Some(Gate {
            chi2: whitened.norm_squared(),
            log_det_half: (0..N).map(|k| factor.l_dirty()[(k, k)].ln()).sum(),
            turn: (turns_from(N)..N).map(|k| total[(k, k)]).fold(0.0, f64::max),
        })
    }

    /// Covariance of `a⁻¹ b` with `adjoint` that of `b⁻¹ a`.
    fn relative(&mut self, slots: [u32; 2], adjoint: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        let [a, b] = slots.map(|s| self.problem.columns[s as usize]);
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
    fn few_false_ones_are_expected_among_the_chosen() {
        let tested = |candidate, by_chance, passes| Tested { candidate, by_chance, passes };
        let list = [
            tested(0, 1e-4, true),
            tested(1, 1e-3, false),
            tested(2, 1e-3, true),
            tested(3, 0.5, true),
            tested(4, 1e-5, true),
        ];
        let mut chosen = choose(&list);
        chosen.sort_unstable();
        assert_eq!(chosen, [0, 2, 4]);
        assert!(choose(&list[3..4]).is_empty());
    }
}

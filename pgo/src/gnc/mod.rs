use std::collections::BTreeSet;

use draco_lie::{LieGroup, chi2};
use nalgebra::SMatrix;

use crate::optimizer::Outcome;
use crate::{Error, FactorId, Measurement, PoseGraph, Solution, SolveParams};

mod consensus;
mod schedule;
mod subproblem;

use consensus::Consensus;
use schedule::Schedule;
use subproblem::Subproblem;

/// The robust cost that graduated non-convexity ends at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum GncLoss {
    /// Truncated least squares: a measurement is in or out.
    #[default]
    TruncatedLeastSquares,
    /// Geman-McClure: far measurements fade.
    GemanMcClure,
}

/// Where graduated non-convexity starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum GncStart {
    /// From the known inliers, where they join all poses: measurements are taken in as soon as the uncertainty of
    /// what is known so far is small enough to tell a right one from a random one. The graduation begins with
    /// those. Elsewhere as [`GncStart::LeastSquares`].
    #[default]
    Consensus,
    /// From the least-squares optimum over all measurements, as published. Many outliers bend it so far that the
    /// graduation cannot recover, and make its equations dense.
    LeastSquares,
}

/// Parameters of [`gnc`].
#[derive(Debug, Clone, PartialEq)]
pub struct GncParams {
    /// The robust cost. Default: truncated least squares.
    pub loss: GncLoss,
    /// Where to start. Default: from the consensus with the known inliers.
    pub start: GncStart,
    /// Factors known to be right, such as odometry. Priors and user-defined factors always are.
    pub known_inliers: BTreeSet<FactorId>,
    /// Probability that of all right measurements none is lost to its noise: the largest squared residual of an inlier
    /// among `m` measurements is the chi-square quantile of `1 - (1 - inlier_probability) / m`. Default 0.999; lower
    /// it where information matrices are pessimistic.
    pub inlier_probability: f64,
    /// Factor by which the control parameter moves each round. Default 1.4, as published.
    pub control_step: f64,
    /// Largest number of rounds. Default 100.
    pub max_rounds: usize,
    /// Steps within a round. Default 2; the next round only needs a good start.
    pub steps_per_round: usize,
    /// The solver, for the first and the last optimisation; its kernel-free cost is what counts.
    pub solver: SolveParams,
}

impl Default for GncParams {
    fn default() -> Self {
        Self {
            loss: GncLoss::default(),
            start: GncStart::default(),
            known_inliers: BTreeSet::new(),
            inlier_probability: 0.999,
            control_step: 1.4,
            max_rounds: 100,
            steps_per_round: 2,
            solver: SolveParams::default(),
        }
    }
}

/// What [`gnc`] found.
#[derive(Debug, Clone)]
pub struct GncSolution<G> {
    /// The optimum over the accepted factors; costs are of the weighted problem.
    pub solution: Solution<G>,
    /// Relative poses accepted, ascending.
    pub inliers: Vec<FactorId>,
    /// Relative poses rejected, ascending.
    pub outliers: Vec<FactorId>,
    /// Rounds.
    pub rounds: usize,
}

/// A relative pose that may be an outlier.
struct Candidate<G, const N: usize> {
    id: FactorId,
    slots: [u32; 2],
    measured: G,
    information: SMatrix<f64, N, N>,
}

impl<const N: usize, G: LieGroup<N>> Candidate<G, N> {
    fn chi2(&self, poses: &[G]) -> f64 {
        let [a, b] = self.slots.map(|s| &poses[s as usize]);
        let e = self.measured.between(&a.between(b)).log();
        e.dot(&(self.information * e))
    }
}

/// Minimises a robust cost by graduated non-convexity, from a convex start to the true cost. Measurements whose
/// weight is zero take no part, so outliers do not fill the equations; one ordering and one symbolic factorisation
/// serve while the same measurements take part.
///
/// Kernels of the graph's factors are kept on what is accepted.
///
/// **Source**: Yang, Antonante, Tzoumas, Carlone, *Graduated Non-Convexity for Robust Spatial Perception*, 2020.
/// We differ in the start ([`GncStart::Consensus`]), in taking a few steps a round instead of optimising to the end,
/// in checking the verdict against the optimum it leads to until it stands, and in looking once more at what was
/// rejected, with the uncertainty of the poses that follow from what was accepted.
///
/// # Errors
/// Those of [`crate::solve`]; [`Error::Parameter`].
pub fn gnc<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    params: &GncParams,
) -> Result<GncSolution<G>, Error> {
    if !(params.control_step.is_finite() && params.control_step > 1.0) {
        return Err(Error::Parameter { name: "control_step", value: params.control_step });
    }
    let held = graph.gauge_keys(params.solver.gauge)?;
    let candidates = candidates(graph, params)?;
    let limit = limit::<N>(params.inlier_probability, candidates.len())?;
    let mut run = Run { graph, params, held: &held, candidates: &candidates, limit, sub: None };
    let mut poses = graph.poses.clone();
    let initial = graph.cost();
    let started = match params.start {
        GncStart::Consensus => consensus::consensus(&run, &mut poses)?,
        GncStart::LeastSquares => None,
    };
    let mut schedule = Schedule::new(params, limit);
    let mut weights = match &started {
        Some(consensus) => {
            schedule.after_consensus();
            consensus.weights()
        }
        None => {
            // with the outliers in, an optimum is worth nothing: a few steps find what has to be graduated
            let weights = vec![1.0; candidates.len()];
            run.optimise(&weights, &mut poses, START_STEPS)?;
            schedule.start_convex(run.chi2(&poses).fold(0.0, f64::max));
            weights
        }
    };
    while schedule.reweigh(run.chi2(&poses), &mut weights) && schedule.count < params.max_rounds {
        run.optimise(&weights, &mut poses, params.steps_per_round.max(1))?;
    }
    schedule.decide(run.chi2(&poses), &mut weights);
    let mut last = run.settle(&schedule, &mut weights, &mut poses)?;
    let mut consensus = started.unwrap_or_else(|| Consensus::new(candidates.len()));
    consensus.accepted.iter_mut().zip(&weights).for_each(|(inside, w)| *inside = *w > 0.5);
    for _ in 0..READMISSIONS {
        let before = consensus.accepted.clone();
        consensus::readmit(&run, &mut poses, &mut consensus)?;
        if consensus.accepted == before {
            break;
        }
        weights = consensus.weights();
        last = run.settle(&schedule, &mut weights, &mut poses)?;
        consensus.accepted.iter_mut().zip(&weights).for_each(|(inside, w)| *inside = *w > 0.5);
    }
    let solution = Solution::new(graph, &poses, held.clone(), Outcome { initial, ..last });
    let (inliers, outliers) = verdict(graph, &candidates, &weights);
    Ok(GncSolution { solution, inliers, outliers, rounds: schedule.count })
}

/// Steps of the first optimisation from least squares.
const START_STEPS: usize = 10;
/// Times the verdict is checked against the optimum it leads to.
const RECHECKS: usize = 10;
/// Times what was rejected is looked at again.
const READMISSIONS: usize = 5;

/// Largest squared residual of an inlier.
fn limit<const N: usize>(probability: f64, candidates: usize) -> Result<f64, Error> {
    let refused = Error::Parameter { name: "inlier_probability", value: probability };
    if !(probability > 0.0 && probability < 1.0) {
        return Err(refused);
    }
    chi2::quantile(1.0 - (1.0 - probability) / candidates.max(1) as f64, N).map_err(|_| refused)
}

fn candidates<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    params: &GncParams,
) -> Result<Vec<Candidate<G, N>>, Error> {
    let mut candidates = Vec::new();
    for (id, factor) in graph.factors() {
        if let Measurement::Between { from, to, measured } = &factor.measurement
            && !params.known_inliers.contains(&id)
        {
            let slots = [graph.slot(*from)? as u32, graph.slot(*to)? as u32];
            candidates.push(Candidate { id, slots, measured: *measured, information: factor.information });
        }
    }
    Ok(candidates)
}

fn verdict<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    candidates: &[Candidate<G, N>],
    weights: &[f64],
) -> (Vec<FactorId>, Vec<FactorId>) {
    let outside: BTreeSet<FactorId> =
        candidates.iter().zip(weights).filter(|(_, w)| **w <= 0.5).map(|(c, _)| c.id).collect();
    let betweens = graph.factors().filter(|(_, f)| matches!(f.measurement, Measurement::Between { .. }));
    let inliers = betweens.map(|(id, _)| id).filter(|id| !outside.contains(id)).collect();
    (inliers, outside.into_iter().collect())
}

/// What all stages share.
struct Run<'a, G, const N: usize> {
    graph: &'a PoseGraph<G, N>,
    params: &'a GncParams,
    held: &'a [crate::Key],
    candidates: &'a [Candidate<G, N>],
    /// Largest squared residual of an inlier.
    limit: f64,
    sub: Option<Subproblem<G, N>>,
}

impl<const N: usize, G: LieGroup<N>> Run<'_, G, N> {
    /// Squared residuals of the candidates.
    fn chi2<'p>(&'p self, poses: &'p [G]) -> impl Iterator<Item = f64> + 'p {
        self.candidates.iter().map(|c| c.chi2(poses))
    }

    /// Optimises over what is accepted, and corrects the verdict until it agrees with the optimum it leads to.
    fn settle(
        &mut self,
        schedule: &Schedule<'_>,
        weights: &mut [f64],
        poses: &mut [G],
    ) -> Result<Outcome, Error> {
        let steps = self.params.solver.max_iterations;
        let mut last = self.optimise(weights, poses, steps)?;
        for _ in 0..RECHECKS {
            if !schedule.recheck(self.chi2(poses), weights) {
                break;
            }
            last = self.optimise(weights, poses, steps)?;
        }
        Ok(last)
    }

    /// Takes some steps on the weighted problem, laid out anew only when the measurements that take part call for
    /// it.
    fn optimise(&mut self, weights: &[f64], poses: &mut [G], steps: usize) -> Result<Outcome, Error> {
        let mut sub = match self.sub.take().filter(|sub| sub.serves(weights)) {
            Some(sub) => sub,
            None => Subproblem::new(self.graph, self.held, self.candidates, weights)?,
        };
        sub.weigh(weights);
        let params = SolveParams { max_iterations: steps, ..self.params.solver.clone() };
        let outcome = sub.optimise(self.graph, &params, poses)?;
        self.sub = Some(sub);
        Ok(outcome)
    }
}

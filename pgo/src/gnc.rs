use std::collections::BTreeSet;

use draco_lie::{LieGroup, chi2};

use crate::optimizer::Optimizer;
use crate::problem::Problem;
use crate::sparse::Cholesky;
use crate::{Error, FactorId, PoseGraph, Solution, SolveParams};

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

/// Parameters of [`gnc`].
#[derive(Debug, Clone, PartialEq)]
pub struct GncParams {
    /// The robust cost. Default: truncated least squares.
    pub loss: GncLoss,
    /// Factors known to be right, such as odometry. Priors and user-defined factors always are.
    pub known_inliers: BTreeSet<FactorId>,
    /// Probability with which a right measurement shall be accepted. Default 0.99; its chi-square quantile is the
    /// largest squared residual of an inlier.
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
            known_inliers: BTreeSet::new(),
            inlier_probability: 0.99,
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

/// Minimises a robust cost by graduated non-convexity, from a convex start to the true cost; no first guess of
/// which measurements are right is needed. One ordering and one symbolic factorisation serve all rounds.
///
/// **Source**: Yang, Antonante, Tzoumas, Carlone, *Graduated Non-Convexity for Robust Spatial Perception*, 2020.
/// We differ in taking a few steps a round instead of optimising to the end, and in checking the verdict against
/// the optimum it leads to until it stands.
///
/// # Errors
/// Those of [`crate::solve`]; [`Error::Parameter`].
pub fn gnc<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    params: &GncParams,
) -> Result<GncSolution<G>, Error> {
    let limit = chi2::quantile(params.inlier_probability, N)
        .map_err(|_| Error::Parameter { name: "inlier_probability", value: params.inlier_probability })?;
    if !(params.control_step.is_finite() && params.control_step > 1.0) {
        return Err(Error::Parameter { name: "control_step", value: params.control_step });
    }
    let held = graph.gauge_keys(params.solver.gauge)?;
    let mut problem = Problem::new(graph, &held)?;
    let mut cholesky = problem.cholesky();
    let mut rounds = Rounds::new(&problem, params, limit);
    let mut poses = graph.poses.clone();
    let failed = |slot: usize| Error::Indefinite { key: graph.keys[slot] };
    let optimise =
        |problem: &mut Problem<G, N>, cholesky: &mut Cholesky<N>, params: &SolveParams, x: &mut [G]| {
            Optimizer::new(problem, cholesky, params).run(x).map_err(failed)
        };
    // with the outliers in, an optimum is worth nothing: a few steps find what has to be graduated
    let start = SolveParams { max_iterations: START_STEPS, ..params.solver.clone() };
    let first = optimise(&mut problem, &mut cholesky, &start, &mut poses)?;
    let few = SolveParams { max_iterations: params.steps_per_round.max(1), ..params.solver.clone() };
    rounds.start(&problem, &poses);
    while rounds.reweigh(&mut problem, &poses) && rounds.count < params.max_rounds {
        optimise(&mut problem, &mut cholesky, &few, &mut poses)?;
    }
    rounds.decide(&mut problem, &poses);
    let mut last = optimise(&mut problem, &mut cholesky, &params.solver, &mut poses)?;
    for _ in 0..RECHECKS {
        if !rounds.recheck(&mut problem, &poses) {
            break;
        }
        last = optimise(&mut problem, &mut cholesky, &params.solver, &mut poses)?;
    }
    let outcome = crate::optimizer::Outcome { initial: first.initial, ..last };
    let (inliers, outliers) = rounds.verdict();
    let solution = Solution::new(graph, &poses, held, outcome);
    Ok(GncSolution { solution, inliers, outliers, rounds: rounds.count })
}

/// Steps of the first optimisation.
const START_STEPS: usize = 10;
/// Times the verdict is checked against the optimum it leads to.
const RECHECKS: usize = 10;

struct Rounds<'a> {
    params: &'a GncParams,
    /// Largest squared residual of an inlier.
    limit: f64,
    ids: Vec<FactorId>,
    open: Vec<bool>,
    weights: Vec<f64>,
    control: f64,
    count: usize,
}

impl<'a> Rounds<'a> {
    fn new<const N: usize, G: LieGroup<N>>(
        problem: &Problem<G, N>,
        params: &'a GncParams,
        limit: f64,
    ) -> Self {
        let ids: Vec<FactorId> = problem.between_ids().collect();
        let open = ids.iter().map(|id| !params.known_inliers.contains(id)).collect();
        Self { params, limit, weights: vec![1.0; ids.len()], ids, open, control: 1.0, count: 0 }
    }

    /// The control parameter at which the surrogate cost is convex over all residuals.
    fn start<const N: usize, G: LieGroup<N>>(&mut self, problem: &Problem<G, N>, poses: &[G]) {
        let worst = (0..self.ids.len())
            .filter(|i| self.open[*i])
            .map(|i| problem.between_chi2(i, poses))
            .fold(0.0, f64::max);
        self.control = match self.params.loss {
            GncLoss::TruncatedLeastSquares if worst <= self.limit => f64::INFINITY,
            GncLoss::TruncatedLeastSquares => self.limit / (2.0 * worst - self.limit),
            GncLoss::GemanMcClure => 2.0 * worst / self.limit,
        };
    }

    /// Sets the weights for the poses; `false` when all is decided.
    fn reweigh<const N: usize, G: LieGroup<N>>(&mut self, problem: &mut Problem<G, N>, poses: &[G]) -> bool {
        let mut undecided = false;
        let mut worst: f64 = 0.0;
        for i in (0..self.ids.len()).filter(|i| self.open[*i]) {
            let chi2 = problem.between_chi2(i, poses);
            worst = worst.max(chi2);
            let weight = self.weight(chi2);
            undecided |= (1e-4..1.0 - 1e-4).contains(&weight);
            self.weights[i] = weight;
            problem.set_scale(i, weight);
        }
        self.count += 1;
        match self.params.loss {
            GncLoss::TruncatedLeastSquares => {
                self.control *= self.params.control_step;
                undecided
            }
            GncLoss::GemanMcClure => {
                let more = self.control > 1.0;
                self.control = (self.control / self.params.control_step).max(1.0);
                more
            }
        }
    }

    fn weight(&self, chi2: f64) -> f64 {
        let (mu, limit) = (self.control, self.limit);
        match self.params.loss {
            GncLoss::TruncatedLeastSquares if mu.is_infinite() => f64::from(chi2 <= limit),
            GncLoss::TruncatedLeastSquares => {
                if chi2 >= (mu + 1.0) / mu * limit {
                    0.0
                } else if chi2 <= mu / (mu + 1.0) * limit {
                    1.0
                } else {
                    ((limit * mu * (mu + 1.0) / chi2).sqrt() - mu).clamp(0.0, 1.0)
                }
            }
            GncLoss::GemanMcClure => {
                let scaled = mu * limit;
                (scaled / (chi2 + scaled)).powi(2)
            }
        }
    }

    /// Rounds what is still open: a measurement is in when its residual is an inlier's.
    fn decide<const N: usize, G: LieGroup<N>>(&mut self, problem: &mut Problem<G, N>, poses: &[G]) {
        for i in (0..self.ids.len()).filter(|i| self.open[*i]) {
            let inside = match self.params.loss {
                GncLoss::TruncatedLeastSquares => self.weights[i] > 0.5,
                GncLoss::GemanMcClure => problem.between_chi2(i, poses) <= self.limit,
            };
            self.weights[i] = f64::from(inside);
            problem.set_scale(i, self.weights[i]);
        }
    }

    /// Takes in what agrees with the optimum and throws out what does not; `false` when nothing changes.
    fn recheck<const N: usize, G: LieGroup<N>>(&mut self, problem: &mut Problem<G, N>, poses: &[G]) -> bool {
        let mut changed = false;
        for i in (0..self.ids.len()).filter(|i| self.open[*i]) {
            let inside = f64::from(problem.between_chi2(i, poses) <= self.limit);
            changed |= inside != self.weights[i];
            self.weights[i] = inside;
            problem.set_scale(i, inside);
        }
        changed
    }

    fn verdict(&self) -> (Vec<FactorId>, Vec<FactorId>) {
        let pairs = || self.ids.iter().copied().zip(&self.weights);
        (
            pairs().filter(|(_, w)| **w > 0.5).map(|(id, _)| id).collect(),
            pairs().filter(|(_, w)| **w <= 0.5).map(|(id, _)| id).collect(),
        )
    }
}

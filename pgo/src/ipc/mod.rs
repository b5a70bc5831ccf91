//! Incremental consensus: closures are tested one by one against all that was believed before.

mod block;

use std::collections::BTreeSet;

use draco_lie::{LieGroup, chi2};

use self::block::{Block, Part};
use crate::{Error, FactorId, Key, Measurement, PoseGraph, SolveParams, Termination, solve};

/// Parameters of [`Ipc`].
#[derive(Debug, Clone, PartialEq)]
pub struct IpcParams {
    /// Probability with which a right closure passes each of the two tests. Default 0.999. The rise of the sum of
    /// all squared residuals, which the closure and the loops behind it share as they like, is held to the
    /// chi-square quantile of it; each of `m` factors to that of `1 - (1 - confidence) / m`, so that large loops are
    /// not rejected for having many factors.
    pub confidence: f64,
    /// The solver of the subproblems. Default: that of [`crate::solve`].
    pub solver: SolveParams,
}

impl Default for IpcParams {
    fn default() -> Self {
        Self { confidence: 0.999, solver: SolveParams::default() }
    }
}

/// Why [`Ipc`] believes a closure, or not.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum IpcVerdict {
    /// Every factor of the subgraph passes with the closure in it.
    Accepted {
        /// Factors tested, the closure included.
        tested: usize,
    },
    /// The closure joins parts that nothing joined before, so nothing can speak against it; accepted.
    Unopposed,
    /// A factor does not pass once the closure is in.
    Rejected {
        /// The closure itself when the squared residuals rise too much in sum; else the factor with the largest
        /// excess: odometry, or a closure accepted before.
        veto: FactorId,
        /// The rise, or the factor's squared whitened residual.
        chi2: f64,
        /// The largest that would have passed.
        limit: f64,
    },
}

impl IpcVerdict {
    /// Whether the closure was taken in.
    pub fn is_accepted(self) -> bool {
        !matches!(self, IpcVerdict::Rejected { .. })
    }
}

/// Incremental consensus over a pose graph.
///
/// The graph holds what is believed. A new closure is put to the test on the smallest part of the graph that it
/// influences: the factors that share a loop with it. That part is optimised with the closure in it. The sum of
/// squared residuals must not rise by more than one measurement's noise explains, and every factor must pass a
/// chi-square test; so accepted closures keep a veto. Order matters: what comes first is believed first.
///
/// **Source**: Olivastri, Pretto, *IPC: Incremental Probabilistic Consensus-based Consistent Set Maximization for
/// SLAM Backends*, 2024. We differ in finding the independent part as a biconnected component, which needs no
/// chain of odometry and serves several robots and closures between them; in testing single factors at a level that
/// accounts for their number; and in testing the rise of the sum, without which a long loop of loose odometry
/// swallows any closure.
#[derive(Debug, Clone)]
pub struct Ipc<G, const N: usize> {
    params: IpcParams,
    graph: PoseGraph<G, N>,
}

/// Outcome of [`ipc`].
#[derive(Debug, Clone)]
pub struct IpcSolution<G, const N: usize> {
    /// The graph without the rejected closures, optimised.
    pub graph: PoseGraph<G, N>,
    /// Closures accepted, in the order they were tested.
    pub accepted: Vec<FactorId>,
    /// Closures rejected, with the reason.
    pub rejected: Vec<(FactorId, IpcVerdict)>,
}

impl<const N: usize, G: LieGroup<N>> Ipc<G, N> {
    /// Starts from a graph whose factors are believed: odometry and priors, at their optimum.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn new(graph: PoseGraph<G, N>, params: IpcParams) -> Result<Self, Error> {
        limit::<N>(params.confidence, 1)?;
        Ok(Self { params, graph })
    }

    /// What is believed, with the present estimates.
    pub fn graph(&self) -> &PoseGraph<G, N> {
        &self.graph
    }

    /// The same, to add poses and odometry to. New poses need a first guess that agrees with their odometry.
    pub fn graph_mut(&mut self) -> &mut PoseGraph<G, N> {
        &mut self.graph
    }

    /// Gives up the consensus for its graph.
    pub fn into_graph(self) -> PoseGraph<G, N> {
        self.graph
    }

    /// Tests a factor that is in the graph already; it stays when it is accepted and is removed when it is not.
    ///
    /// Costs one optimisation of the factors that share a loop with it.
    ///
    /// # Errors
    /// [`Error::UnknownFactor`]; those of [`crate::solve`], and then the factor is removed.
    pub fn test(&mut self, closure: FactorId) -> Result<IpcVerdict, Error> {
        let Some(block) = Block::around(&self.graph, closure)? else { return Ok(IpcVerdict::Unopposed) };
        let part = block.extract(&self.graph)?;
        let solution = match solve(&part.graph, &self.params.solver) {
            Ok(solution) => solution,
            Err(error) => {
                self.graph.remove_factor(closure)?;
                return Err(error);
            }
        };
        let mut solved = part.graph.clone();
        solved.update(&solution);
        if let Some((veto, chi2, limit)) = self.objection(closure, &part, &solved)? {
            self.graph.remove_factor(closure)?;
            return Ok(IpcVerdict::Rejected { veto, chi2, limit });
        }
        if solution.termination == Termination::MaxIterations {
            tracing::debug!(closure = closure.0, "a subproblem passed before it had converged");
        }
        block.settle(&mut self.graph, &solution);
        Ok(IpcVerdict::Accepted { tested: part.factors.len() })
    }

    /// What speaks against a closure: who, its squared residual or rise, and the largest that passes.
    fn objection(
        &self,
        closure: FactorId,
        part: &Part<G, N>,
        solved: &PoseGraph<G, N>,
    ) -> Result<Option<(FactorId, f64, f64)>, Error> {
        let limit_of_sum = limit::<N>(self.params.confidence, 1)?;
        let limit_of_each = limit::<N>(self.params.confidence, part.factors.len())?;
        let (mut rise, mut worst) = (0.0, None);
        for (own, original) in &part.factors {
            let chi2 = solved.chi2(*own).unwrap_or(0.0);
            let before = if *original == closure { 0.0 } else { part.graph.chi2(*own).unwrap_or(0.0) };
            rise += chi2 - before;
            let fails = chi2.is_nan() || chi2 > limit_of_each;
            if fails && worst.is_none_or(|(_, w)| chi2 > w || chi2.is_nan()) {
                worst = Some((*original, chi2));
            }
        }
        if rise.is_nan() || rise > limit_of_sum {
            return Ok(Some((closure, rise, limit_of_sum)));
        }
        Ok(worst.map(|(veto, chi2)| (veto, chi2, limit_of_each)))
    }
}

/// Largest squared residual of each of `factors` factors that pass together with probability `confidence`.
fn limit<const N: usize>(confidence: f64, factors: usize) -> Result<f64, Error> {
    let failed = |_| Error::Parameter { name: "confidence", value: confidence };
    if !(confidence > 0.0 && confidence < 1.0) {
        return Err(Error::Parameter { name: "confidence", value: confidence });
    }
    chi2::quantile(1.0 - (1.0 - confidence) / factors.max(1) as f64, N).map_err(failed)
}

/// Tests all relative poses of `graph` that are not in `believed`, in the order of their later poses, as they
/// would have come up on the way; then optimises the graph with the accepted ones.
///
/// * `believed` – relative poses not to be questioned, such as odometry. Priors and user-defined factors never
///   are.
///
/// The believed factors alone must hold each part of the graph together that is to be tested.
///
/// # Errors
/// Those of [`crate::solve`]; [`Error::Parameter`].
pub fn ipc<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    believed: &BTreeSet<FactorId>,
    params: &IpcParams,
) -> Result<IpcSolution<G, N>, Error> {
    let mut closures: Vec<(Key, FactorId)> = Vec::new();
    let mut start = graph.clone();
    for (id, factor) in graph.factors() {
        if let Measurement::Between { from, to, .. } = &factor.measurement
            && !believed.contains(&id)
        {
            closures.push((*from.max(to), id));
            start.remove_factor(id)?;
        }
    }
    closures.sort_unstable();
    crate::spanning_tree(&mut start)?;
    let solution = solve(&start, &params.solver)?;
    start.update(&solution);
    let mut consensus = Ipc::new(start, params.clone())?;
    let (mut accepted, mut rejected) = (Vec::new(), Vec::new());
    for (_, id) in closures {
        let Some(factor) = graph.factor(id) else { continue };
        consensus.graph.restore_factor(id, factor.clone());
        match consensus.test(id)? {
            verdict if verdict.is_accepted() => accepted.push(id),
            verdict => rejected.push((id, verdict)),
        }
    }
    let mut graph = consensus.into_graph();
    let solution = solve(&graph, &params.solver)?;
    graph.update(&solution);
    Ok(IpcSolution { graph, accepted, rejected })
}

use std::any::Any;

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3};

use crate::optimizer::{Optimizer, Outcome};
use crate::problem::Problem;
use crate::{ChordalPose, Error, Key, PoseGraph, chordal};

/// How steps are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Method {
    /// Full steps, whatever they do to the cost. Fast near the optimum; can diverge from a bad start.
    GaussNewton,
    /// Damped steps that never raise the cost. The first trial of the first iteration is the undamped step, so
    /// from a good start this is Gauss-Newton.
    #[default]
    LevenbergMarquardt,
    /// Powell's dogleg in a trust region that starts unbounded, so the first trial is the full step. A rejected
    /// step costs no new factorisation.
    Dogleg,
}

/// What to do about a connected part of the graph that no prior and no fixed pose holds in place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Gauge {
    /// Hold the smallest key of each such part at its present value.
    #[default]
    HoldFirst,
    /// Refuse with [`Error::NoGauge`].
    Require,
}

/// Where to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Start {
    /// The present poses of the graph; when the first step from there realises less than a quarter of what it
    /// promises, and the chordal relaxation costs less than where that step leads, the relaxation instead. Costs
    /// nothing when the start is good. Rotations alone (graphs over SO(2) and SO(3)) start as given.
    #[default]
    Auto,
    /// The present poses of the graph, whatever they are.
    Given,
}

/// Parameters of [`solve`].
#[derive(Debug, Clone, PartialEq)]
pub struct SolveParams {
    /// How steps are computed. Default: Levenberg-Marquardt.
    pub method: Method,
    /// Where to start from. Default: the present poses, or the chordal relaxation when they are bad.
    pub start: Start,
    /// What to do about parts without an anchor. Default: hold their first pose.
    pub gauge: Gauge,
    /// Largest number of linearisations. Default 100.
    pub max_iterations: usize,
    /// Stop when the cost that remains to be gained, estimated from the last steps, is below this fraction of
    /// the cost. Default 1e-8: a hundredth of what published figures are compared by.
    pub relative_tolerance: f64,
    /// Stop when the cost is below this. Default 1e-18, rounding noise of a few thousand exact factors.
    pub absolute_tolerance: f64,
}

impl Default for SolveParams {
    fn default() -> Self {
        Self {
            method: Method::default(),
            start: Start::default(),
            gauge: Gauge::default(),
            max_iterations: 100,
            relative_tolerance: 1e-8,
            absolute_tolerance: 1e-18,
        }
    }
}

/// Why an optimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Termination {
    /// Nothing worth having is left to gain.
    Converged,
    /// The number of iterations ran out.
    MaxIterations,
    /// No step, however short, lowers the cost, though the gradient says one should: rounding, or a wrong
    /// Jacobian of a user-defined factor.
    Stalled,
    /// Gauss-Newton left the region where its model holds: the cost is no longer finite, or has grown a
    /// million-fold. The best poses seen are returned.
    Diverged,
}

/// Where an optimisation ended.
#[derive(Debug, Clone)]
pub struct Solution<G> {
    /// Keys, ascending.
    keys: Vec<Key>,
    poses: Vec<G>,
    /// Poses that [`Gauge::HoldFirst`] held.
    pub held: Vec<Key>,
    /// Cost `½ Σ ρ` at the start.
    pub initial_cost: f64,
    /// Cost at the end.
    pub final_cost: f64,
    /// Linearisations.
    pub iterations: usize,
    /// Why it ended.
    pub termination: Termination,
    /// Whether the poses given were so bad a start that the chordal relaxation was taken ([`Start::Auto`]).
    pub restarted: bool,
}

impl<G> Solution<G> {
    pub(crate) fn new<const N: usize>(
        graph: &PoseGraph<G, N>,
        poses: &[G],
        held: Vec<Key>,
        outcome: Outcome,
    ) -> Self
    where
        G: LieGroup<N>,
    {
        Self {
            keys: graph.slots.keys().copied().collect(),
            poses: graph.slots.values().map(|slot| poses[*slot as usize]).collect(),
            held,
            initial_cost: outcome.initial,
            final_cost: outcome.cost,
            iterations: outcome.iterations,
            termination: outcome.termination,
            restarted: outcome.restarted,
        }
    }

    /// The optimised pose of `key`.
    pub fn pose(&self, key: Key) -> Option<&G> {
        self.keys.binary_search(&key).ok().map(|i| &self.poses[i])
    }

    /// All optimised poses, ascending by key.
    pub fn poses(&self) -> impl Iterator<Item = (Key, &G)> {
        self.keys.iter().copied().zip(&self.poses)
    }
}

impl<const N: usize, G: LieGroup<N>> PoseGraph<G, N> {
    /// Makes the poses of a solution the present values; keys the graph does not hold are passed over.
    pub fn update(&mut self, solution: &Solution<G>) {
        for (key, pose) in solution.poses() {
            if let Ok(slot) = self.slot(key) {
                self.poses[slot] = *pose;
            }
        }
    }

    /// The poses to hold so that every part has an anchor.
    pub(crate) fn gauge_keys(&self, gauge: Gauge) -> Result<Vec<Key>, Error> {
        if self.pose_count() == 0 {
            return Err(Error::EmptyGraph);
        }
        if gauge == Gauge::Require {
            self.check_gauge()?;
        }
        let loose = self.components().into_iter().filter(|c| !c.anchored);
        Ok(loose.filter_map(|c| c.keys.first().copied()).collect())
    }
}

/// Minimises the cost of `graph` over its free poses, from their present values.
///
/// The elimination order that is found for it stays with the graph: the next solution, the chordal start, marginals and
/// the certificate take it over as long as the same poses are joined. What comes out does not depend on that.
///
/// # Errors
/// [`Error::EmptyGraph`]; [`Error::NoGauge`] with [`Gauge::Require`]; [`Error::Parameter`];
/// [`Error::Indefinite`] when some pose is not determined by the factors (Gauss-Newton only: damping decides
/// for the shortest step).
pub fn solve<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    params: &SolveParams,
) -> Result<Solution<G>, Error> {
    check(params)?;
    let held = graph.gauge_keys(params.gauge)?;
    let mut poses = graph.poses.clone();
    let outcome = optimise(graph, &held, params, &mut poses)?;
    Ok(Solution::new(graph, &poses, held, outcome))
}

/// Moves `poses`; what that takes in memory is given back at the end.
fn optimise<const N: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    held: &[Key],
    params: &SolveParams,
    poses: &mut [G],
) -> Result<Outcome, Error> {
    let mut problem = Problem::new(graph, held)?;
    if problem.free() == 0 {
        let cost = problem.cost(poses);
        return Ok(Outcome { termination: Termination::Converged, ..Outcome::at_start(cost) });
    }
    let mut cholesky = problem.cholesky(&graph.elimination);
    let mut optimizer = Optimizer::new(&mut problem, &mut cholesky, params);
    if params.start == Start::Auto {
        optimizer = optimizer.with_rescue(Box::new(|| relaxed(graph, held)));
    }
    optimizer.run(poses).map_err(|slot| Error::Indefinite { key: graph.keys[slot] })
}

/// The poses of the chordal relaxation, where there is one for the group. Held poses stay.
fn relaxed<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, held: &[Key]) -> Option<Vec<G>> {
    fn relax<const M: usize, H: ChordalPose<M>, const N: usize, G: LieGroup<N>>(
        graph: &PoseGraph<G, N>,
        held: &[Key],
    ) -> Option<Vec<G>> {
        let graph: &dyn Any = graph;
        let mut graph: PoseGraph<H, M> = graph.downcast_ref::<PoseGraph<H, M>>()?.clone();
        held.iter().try_for_each(|key| graph.set_fixed(*key, true)).ok()?;
        chordal(&mut graph).ok()?;
        let poses: Box<dyn Any> = Box::new(graph.poses);
        poses.downcast::<Vec<G>>().ok().map(|poses| *poses)
    }
    relax::<3, Isometry2<f64>, N, G>(graph, held).or_else(|| relax::<6, Isometry3<f64>, N, G>(graph, held))
}

fn check(params: &SolveParams) -> Result<(), Error> {
    for (name, value) in
        [("relative_tolerance", params.relative_tolerance), ("absolute_tolerance", params.absolute_tolerance)]
    {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::Parameter { name, value });
        }
    }
    Ok(())
}

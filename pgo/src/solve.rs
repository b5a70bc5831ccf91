use draco_lie::LieGroup;
use nalgebra::SVector;

use crate::problem::Problem;
use crate::sparse::Cholesky;
use crate::{Error, Key, PoseGraph};

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

/// Parameters of [`solve`].
#[derive(Debug, Clone, PartialEq)]
pub struct SolveParams {
    /// How steps are computed. Default: Levenberg-Marquardt.
    pub method: Method,
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
}

impl<G> Solution<G> {
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
    let mut problem = Problem::new(graph, &held)?;
    let mut poses = graph.poses.clone();
    let outcome = if problem.free() == 0 {
        let cost = problem.cost(&poses);
        Outcome { initial: cost, cost, iterations: 0, termination: Termination::Converged }
    } else {
        let mut cholesky = problem.cholesky();
        Optimizer::new(&mut problem, &mut cholesky, params)
            .run(&mut poses)
            .map_err(|slot| Error::Indefinite { key: graph.keys[slot] })?
    };
    Ok(Solution {
        keys: graph.slots.keys().copied().collect(),
        poses: graph.slots.values().map(|slot| poses[*slot as usize]).collect(),
        held,
        initial_cost: outcome.initial,
        final_cost: outcome.cost,
        iterations: outcome.iterations,
        termination: outcome.termination,
    })
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

#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome {
    pub(crate) initial: f64,
    pub(crate) cost: f64,
    pub(crate) iterations: usize,
    pub(crate) termination: Termination,
}

/// Smallest and largest damping of Levenberg-Marquardt, relative to the diagonal of the Hessian; below the
/// smallest the step is undamped.
const DAMPING: (f64, f64) = (1e-9, 1e12);
/// Least share of the predicted gain a step must realise to be taken.
const ACCEPT: f64 = 1e-3;

/// The iteration of [`solve`] with all of its memory: after construction nothing is allocated.
pub(crate) struct Optimizer<'a, G, const N: usize> {
    problem: &'a mut Problem<G, N>,
    cholesky: &'a mut Cholesky<N>,
    params: &'a SolveParams,
    step: Vec<SVector<f64, N>>,
    damping: Vec<SVector<f64, N>>,
    trial: Vec<G>,
}

impl<'a, const N: usize, G: LieGroup<N>> Optimizer<'a, G, N> {
    pub(crate) fn new(
        problem: &'a mut Problem<G, N>,
        cholesky: &'a mut Cholesky<N>,
        params: &'a SolveParams,
    ) -> Self {
        let zero = vec![SVector::zeros(); problem.free()];
        Self { problem, cholesky, params, step: zero.clone(), damping: zero, trial: Vec::new() }
    }

    /// Iterates from `poses`, which hold the best found in the end.
    ///
    /// # Errors
    /// The slot of a pose whose Hessian is not positive definite.
    pub(crate) fn run(&mut self, poses: &mut [G]) -> Result<Outcome, usize> {
        self.trial = poses.to_vec();
        match self.params.method {
            Method::GaussNewton => self.gauss_newton(poses),
            Method::LevenbergMarquardt => self.levenberg_marquardt(poses),
        }
    }

    fn gauss_newton(&mut self, best: &mut [G]) -> Result<Outcome, usize> {
        let mut poses = best.to_vec();
        let mut cost = self.problem.linearise(&poses);
        let mut outcome =
            Outcome { initial: cost, cost, iterations: 0, termination: Termination::MaxIterations };
        let mut progress = Progress::default();
        while outcome.iterations < self.params.max_iterations {
            outcome.iterations += 1;
            let predicted = self.solve_step(0.0).map_err(|c| self.problem.slots[c] as usize)?;
            self.apply(&poses);
            std::mem::swap(&mut poses, &mut self.trial);
            let next = self.problem.linearise(&poses);
            let gain = cost - next;
            cost = next;
            if cost <= outcome.cost {
                outcome.cost = cost;
                best.copy_from_slice(&poses);
            }
            if !cost.is_finite() || cost > 1e6 * outcome.initial.max(1.0) {
                outcome.termination = Termination::Diverged;
                break;
            }
            if progress.finished(gain.abs(), predicted, cost, self.params) {
                outcome.termination = Termination::Converged;
                break;
            }
        }
        Ok(outcome)
    }

    fn levenberg_marquardt(&mut self, poses: &mut [G]) -> Result<Outcome, usize> {
        let mut cost = self.problem.linearise(poses);
        let mut outcome =
            Outcome { initial: cost, cost, iterations: 0, termination: Termination::MaxIterations };
        let (mut lambda, mut growth) = (0.0, 4.0);
        let mut progress = Progress::default();
        while outcome.iterations < self.params.max_iterations {
            outcome.iterations += 1;
            let (mut predicted, mut next) = (0.0, f64::INFINITY);
            while lambda <= DAMPING.1 {
                if let Ok(gain) = self.solve_step(lambda) {
                    predicted = gain;
                    self.apply(poses);
                    next = self.problem.cost(&self.trial);
                    let finished = predicted <= self.params.relative_tolerance * 1e-4 * cost;
                    if cost - next >= ACCEPT * predicted || finished {
                        break;
                    }
                }
                lambda = f64::max(lambda * growth, 1e-6);
                growth *= 2.0;
            }
            let gain = cost - next;
            if gain.is_nan() || gain < 0.0 {
                let tiny = predicted <= self.params.relative_tolerance * cost;
                outcome.termination = if tiny { Termination::Converged } else { Termination::Stalled };
                break;
            }
            poses.copy_from_slice(&self.trial);
            let trusted = gain >= 0.25 * predicted;
            if trusted {
                growth = 4.0;
                lambda = if lambda < DAMPING.0 { 0.0 } else { lambda / 10.0 };
            }
            cost = next;
            if progress.finished(gain, predicted, cost, self.params) && lambda < 1e-3 {
                outcome.termination = Termination::Converged;
                break;
            }
            self.problem.linearise(poses);
        }
        outcome.cost = cost;
        Ok(outcome)
    }

    /// Solves `(H + λ diag H) step = -gradient` and returns the gain of cost the model predicts.
    fn solve_step(&mut self, lambda: f64) -> Result<f64, usize> {
        let Self { problem, cholesky, step, damping, .. } = self;
        let extra = if lambda > 0.0 {
            for (d, h) in damping.iter_mut().zip(&problem.hessian.diagonal) {
                *d = h.diagonal() * lambda;
            }
            Some(damping.as_slice())
        } else {
            None
        };
        cholesky.factor(&problem.hessian, extra)?;
        for (x, g) in step.iter_mut().zip(&problem.gradient) {
            *x = -g;
        }
        cholesky.solve(step);
        // the model's gain is -gᵀx - ½ xᵀ H x with H x = -g - λ D x
        let mut gain = 0.0;
        for (i, (x, g)) in step.iter().zip(&problem.gradient).enumerate() {
            gain -= 0.5 * g.dot(x);
            if lambda > 0.0 {
                gain += 0.5 * x.component_mul(x).dot(&damping[i]);
            }
        }
        Ok(gain)
    }

    /// `trial = poses ⊞ step`.
    fn apply(&mut self, poses: &[G]) {
        for (step, slot) in self.step.iter().zip(&self.problem.slots) {
            let slot = *slot as usize;
            self.trial[slot] = poses[slot].plus(step).renormalize();
        }
    }
}

/// Decides from the gains of the last steps whether what remains is worth a further step.
#[derive(Debug, Default)]
struct Progress {
    last: Option<f64>,
}

impl Progress {
    fn finished(&mut self, gain: f64, predicted: f64, cost: f64, params: &SolveParams) -> bool {
        let enough = params.relative_tolerance * cost + params.absolute_tolerance;
        // gains shrink at least geometrically near the optimum, so the rest is about gain · q / (1 - q)
        let rate = self.last.map_or(1.0, |last| gain / last);
        self.last = Some(gain);
        let remaining = if rate < 0.5 { gain * rate / (1.0 - rate) } else { gain };
        cost <= params.absolute_tolerance
            || (remaining.abs() <= enough && predicted <= 1e4 * enough.max(gain))
    }
}

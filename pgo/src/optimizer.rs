use draco_lie::LieGroup;
use nalgebra::SVector;

use crate::problem::Problem;
use crate::sparse::Cholesky;
use crate::{Method, SolveParams, Termination};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome {
    pub(crate) initial: f64,
    pub(crate) cost: f64,
    pub(crate) iterations: usize,
    pub(crate) termination: Termination,
    /// Whether a better start than the given one was taken.
    pub(crate) restarted: bool,
}

impl Outcome {
    pub(crate) fn at_start(cost: f64) -> Self {
        let termination = Termination::MaxIterations;
        Self { initial: cost, cost, iterations: 0, termination, restarted: false }
    }
}

/// A first step that realises less than this share of the predicted gain tells that the start is bad.
const GOOD_START: f64 = 0.25;

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
    rescue: Option<Rescue<'a, G>>,
}

/// Finds other poses to start from.
pub(crate) type Rescue<'a, G> = Box<dyn FnOnce() -> Option<Vec<G>> + 'a>;

impl<'a, const N: usize, G: LieGroup<N>> Optimizer<'a, G, N> {
    pub(crate) fn new(
        problem: &'a mut Problem<G, N>,
        cholesky: &'a mut Cholesky<N>,
        params: &'a SolveParams,
    ) -> Self {
        let zero = vec![SVector::zeros(); problem.free()];
        Self { problem, cholesky, params, step: zero.clone(), damping: zero, trial: Vec::new(), rescue: None }
    }

    /// Has another start at hand, to be looked at when the first step goes wrong.
    pub(crate) fn with_rescue(mut self, rescue: Rescue<'a, G>) -> Self {
        self.rescue = Some(rescue);
        self
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
            Method::Dogleg => self.dogleg(poses),
        }
    }

    fn gauss_newton(&mut self, best: &mut [G]) -> Result<Outcome, usize> {
        let mut poses = best.to_vec();
        let mut cost = self.problem.linearise(&poses);
        let mut outcome = Outcome::at_start(cost);
        let mut progress = Progress::default();
        while outcome.iterations < self.params.max_iterations {
            outcome.iterations += 1;
            let predicted = self.solve_step(0.0).map_err(|c| self.problem.pattern.slots[c] as usize)?;
            self.apply(&poses);
            std::mem::swap(&mut poses, &mut self.trial);
            let mut next = self.problem.linearise(&poses);
            let mut gain = cost - next;
            if let Some(better) = self.restart(&mut poses, self.quality(gain, predicted, cost), next) {
                (next, gain) = (self.problem.linearise(&poses), cost - better);
                outcome.restarted = true;
            }
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
        let mut outcome = Outcome::at_start(cost);
        let (mut lambda, mut growth) = (0.0, 4.0);
        let mut progress = Progress::default();
        while outcome.iterations < self.params.max_iterations {
            outcome.iterations += 1;
            let (mut predicted, mut next, mut quality) = (0.0, f64::INFINITY, None);
            while lambda <= DAMPING.1 {
                if let Ok(gain) = self.solve_step(lambda) {
                    predicted = gain;
                    self.apply(poses);
                    next = self.problem.cost(&self.trial);
                    let finished = predicted <= self.params.relative_tolerance * 1e-4 * cost;
                    quality = quality.or(Some(self.quality(cost - next, predicted, cost)));
                    if cost - next >= ACCEPT * predicted || finished {
                        break;
                    }
                }
                lambda = f64::max(lambda * growth, 1e-6);
                growth *= 2.0;
            }
            if let Some(better) = self.restart(poses, quality.unwrap_or(0.0), next.min(cost)) {
                (cost, lambda, growth, outcome.restarted) = (better, 0.0, 4.0, true);
                self.problem.linearise(poses);
                continue;
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

    fn dogleg(&mut self, poses: &mut [G]) -> Result<Outcome, usize> {
        let mut cost = self.problem.linearise(poses);
        let mut outcome = Outcome::at_start(cost);
        let mut radius = f64::INFINITY;
        let mut progress = Progress::default();
        let mut full = self.step.clone();
        let mut steepest = self.step.clone();
        while outcome.iterations < self.params.max_iterations {
            outcome.iterations += 1;
            self.solve_step(0.0).map_err(|c| self.problem.pattern.slots[c] as usize)?;
            full.copy_from_slice(&self.step);
            self.cauchy_point(&mut steepest);
            let (mut predicted, mut gain, mut first_quality) = (0.0, f64::NAN, None);
            for _ in 0..60 {
                let length = self.choose(&full, &steepest, radius);
                predicted = self.predicted_gain();
                self.apply(poses);
                gain = cost - self.problem.cost(&self.trial);
                let quality = gain / predicted;
                first_quality = first_quality.or(Some(self.quality(gain, predicted, cost)));
                if quality < 0.25 || quality.is_nan() {
                    radius = 0.25 * length;
                } else if quality > 0.75 {
                    radius = radius.max(3.0 * length);
                }
                let exhausted = predicted <= self.params.relative_tolerance * 1e-4 * cost;
                if gain >= ACCEPT * predicted || exhausted {
                    break;
                }
            }
            let reached = if gain > 0.0 { cost - gain } else { cost };
            if let Some(better) = self.restart(poses, first_quality.unwrap_or(0.0), reached) {
                (cost, radius, outcome.restarted) = (better, f64::INFINITY, true);
                self.problem.linearise(poses);
                continue;
            }
            if gain.is_nan() || gain < 0.0 {
                let tiny = predicted <= self.params.relative_tolerance * cost;
                outcome.termination = if tiny { Termination::Converged } else { Termination::Stalled };
                break;
            }
            poses.copy_from_slice(&self.trial);
            cost -= gain;
            let unbounded = self.step == full;
            if progress.finished(gain, predicted, cost, self.params) && unbounded {
                outcome.termination = Termination::Converged;
                break;
            }
            cost = self.problem.linearise(poses);
        }
        outcome.cost = cost;
        Ok(outcome)
    }

    /// Share of the predicted gain that a step realised; 1 where there is nothing to gain.
    fn quality(&self, gain: f64, predicted: f64, cost: f64) -> f64 {
        let enough = self.params.relative_tolerance * cost + self.params.absolute_tolerance;
        if predicted <= enough { 1.0 } else { gain / predicted }
    }

    /// After the first step: when it went wrong and the other start costs less than what it `reached`, moves to
    /// that start and returns its cost.
    fn restart(&mut self, poses: &mut [G], quality: f64, reached: f64) -> Option<f64> {
        let rescue = self.rescue.take()?;
        if quality >= GOOD_START {
            return None;
        }
        let other = rescue()?;
        let cost = self.problem.cost(&other);
        if cost < reached || !reached.is_finite() {
            poses.copy_from_slice(&other);
            return Some(cost);
        }
        None
    }

    /// The minimum of the model along the steepest descent in the metric of the Hessian's diagonal.
    fn cauchy_point(&self, point: &mut [SVector<f64, N>]) {
        let problem = &self.problem;
        let mut slope = 0.0;
        for ((d, g), h) in point.iter_mut().zip(&problem.gradient).zip(&problem.hessian.diagonal) {
            *d = -g.component_div(&h.diagonal());
            slope -= d.dot(g);
        }
        let curvature = problem.hessian.quadratic(&problem.pattern.pairs, point);
        point.iter_mut().for_each(|d| *d *= slope / curvature);
    }

    /// Sets the step to the point of the dogleg path on the border of the trust region, or its end; returns its
    /// length in the metric of the Hessian's diagonal.
    fn choose(&mut self, full: &[SVector<f64, N>], cauchy: &[SVector<f64, N>], radius: f64) -> f64 {
        let diagonal = &self.problem.hessian.diagonal;
        let product = |a: &[SVector<f64, N>], b: &[SVector<f64, N>]| -> f64 {
            a.iter().zip(b).zip(diagonal).map(|((a, b), h)| a.component_mul(&h.diagonal()).dot(b)).sum()
        };
        let (ff, cc, fc) = (product(full, full), product(cauchy, cauchy), product(full, cauchy));
        let r2 = radius * radius;
        // step = a · cauchy + b · full
        let (a, b) = if ff <= r2 {
            (0.0, 1.0)
        } else if cc >= r2 {
            (radius / cc.sqrt(), 0.0)
        } else {
            // |c + t (f - c)|² = r²
            let (dd, cd) = (ff - 2.0 * fc + cc, fc - cc);
            let t = (r2 - cc) / (cd + (cd * cd + dd * (r2 - cc)).sqrt());
            (1.0 - t, t)
        };
        for ((x, f), c) in self.step.iter_mut().zip(full).zip(cauchy) {
            *x = if b == 1.0 { *f } else { c * a + f * b };
        }
        (a * a * cc + 2.0 * a * b * fc + b * b * ff).sqrt()
    }

    fn predicted_gain(&self) -> f64 {
        let linear: f64 = self.step.iter().zip(&self.problem.gradient).map(|(x, g)| x.dot(g)).sum();
        -linear - 0.5 * self.problem.hessian.quadratic(&self.problem.pattern.pairs, &self.step)
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
        for (step, slot) in self.step.iter().zip(&self.problem.pattern.slots) {
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

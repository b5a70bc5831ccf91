use nalgebra::SVector;

use super::lifted::{Lifted, Point, dot};
use super::{Descent, Limits, NOTHING, ROUNDING};
use crate::sparse::Cholesky;

/// Least share of the predicted gain a step must realise to be taken.
const ACCEPT: f64 = 0.1;

/// Riemannian trust region with truncated conjugate gradients, preconditioned by a factor of `Q`.
///
/// **Source**: Absil, Baker, Gallivan, *Trust-region methods on Riemannian manifolds*, 2007, algorithms 1 and 2;
/// the preconditioner as in Rosen, Carlone, Bandeira, Leonard, *SE-Sync*, 2019.
pub(super) struct TrustRegion<'a, const D: usize, const M: usize> {
    pub(super) problem: &'a Lifted<'a, D, M>,
    pub(super) preconditioner: &'a Cholesky<M>,
    pub(super) limits: Limits,
}

/// The model at a point: half gradient and multipliers.
struct Model<const D: usize> {
    gradient: Vec<f64>,
    multipliers: Vec<nalgebra::SMatrix<f64, D, D>>,
}

/// A step, the gain the model predicts, whether it ends at the border, and its length in the metric of the
/// preconditioner.
struct Step {
    step: Vec<f64>,
    predicted: f64,
    at_border: bool,
    length: f64,
}

impl<const D: usize, const M: usize> TrustRegion<'_, D, M> {
    pub(super) fn descend(&self, mut point: Point) -> Descent {
        let mut cost = self.problem.cost(&point);
        // no step gains more than the objective, so this is as far as a quadratic of the metric can reach
        let mut radius = (2.0 * cost).sqrt();
        let (mut iterations, mut converged) = (0, false);
        while iterations < self.limits.iterations {
            let model = self.model(&point);
            let mut z = model.gradient.clone();
            self.precondition(&point, &mut z);
            let promise = dot(&model.gradient, &z);
            if promise.is_nan() || promise <= self.limits.relative_tolerance * cost || cost < NOTHING {
                converged = !promise.is_nan();
                break;
            }
            iterations += 1;
            let step = self.truncated_gradients(&point, &model, z, radius);
            let trial = self.problem.retract(&point, &step.step, 1.0);
            let next = self.problem.cost(&trial);
            let noise = ROUNDING * cost;
            let quality = (cost - next + noise) / (step.predicted + noise);
            if quality.is_nan() || quality < 0.25 {
                radius = 0.25 * step.length.min(radius);
            } else if quality > 0.75 && step.at_border {
                radius *= 2.0;
            }
            if quality > ACCEPT {
                (point, cost) = (trial, next);
            } else if radius * radius <= self.limits.relative_tolerance * cost {
                break;
            }
        }
        Descent { point, cost, iterations, converged }
    }

    fn model(&self, point: &Point) -> Model<D> {
        let mut gradient = vec![0.0; point.x.len()];
        self.problem.times(&point.x, point.rank, &mut gradient);
        let multipliers = self.problem.multipliers(point, &gradient);
        self.problem.project(point, &mut gradient);
        Model { gradient, multipliers }
    }

    /// Steihaug and Toint's conjugate gradients: minimises the model within the radius. `z` is the preconditioned
    /// gradient. The objective is twice the quadratic `⟨g, s⟩ + ½ ⟨s, H s⟩` of the halved gradient and Hessian.
    fn truncated_gradients(&self, point: &Point, model: &Model<D>, mut z: Vec<f64>, radius: f64) -> Step {
        let size = z.len();
        let (mut step, mut h_step) = (vec![0.0; size], vec![0.0; size]);
        let mut residual = model.gradient.clone();
        let mut rz = dot(&residual, &z);
        let first = rz.sqrt();
        let mut direction: Vec<f64> = z.iter().map(|z| -z).collect();
        let mut h_direction = vec![0.0; size];
        let (mut ss, mut sd, mut dd) = (0.0, 0.0, rz);
        let mut at_border = false;
        for _ in 0..self.limits.inner_iterations {
            self.problem.hessian(point, &model.multipliers, &direction, &mut h_direction);
            let curvature = dot(&direction, &h_direction);
            let mut length = rz / curvature;
            let reach = ss + 2.0 * length * sd + length * length * dd;
            at_border = curvature <= 0.0 || reach.is_nan() || reach >= radius * radius;
            if at_border {
                length = (-sd + (sd * sd + dd * (radius * radius - ss)).max(0.0).sqrt()) / dd;
            }
            for i in 0..size {
                step[i] += length * direction[i];
                h_step[i] += length * h_direction[i];
                residual[i] += length * h_direction[i];
            }
            ss += 2.0 * length * sd + length * length * dd;
            if at_border {
                break;
            }
            z.copy_from_slice(&residual);
            self.precondition(point, &mut z);
            let next = dot(&residual, &z);
            // superlinear: the fraction asked for shrinks with the gradient itself
            if next.is_nan() || next.max(0.0).sqrt() <= first * 0.1f64.min(first / (first + radius)) {
                break;
            }
            let beta = next / rz;
            rz = next;
            for (d, z) in direction.iter_mut().zip(&z) {
                *d = beta * *d - z;
            }
            (sd, dd) = (beta * (sd + length * dd), rz + beta * beta * dd);
        }
        let predicted = -2.0 * dot(&model.gradient, &step) - dot(&step, &h_step);
        Step { step, predicted, at_border, length: ss.max(0.0).sqrt() }
    }

    /// Replaces a tangent vector by its preconditioned one.
    fn precondition(&self, point: &Point, v: &mut [f64]) {
        let r = point.rank;
        let mut column = vec![SVector::<f64, M>::zeros(); self.problem.nodes];
        let mut work = vec![0.0; self.preconditioner.work_length()];
        for c in 0..r {
            for (x, node) in column.iter_mut().zip(v.chunks_exact(M * r)) {
                *x = SVector::from_fn(|row, _| node[row * r + c]);
            }
            self.preconditioner.solve_with(&mut work, &mut column);
            for (x, node) in column.iter().zip(v.chunks_exact_mut(M * r)) {
                for row in 0..M {
                    node[row * r + c] = x[row];
                }
            }
        }
        self.problem.project(point, v);
    }
}

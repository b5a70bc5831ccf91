use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::lifted::{Lifted, Point};
use super::{Descent, Limits, NOTHING, ROUNDING};
use crate::certify::Dual;
use crate::sparse::{BlockMatrix, Cholesky, Symbolic};

/// Least share of the predicted gain a step must realise to be taken.
const ACCEPT: f64 = 0.1;
/// Smallest and largest damping, relative to the diagonal of the objective's matrix.
const DAMPING: (f64, f64) = (1e-8, 1e8);

/// Newton's method on poses, damped where the Hessian is not positive definite or the model does not hold.
///
/// Gauss-Newton and conjugate gradients converge the slower the larger the noise, since they take the curvature of the
/// rotations for that of a noise-free map. The exact Hessian on the tangent space is the certificate matrix `Q - Λ`
/// between tangent vectors, so it costs little more; where the optimum can be certified it is positive there, and the
/// last steps converge quadratically. `N = D + D (D - 1) / 2`.
pub(super) struct Newton<const N: usize> {
    hessian: BlockMatrix<N>,
    cholesky: Cholesky<N>,
    gradient: Vec<SVector<f64, N>>,
    step: Vec<SVector<f64, N>>,
    /// What damping one adds to the diagonal.
    scale: Vec<SVector<f64, N>>,
    /// Holds one pose of each connected part. The objective does not depend on where a part lies, so this changes no
    /// step but for that.
    pins: Vec<f64>,
    damping: Vec<SVector<f64, N>>,
}

/// Tangent vectors at one node that a rotation about each axis and a translation along each make.
type Basis<const D: usize, const M: usize, const N: usize> = [SMatrix<f64, M, D>; N];

impl<const N: usize> Newton<N> {
    pub(super) fn new<const D: usize, const M: usize>(dual: &Dual<D, M>) -> Self {
        let nodes = dual.nodes();
        let (block, zero) = (SMatrix::zeros(), SVector::zeros());
        let symbolic = Arc::new(Symbolic::with_order(dual.order().to_vec(), &dual.pairs, N));
        Self {
            hessian: BlockMatrix {
                diagonal: vec![block; nodes],
                off_diagonal: vec![block; dual.pairs.len()],
            },
            cholesky: Cholesky::new(symbolic, &dual.pairs),
            gradient: vec![zero; nodes],
            step: vec![zero; nodes],
            scale: vec![zero; nodes],
            pins: dual.pinned().map(|pinned| if pinned { 1.0 } else { 0.0 }).collect(),
            damping: vec![zero; nodes],
        }
    }

    /// Descends from a point of rank `D`.
    pub(super) fn descend<const D: usize, const M: usize>(
        &mut self,
        problem: &Lifted<D, M>,
        dual: &Dual<D, M>,
        mut point: Point,
        limits: Limits,
    ) -> Descent {
        let mut cost = problem.cost(&point);
        let (mut iterations, mut converged, mut lambda) = (0, false, 0.0);
        while iterations < limits.iterations && cost > NOTHING {
            self.linearise(problem, dual, &point);
            let mut taken = false;
            while !taken && lambda <= DAMPING.1 {
                let Some(predicted) = self.solve(lambda) else {
                    lambda = f64::max(10.0 * lambda, DAMPING.0);
                    continue;
                };
                if lambda <= DAMPING.0 && predicted <= limits.relative_tolerance * cost {
                    converged = true;
                    break;
                }
                let trial = problem.retract(&point, &self.tangent::<D, M>(&point), 1.0);
                let next = problem.cost(&trial);
                let noise = ROUNDING * cost;
                let quality = (cost - next + noise) / (predicted + noise);
                taken = quality > ACCEPT;
                if taken {
                    (point, cost) = (trial, next);
                }
                lambda = match quality {
                    q if q > 0.75 => {
                        if lambda > 10.0 * DAMPING.0 {
                            0.1 * lambda
                        } else {
                            0.0
                        }
                    }
                    q if q > 0.25 => lambda,
                    _ => f64::max(10.0 * lambda, 1e-4),
                };
            }
            if !taken {
                break;
            }
            iterations += 1;
        }
        converged |= cost <= NOTHING;
        Descent { point, cost, iterations, converged }
    }

    fn linearise<const D: usize, const M: usize>(
        &mut self,
        problem: &Lifted<D, M>,
        dual: &Dual<D, M>,
        point: &Point,
    ) {
        let mut product = vec![0.0; point.x.len()];
        problem.times(&point.x, D, &mut product);
        let multipliers = problem.multipliers(point, &product);
        problem.project(point, &mut product);
        let matrix = dual.certificate_matrix(&multipliers);
        let bases: Vec<Basis<D, M, N>> = point.x.chunks_exact(M * D).map(basis).collect();
        for (node, tangents) in bases.iter().enumerate() {
            let slope = &product[node * M * D..(node + 1) * M * D];
            // values are row by row, the matrix column by column
            let slope = SMatrix::<f64, M, D>::from_fn(|r, c| slope[r * D + c]);
            self.gradient[node] = SVector::from_fn(|a, _| tangents[a].dot(&slope));
            self.hessian.diagonal[node] = between(tangents, &matrix.diagonal[node], tangents);
            let flat = dual.objective_block(node);
            self.scale[node] = SVector::from_fn(|a, _| tangents[a].dot(&(flat * tangents[a])));
        }
        for ((row, column), (to, from)) in
            dual.pairs.iter().zip(self.hessian.off_diagonal.iter_mut().zip(&matrix.off_diagonal))
        {
            *to = between(&bases[*row as usize], from, &bases[*column as usize]);
        }
    }

    /// Finds the step at a damping; returns the gain of the objective that the model predicts, `None` where the damped
    /// Hessian is not positive definite.
    fn solve(&mut self, lambda: f64) -> Option<f64> {
        for ((d, s), pin) in self.damping.iter_mut().zip(&self.scale).zip(&self.pins) {
            *d = s * (lambda + pin);
        }
        self.cholesky.factor(&self.hessian, Some(&self.damping)).ok()?;
        for (x, g) in self.step.iter_mut().zip(&self.gradient) {
            *x = -g;
        }
        self.cholesky.solve(&mut self.step);
        // the objective is ⟨x, Q x⟩, so the model is 2 ⟨g, s⟩ + ⟨s, H s⟩ with H s = -g - λ D s
        let mut gain = 0.0;
        for ((x, g), s) in self.step.iter().zip(&self.gradient).zip(&self.scale) {
            gain += lambda * x.component_mul(x).dot(s) - g.dot(x);
        }
        Some(gain)
    }

    /// The step as a tangent vector.
    fn tangent<const D: usize, const M: usize>(&self, point: &Point) -> Vec<f64> {
        let mut v = Vec::with_capacity(point.x.len());
        for (x, step) in point.x.chunks_exact(M * D).zip(&self.step) {
            let tangents: Basis<D, M, N> = basis(x);
            let moved: SMatrix<f64, M, D> = tangents.iter().zip(step.iter()).map(|(t, s)| t * *s).sum();
            v.extend(moved.transpose().iter());
        }
        v
    }
}

/// With `A` the transposed rotation and `G` a generator, `Gᵀ A` for each rotation; unit vectors for the translations.
fn basis<const D: usize, const M: usize, const N: usize>(x: &[f64]) -> Basis<D, M, N> {
    let mut basis = [SMatrix::zeros(); N];
    let (shifts, turns) = basis.split_at_mut(D);
    for (k, shift) in shifts.iter_mut().enumerate() {
        shift[(D, k)] = 1.0;
    }
    let planes = (0..D).flat_map(|a| (a + 1..D).map(move |b| (a, b)));
    for (turn, (a, b)) in turns.iter_mut().zip(planes) {
        for c in 0..D {
            turn[(a, c)] = x[b * D + c];
            turn[(b, c)] = -x[a * D + c];
        }
    }
    basis
}

/// The bilinear form of a block between the tangent vectors of two nodes.
fn between<const D: usize, const M: usize, const N: usize>(
    left: &Basis<D, M, N>,
    block: &SMatrix<f64, M, M>,
    right: &Basis<D, M, N>,
) -> SMatrix<f64, N, N> {
    let mut form = SMatrix::zeros();
    for (b, right) in right.iter().enumerate() {
        let moved = block * right;
        for (a, left) in left.iter().enumerate() {
            form[(a, b)] = left.dot(&moved);
        }
    }
    form
}

#[cfg(test)]
mod tests {
    use crate::pattern::Elimination;
    use nalgebra::Rotation3;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::chordal::Edge;

    #[test]
    fn gradient_and_hessian_agree_with_differences_of_the_objective() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut draw = || rng.random_range(-1.0..1.0);
        let rotation = |a: f64, b: f64, c: f64| Rotation3::from_euler_angles(a, b, c).into_inner();
        let edges: Vec<Edge<3>> = [[0, 1], [1, 2], [2, 0]]
            .map(|slots| Edge {
                slots,
                rotation: rotation(draw(), draw(), draw()),
                translation: SVector::from_fn(|_, _| draw()),
                kappa: 2.0,
                tau: 3.0,
            })
            .to_vec();
        let poses: Vec<_> =
            (0..3).map(|_| (rotation(draw(), draw(), draw()), SVector::from_fn(|_, _| draw()))).collect();
        let problem = Lifted::<3, 4> { edges: &edges, nodes: 3 };
        let dual = Dual::<3, 4>::new(&edges, 3, &Elimination::default());
        let point = Lifted::<3, 4>::point(&poses);
        let mut newton = Newton::<6>::new(&dual);
        newton.linearise(&problem, &dual, &point);
        let step: Vec<SVector<f64, 6>> = (0..3).map(|_| SVector::from_fn(|_, _| draw())).collect();
        newton.step.copy_from_slice(&step);
        let h = 1e-4;
        let cost = |scale: f64| {
            // a geodesic, so that the second difference is the Riemannian Hessian
            let moved: Vec<_> = poses
                .iter()
                .zip(&step)
                .map(|((r, t), s)| {
                    let (x, y, z) = (s[5], -s[4], s[3]);
                    let turn = Rotation3::new(nalgebra::Vector3::new(x, y, z) * scale).into_inner();
                    (r * turn, t + s.fixed_rows::<3>(0) * scale)
                })
                .collect();
            problem.cost(&Lifted::<3, 4>::point(&moved))
        };
        let slope: f64 = newton.gradient.iter().zip(&step).map(|(g, s)| g.dot(s)).sum();
        let measured = (cost(h) - cost(-h)) / (4.0 * h);
        assert!((slope - measured).abs() < 1e-6 * slope.abs().max(1.0), "{slope} {measured}");
        let curvature = newton.hessian.quadratic(&dual.pairs, &step);
        let measured = (cost(h) - 2.0 * cost(0.0) + cost(-h)) / (2.0 * h * h);
        assert!((curvature - measured).abs() < 1e-5 * curvature.abs().max(1.0), "{curvature} {measured}");
    }
}

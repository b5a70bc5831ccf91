use nalgebra::{DMatrix, DVector, SVector};

/// Earlier steps that are mixed: as many as a planar pose has dimensions.
const MEMORY: usize = 3;

/// Damping of the mixing weights as a share of the trace: steps jump a little as pairs change, which small weights
/// forgive.
const DAMPING: f64 = 1e-2;

/// An accelerated step is at most so many times the plain one.
const LONGEST: f64 = 10.0;

/// Anderson's acceleration of an iteration `x ← x + f(x)`.
///
/// Of the last few poses and steps it takes the combination whose step would be the least, were steps affine in the
/// pose, and goes on from there. ICP with point-to-point residuals creeps along walls, each step a little shorter than
/// the one before in about the same direction; this sees where that leads.
///
/// **Source**: Anderson, "Iterative procedures for nonlinear integral equations", 1965; for ICP, Pavlov, Ovchinnikov,
/// Derbyshev, Tsetserukou, Oseledets, "AA-ICP: iterative closest point with Anderson acceleration", 2018. Here the
/// weights are damped and the step is capped; whoever calls checks that the cost does not rise.
#[derive(Debug, Clone, Default)]
pub(crate) struct Anderson<const N: usize> {
    /// Poses and the plain steps from there, oldest first.
    past: Vec<(SVector<f64, N>, SVector<f64, N>)>,
}

impl<const N: usize> Anderson<N> {
    /// What to add to the plain step `f` at `x`; zero while nothing is known.
    pub(crate) fn extra(&mut self, x: &SVector<f64, N>, f: &SVector<f64, N>) -> SVector<f64, N> {
        let columns = self.past.len();
        let mut extra = SVector::<f64, N>::zeros();
        if columns > 0 {
            let df = DMatrix::from_fn(N, columns, |i, k| f[i] - self.past[k].1[i]);
            let mut gram = df.transpose() * &df;
            let damping = DAMPING * gram.trace();
            (0..columns).for_each(|k| gram[(k, k)] += damping);
            let right = df.transpose() * DVector::from_column_slice(f.as_slice());
            if let Some(weights) = gram.cholesky().map(|c| c.solve(&right)) {
                for ((old_x, old_f), weight) in self.past.iter().zip(weights.iter()) {
                    extra -= (x - old_x + f - old_f) * *weight;
                }
            }
            let (length, longest) = ((f + extra).norm(), LONGEST * f.norm());
            if length > longest {
                extra = (f + extra) * (longest / length) - f;
            }
        }
        if columns == MEMORY {
            self.past.remove(0);
        }
        self.past.push((*x, *f));
        extra
    }

    pub(crate) fn forget(&mut self) {
        self.past.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn a_slow_linear_iteration_ends_in_a_fifth_of_the_steps() {
        let rates = Vector3::new(0.95, 0.8, 0.3);
        let goal = Vector3::new(1.0, -2.0, 0.5);
        let step = |x: &Vector3<f64>| (Matrix3::identity() - Matrix3::from_diagonal(&rates)) * (goal - x);
        let count = |accelerated: bool| {
            let (mut x, mut anderson) = (Vector3::zeros(), Anderson::<3>::default());
            let mut steps = 0;
            while (x - goal).norm() > 1e-3 && steps < 1000 {
                let f = step(&x);
                let extra = if accelerated { anderson.extra(&x, &f) } else { Vector3::zeros() };
                x += f + extra;
                steps += 1;
            }
            steps
        };
        assert!(5 * count(true) <= count(false), "{} {}", count(true), count(false));
    }
}

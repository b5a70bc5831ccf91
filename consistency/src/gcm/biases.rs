use nalgebra::{SMatrix, SVector};

use super::block_product::{subtract_product, subtract_transposed_product};
use super::consensus::Expected;

/// What the votes so far tell of the biases by which one hypothesis differs from the consensus: a joint normal.
///
/// A hypothesis is the consensus and a few biases `b`, slips and what single votes have more (or, with a negative
/// covariance, less) than there. The next vote deviates from what the consensus expects by
///
/// ```text
/// ρ_t - A_tᵀ ρ = -Xᵀ b + N(0, Δ_t)      X_l = Σ over the votes s that have bias l of A_ts
/// ```
///
/// and by its own biases: a vote is one step of a Kalman filter over `b`. No covariance of biases is inverted, so they
/// need not be positive.
#[derive(Debug, Clone, Default)]
pub(crate) struct Biases<const N: usize> {
    /// Which vote has which bias.
    carriers: Vec<(usize, usize)>,
    means: Vec<SVector<f64, N>>,
    /// Lower triangle of blocks, row by row.
    covariance: Vec<SMatrix<f64, N, N>>,
}

/// The next vote given the earlier ones under a hypothesis, before its own state is known.
#[derive(Debug, Clone)]
pub(crate) struct Forecast<const N: usize> {
    pub(crate) covariance: SMatrix<f64, N, N>,
    pub(crate) residual: SVector<f64, N>,
    /// `Cov(b_l, ρ_t)`.
    pub(crate) with_biases: Vec<SMatrix<f64, N, N>>,
}

/// Where the covariance of biases `l` and `k <= l` is.
fn place(l: usize, k: usize) -> usize {
    l * (l + 1) / 2 + k
}

impl<const N: usize> Biases<N> {
    /// Marks the votes that have a bias.
    pub(crate) fn mark_carriers(&self, carries: &mut [bool]) {
        self.carriers.iter().for_each(|&(t, _)| carries[t] = true);
    }

    pub(crate) fn mean(&self, bias: usize) -> &SVector<f64, N> {
        &self.means[bias]
    }

    pub(crate) fn covariance(&self, bias: usize) -> &SMatrix<f64, N, N> {
        &self.covariance[place(bias, bias)]
    }

    pub(crate) fn forecast(&self, expected: &Expected<N>) -> Forecast<N> {
        let weights = self.sums_over_carriers(&expected.weights);
        let mut with_biases = vec![SMatrix::zeros(); weights.len()];
        self.subtract_covariance_times(&weights, &mut with_biases);
        let &Expected { mut covariance, mut residual, .. } = expected;
        for ((weight, with_bias), mean) in weights.iter().zip(&with_biases).zip(&self.means) {
            subtract_transposed_product(&mut covariance, weight, with_bias);
            residual.gemv_tr(1.0, weight, mean, 1.0);
        }
        Forecast { covariance, residual, with_biases }
    }

    /// Adds the bias `N(0, covariance)` of vote `t`, which is still to be observed, and returns its number.
    pub(crate) fn add(
        &mut self,
        t: usize,
        covariance: SMatrix<f64, N, N>,
        with_biases: &mut Vec<SMatrix<f64, N, N>>,
    ) -> usize {
        let bias = self.means.len();
        self.means.push(SVector::zeros());
        self.covariance.resize(place(bias, bias), SMatrix::zeros());
        self.covariance.push(covariance);
        self.carriers.push((t, bias));
        with_biases.push(covariance);
        bias
    }

    /// Gives vote `t`, which is still to be observed, bias `shared` of earlier ones, too.
    pub(crate) fn share(&mut self, t: usize, shared: usize, with_biases: &mut [SMatrix<f64, N, N>]) {
        for (l, with_bias) in with_biases.iter_mut().enumerate() {
            *with_bias += if l < shared {
                self.covariance[place(shared, l)].transpose()
            } else {
                self.covariance[place(l, shared)]
            };
        }
        self.carriers.push((t, shared));
    }

    /// Takes account of a vote, given the Cholesky factor `diagonal` of its covariance, its whitened residual and its
    /// covariance with each bias.
    pub(crate) fn observe(
        &mut self,
        diagonal: &SMatrix<f64, N, N>,
        whitened: &SVector<f64, N>,
        with_biases: &[SMatrix<f64, N, N>],
    ) {
        let gain = |with_bias: &SMatrix<f64, N, N>| {
            let mut gain = with_bias.transpose();
            diagonal.solve_lower_triangular_mut(&mut gain);
            gain
        };
        let gains: Vec<SMatrix<f64, N, N>> = with_biases.iter().map(gain).collect();
        for (mean, gain) in self.means.iter_mut().zip(&gains) {
            mean.gemv_tr(1.0, gain, whitened, 1.0);
        }
        let mut blocks = self.covariance.iter_mut();
        for (l, gain) in gains.iter().enumerate() {
            for (other, block) in gains[..=l].iter().zip(&mut blocks) {
                subtract_transposed_product(block, gain, other);
            }
        }
    }

    /// Takes the means of the biases from the residuals of the votes that have them.
    pub(crate) fn subtract_means(&self, rho: &mut [SVector<f64, N>]) {
        for &(t, bias) in &self.carriers {
            rho[t] -= self.means[bias];
        }
    }

    /// `K_H⁻¹` and `K_H⁻¹ ρ` at vote `t`, block `t` of each, from those of `K`: `column` is the block column of `K⁻¹`
    /// and `solution` the block of `K⁻¹ ρ`.
    pub(crate) fn inverse_and_solution(
        &self,
        t: usize,
        column: &[SMatrix<f64, N, N>],
        solution: &SVector<f64, N>,
    ) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        let weights = self.sums_over_carriers(column);
        let mut spread = vec![SMatrix::zeros(); weights.len()];
        self.subtract_covariance_times(&weights, &mut spread);
        let (mut inverse, mut solution) = (column[t], *solution);
        for ((weight, spread), mean) in weights.iter().zip(&spread).zip(&self.means) {
            inverse += weight.transpose() * spread;
            subtract_transposed_product(&mut solution, weight, mean);
        }
        (inverse, solution)
    }

    fn sums_over_carriers(&self, of_votes: &[SMatrix<f64, N, N>]) -> Vec<SMatrix<f64, N, N>> {
        let mut sums = vec![SMatrix::zeros(); self.means.len()];
        for &(t, bias) in &self.carriers {
            sums[bias] += of_votes[t];
        }
        sums
    }

    /// `target -= Σ x` with the biases' covariance `Σ`.
    fn subtract_covariance_times(&self, x: &[SMatrix<f64, N, N>], target: &mut [SMatrix<f64, N, N>]) {
        let mut blocks = self.covariance.iter();
        for l in 0..x.len() {
            let (above, from_here) = target.split_at_mut(l);
            for ((block, x_k), target_k) in (&mut blocks).take(l).zip(x).zip(above) {
                subtract_product(&mut from_here[0], block, x_k);
                subtract_transposed_product(target_k, block, &x[l]);
            }
            if let Some(block) = blocks.next() {
                subtract_product(&mut from_here[0], block, &x[l]);
            }
        }
    }
}

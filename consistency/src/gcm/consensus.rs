use nalgebra::linalg::Cholesky;
use nalgebra::{SMatrix, SVector};

use super::beam::State;
use super::block_product::{subtract_product, subtract_transposed_product};
use super::votes::{Kind, Vote, Votes};
use crate::Error;

/// The votes as if each had the state that the best hypothesis gave it when it was met, slipped ones as good: what all
/// hypotheses have in common, and each has few deviations from.
///
/// With `K` the covariance of the votes together with the biases that they have by themselves in those states, and `k_t`
/// its column above the diagonal block `t`,
///
/// ```text
/// A_t = K⁻¹ k_t      ρ_t given the earlier ones ~ N(A_tᵀ ρ, Δ_t)      Δ_t = K_tt - k_tᵀ A_t
/// K⁻¹ = (I - A) Δ⁻¹ (I - A)ᵀ, the columns of A being the A_t
/// ```
///
/// Which states these are changes no result; the nearer to the hypotheses, the less work they are.
#[derive(Debug)]
pub(crate) struct Consensus<const N: usize> {
    steps: Vec<Step<N>>,
    /// Of the steps but for the last, until its state is known.
    settled: Vec<Settled<N>>,
}

/// One vote given the earlier ones, before its own state is known.
#[derive(Debug)]
pub(crate) struct Step<const N: usize> {
    /// `A_t`, a block for each earlier vote.
    pub(crate) weights: Vec<SMatrix<f64, N, N>>,
    /// `ρ_t - A_tᵀ ρ`.
    pub(crate) residual: SVector<f64, N>,
    /// `Δ_t` without the vote's own bias.
    pub(crate) covariance: SMatrix<f64, N, N>,
    /// Transposed blocks left of the diagonal of the Cholesky factor `L` of `K`.
    left: Vec<SMatrix<f64, N, N>>,
}

/// What follows from a vote's state.
#[derive(Debug)]
struct Settled<const N: usize> {
    own: SMatrix<f64, N, N>,
    /// Diagonal block of `L`.
    diagonal: SMatrix<f64, N, N>,
    /// `Δ_t⁻¹`.
    information: SMatrix<f64, N, N>,
}

impl<const N: usize> Consensus<N> {
    pub(crate) fn new() -> Self {
        Self { steps: Vec::new(), settled: Vec::new() }
    }

    /// Vote `t`, the earlier ones being settled.
    pub(crate) fn step(&mut self, votes: &Votes<N>, t: usize) -> &Step<N> {
        if t == self.steps.len() {
            self.steps.push(self.next_step(votes, t));
        }
        &self.steps[t]
    }

    fn next_step(&self, votes: &Votes<N>, t: usize) -> Step<N> {
        let left = self.solve_forward(|s| votes.block(t, s).transpose());
        let Vote { rho: mut residual, .. } = votes.list[t];
        let mut covariance = *votes.block(t, t);
        left.iter().for_each(|w| subtract_transposed_product(&mut covariance, w, w));
        let weights = self.solve_backward(left.clone());
        for (weight, earlier) in weights.iter().zip(&votes.list) {
            subtract_transposed_product(&mut residual, weight, &earlier.rho);
        }
        Step { weights, residual, covariance, left }
    }

    /// Gives `vote`, whose step was the last asked for, a state, and returns the covariance of its own bias. A vote that
    /// has a state keeps it.
    ///
    /// # Errors
    /// [`Error::VoteCovariance`] if its covariance given the earlier ones is not positive definite in any state.
    pub(crate) fn settle(
        &mut self,
        votes: &Votes<N>,
        t: usize,
        state: State,
    ) -> Result<&SMatrix<f64, N, N>, Error> {
        if t == self.settled.len() {
            let vote = &votes.list[t];
            let others = [State::Good, State::BadPrior, State::YawSlip, State::Gross, State::Elsewhere];
            let factored = std::iter::once(state).chain(others).find_map(|state| {
                let own = own_bias(vote, state);
                Some((own, Cholesky::new(self.steps[t].covariance + own)?))
            });
            let (own, factor) = factored.ok_or_else(|| vote.singular())?;
            self.settled.push(Settled { own, diagonal: factor.l(), information: factor.inverse() });
        }
        Ok(&self.settled[t].own)
    }

    /// `L⁻¹ b`.
    fn solve_forward(&self, b: impl Fn(usize) -> SMatrix<f64, N, N>) -> Vec<SMatrix<f64, N, N>> {
        let mut x: Vec<SMatrix<f64, N, N>> = Vec::with_capacity(self.settled.len());
        for (s, (step, settled)) in self.steps.iter().zip(&self.settled).enumerate() {
            let mut solved = b(s);
            for (left, above) in step.left.iter().zip(&x) {
                subtract_transposed_product(&mut solved, left, above);
            }
            settled.diagonal.solve_lower_triangular_mut(&mut solved);
            x.push(solved);
        }
        x
    }

    /// `L⁻ᵀ b`.
    fn solve_backward(&self, mut b: Vec<SMatrix<f64, N, N>>) -> Vec<SMatrix<f64, N, N>> {
        for (s, (step, settled)) in self.steps.iter().zip(&self.settled).enumerate().rev() {
            settled.diagonal.tr_solve_lower_triangular_mut(&mut b[s]);
            let solved = b[s];
            for (above, left) in b.iter_mut().zip(&step.left) {
                subtract_product(above, left, &solved);
            }
        }
        b
    }

    /// `K⁻¹ b`, one block a vote.
    pub(crate) fn solve<const C: usize>(&self, b: &[SMatrix<f64, N, C>]) -> Vec<SMatrix<f64, N, C>> {
        let mut x: Vec<SMatrix<f64, N, C>> = Vec::with_capacity(b.len());
        for ((step, settled), own) in self.steps.iter().zip(&self.settled).zip(b) {
            let mut left_over = *own;
            for (weight, earlier) in step.weights.iter().zip(b) {
                subtract_transposed_product(&mut left_over, weight, earlier);
            }
            let solved = settled.information * left_over;
            for (weight, earlier) in step.weights.iter().zip(&mut x) {
                subtract_product(earlier, weight, &solved);
            }
            x.push(solved);
        }
        x
    }

    /// Block column `t` of `K⁻¹`.
    pub(crate) fn inverse_column(&self, t: usize) -> Vec<SMatrix<f64, N, N>> {
        let mut unit = vec![SMatrix::zeros(); self.steps.len()];
        unit[t] = SMatrix::identity();
        self.solve(&unit)
    }
}

/// Covariance of the bias that a vote in this state has to itself.
pub(crate) fn own_bias<const N: usize>(vote: &Vote<N>, state: State) -> SMatrix<f64, N, N> {
    match (&vote.kind, state) {
        (Kind::Prior { bad }, State::BadPrior) => *bad,
        (Kind::Prior { .. }, _) => SMatrix::zeros(),
        (Kind::Cluster { yaw, .. }, State::YawSlip) => *yaw,
        (Kind::Cluster { gross, .. }, State::Gross) => *gross,
        (Kind::Cluster { elsewhere, .. }, State::Elsewhere) => *elsewhere,
        // harmless bias is common to slipped groups too; without it equal slips would fit better than truth
        (Kind::Cluster { spike, .. }, _) => *spike,
    }
}

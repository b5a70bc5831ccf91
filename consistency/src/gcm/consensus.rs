use nalgebra::linalg::Cholesky;
use nalgebra::{SMatrix, SVector};

use super::beam::State;
use super::block_product::{subtract_product, subtract_transposed_product};
use super::votes::{Kind, Vote, Votes};
use crate::Error;

/// The votes as if each had the state that the best hypothesis gave it when it was met, slipped ones as good: what all
/// hypotheses have in common, and each has few deviations from.
///
/// With `K = L Lᵀ` the covariance of the votes together with the biases that they have by themselves in those states, and
/// `k_t` its column above the diagonal block `t`,
///
/// ```text
/// w_t = L⁻¹ k_t      A_t = K⁻¹ k_t = L⁻ᵀ w_t
/// ρ_t given the earlier ones ~ N(A_tᵀ ρ, K_tt - w_tᵀ w_t)
/// ```
///
/// Which states these are changes no result; the nearer to the hypotheses, the less work they are.
#[derive(Debug)]
pub(crate) struct Consensus<const N: usize> {
    rows: Vec<Row<N>>,
    /// Of the rows but for the last, until its state is known.
    settled: Vec<Settled<N>>,
    columns: Vec<Column<N>>,
}

/// One vote given the earlier ones, before its own state is known.
#[derive(Debug)]
struct Row<const N: usize> {
    /// `w_t`, the transposed blocks of `L` left of the diagonal.
    left: Vec<SMatrix<f64, N, N>>,
    covariance: SMatrix<f64, N, N>,
    residual: SVector<f64, N>,
}

/// What follows from a vote's state.
#[derive(Debug)]
struct Settled<const N: usize> {
    /// Covariance of the vote's own bias.
    own: SMatrix<f64, N, N>,
    /// Diagonal block of `L`.
    diagonal: SMatrix<f64, N, N>,
    /// Block of `L⁻¹ ρ`.
    whitened: SVector<f64, N>,
}

/// What later votes owe to one vote `s`; empty until asked for.
#[derive(Debug)]
struct Column<const N: usize> {
    /// `A_ts` from `t = s + 1` on.
    weights: Vec<SMatrix<f64, N, N>>,
    /// Blocks of `L⁻¹` from the diagonal on.
    inverse: Vec<SMatrix<f64, N, N>>,
}

/// A vote given the earlier ones under the consensus, but for its own bias.
#[derive(Debug)]
pub(crate) struct Expected<const N: usize> {
    pub(crate) covariance: SMatrix<f64, N, N>,
    /// `ρ_t - A_tᵀ ρ`.
    pub(crate) residual: SVector<f64, N>,
    /// `A_ts` for the votes `s` asked for, else zero.
    pub(crate) weights: Vec<SMatrix<f64, N, N>>,
}

impl<const N: usize> Consensus<N> {
    pub(crate) fn new() -> Self {
        Self { rows: Vec::new(), settled: Vec::new(), columns: Vec::new() }
    }

    /// What is expected of vote `t`, the earlier ones being settled, with the weights of those `asked` for.
    pub(crate) fn expect(&mut self, votes: &Votes<N>, t: usize, asked: &[bool]) -> Expected<N> {
        if t == self.rows.len() {
            self.rows.push(self.next_row(votes, t));
            self.columns.push(Column { weights: Vec::new(), inverse: Vec::new() });
        }
        let weight =
            |s: usize| if asked[s] { self.column(s, t).weights[t - s - 1] } else { SMatrix::zeros() };
        let weights = (0..t).map(weight).collect();
        let Row { covariance, residual, .. } = self.rows[t];
        Expected { covariance, residual, weights }
    }

    fn next_row(&self, votes: &Votes<N>, t: usize) -> Row<N> {
        let mut left: Vec<SMatrix<f64, N, N>> = Vec::with_capacity(t);
        let (mut covariance, mut residual) = (*votes.block(t, t), votes.list[t].rho);
        for (s, (row, settled)) in self.rows.iter().zip(&self.settled).enumerate() {
            let mut w = votes.block(t, s).transpose();
            for (left, above) in row.left.iter().zip(&left) {
                subtract_transposed_product(&mut w, left, above);
            }
            settled.diagonal.solve_lower_triangular_mut(&mut w);
            subtract_transposed_product(&mut covariance, &w, &w);
            subtract_transposed_product(&mut residual, &w, &settled.whitened);
            left.push(w);
        }
        Row { left, covariance, residual }
    }

    /// Gives vote `t`, the last one asked for, a state, and returns the covariance of its own bias. A vote that has a
    /// state keeps it.
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
            let (vote, row) = (&votes.list[t], &self.rows[t]);
            let others = [State::Good, State::BadPrior, State::YawSlip, State::Gross, State::Elsewhere];
            let factored = std::iter::once(state).chain(others).find_map(|state| {
                let own = own_bias(vote, state);
                Some((own, Cholesky::new(row.covariance + own)?.l()))
            });
            let (own, diagonal) = factored.ok_or_else(|| vote.singular())?;
            let mut whitened = row.residual;
            diagonal.solve_lower_triangular_mut(&mut whitened);
            self.settled.push(Settled { own, diagonal, whitened });
        }
        Ok(&self.settled[t].own)
    }

    /// Column `s`, at least down to row `last`.
    fn column(&mut self, s: usize, last: usize) -> &Column<N> {
        let Column { weights, inverse } = &mut self.columns[s];
        for (t, row) in self.rows.iter().enumerate().take(last + 1).skip(s + inverse.len()) {
            if t > s + weights.len() {
                let mut weight = SMatrix::zeros();
                for (inverse, left) in inverse.iter().zip(&row.left[s..]) {
                    subtract_transposed_product(&mut weight, inverse, left);
                }
                weights.push(-weight);
            }
            if let Some(settled) = self.settled.get(t) {
                let mut block = weights.last().map_or_else(SMatrix::identity, |weight| -weight.transpose());
                settled.diagonal.solve_lower_triangular_mut(&mut block);
                inverse.push(block);
            }
        }
        &self.columns[s]
    }

    /// Block column `t` of `K⁻¹`, at `t` and the votes `asked` for, else zero.
    pub(crate) fn inverse_column(&mut self, t: usize, asked: &[bool]) -> Vec<SMatrix<f64, N, N>> {
        let last = asked.len() - 1;
        let of_t = self.column(t, last).inverse.clone();
        let block = |s: usize| {
            let mut block = SMatrix::zeros();
            if asked[s] || s == t {
                let of_s = &self.column(s, last).inverse;
                for (a, b) in of_s.iter().skip(t.saturating_sub(s)).zip(&of_t[s.saturating_sub(t)..]) {
                    subtract_transposed_product(&mut block, a, b);
                }
            }
            -block
        };
        (0..asked.len()).map(block).collect()
    }

    /// `K⁻¹ b`, one block a vote.
    pub(crate) fn solve(&self, mut b: Vec<SVector<f64, N>>) -> Vec<SVector<f64, N>> {
        for (t, (row, settled)) in self.rows.iter().zip(&self.settled).enumerate() {
            let (above, from_here) = b.split_at_mut(t);
            for (left, above) in row.left.iter().zip(above) {
                subtract_transposed_product(&mut from_here[0], left, above);
            }
            settled.diagonal.solve_lower_triangular_mut(&mut from_here[0]);
        }
        for (t, (row, settled)) in self.rows.iter().zip(&self.settled).enumerate().rev() {
            settled.diagonal.tr_solve_lower_triangular_mut(&mut b[t]);
            let solved = b[t];
            for (above, left) in b.iter_mut().zip(&row.left) {
                subtract_product(above, left, &solved);
            }
        }
        b
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

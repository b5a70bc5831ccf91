use nalgebra::{SMatrix, SVector};

use super::biases::{Biases, Forecast};
use super::consensus::{Consensus, own_bias};
use super::params::GcmParams;
use super::state_prior::{SoundCounts, StatePrior};
use super::votes::{Kind, Votes};
use crate::{Error, Pose};

/// State of one vote under a hypothesis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum State {
    Good,
    YawSlip,
    Gross,
    /// Of another place: tells nothing of the map transform.
    Elsewhere,
    BadPrior,
    /// The numbered slip.
    Slip(u16),
}

/// One explanation of all votes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hypothesis<const N: usize> {
    /// log prior plus log likelihood.
    pub(crate) score: f64,
    /// The score with slips short and long and none too short to be any: what the posterior is made of.
    pub(crate) weight: f64,
    pub(crate) states: Vec<State>,
    sound_counts: SoundCounts,
    biases: Biases<N>,
    /// Which of the biases each slip is.
    slips: Vec<usize>,
}

/// The surviving hypotheses.
#[derive(Debug, Clone)]
pub(crate) struct Beam<const N: usize> {
    /// In the order of their state vectors.
    pub(crate) hypotheses: Vec<Hypothesis<N>>,
    /// Best score ever dropped, relative to the best of its step; minus infinity when nothing was.
    pub(crate) dropped: f64,
}

/// A way to extend one hypothesis by the next vote.
struct Child<const N: usize> {
    parent: usize,
    state: State,
    score: f64,
    diagonal: SMatrix<f64, N, N>,
    y: SVector<f64, N>,
}

/// Searches the states of all votes, best first and a limited number at a time. With an unlimited beam it is exact.
///
/// What the next vote would be under the consensus is found once for all hypotheses. What is left of each are the biases
/// by which it differs: a vote costs `O(m²)` blocks a hypothesis for `m` of them.
///
/// * `consensus` – new, or of an earlier search of the same votes.
///
/// # Errors
/// [`Error::VoteCovariance`] at a vote whose covariance given the earlier ones is not positive definite in any state.
pub(crate) fn search<const N: usize, G: Pose<N>>(
    votes: &Votes<N>,
    consensus: &mut Consensus<N>,
    params: &GcmParams,
    width: usize,
) -> Result<Beam<N>, Error> {
    let mut beam = Beam { hypotheses: vec![Hypothesis::default()], dropped: f64::NEG_INFINITY };
    for t in 0..votes.list.len() {
        beam.extend(votes, consensus, params, width, t)?;
    }
    beam.weigh_biases::<G>(votes, consensus);
    Ok(beam)
}

impl<const N: usize> Beam<N> {
    /// The hypothesis with the highest score; of equals the smallest state vector.
    pub(crate) fn best(&self) -> Option<&Hypothesis<N>> {
        self.hypotheses.iter().reduce(|best, h| if h.weight > best.weight { h } else { best })
    }

    /// Gives each hypothesis the evidence of slips and yaw slips as they are thought of, instead of the normals
    /// searched with. Biases are taken one by one.
    fn weigh_biases<G: Pose<N>>(&mut self, votes: &Votes<N>, consensus: &mut Consensus<N>) {
        for Hypothesis { weight, score, biases, slips, .. } in &mut self.hypotheses {
            let of = |&slip: &usize| votes.slip.log_evidence::<G>(biases.mean(slip), biases.covariance(slip));
            *weight = *score + slips.iter().map(of).sum::<f64>();
        }
        let solution = consensus.solve(residuals(votes));
        let carriers = self.carriers(votes.list.len());
        for (t, vote) in votes.list.iter().enumerate() {
            let mut turned = self.hypotheses.iter_mut().filter(|h| h.states[t] == State::YawSlip).peekable();
            if turned.peek().is_none() {
                continue;
            }
            let own = own_bias(vote, State::YawSlip);
            let column = consensus.inverse_column(t, &carriers);
            for hypothesis in turned {
                let (inverse, solution) = hypothesis.biases.inverse_and_solution(t, &column, &solution[t]);
                hypothesis.weight +=
                    votes.slip.log_turned::<G>(&(own * solution), &(own - own * inverse * own));
            }
        }
    }

    /// Log of the sum of all hypotheses' weights: the log evidence, as far as the beam holds it.
    pub(crate) fn log_evidence(&self) -> f64 {
        let best = self.best().map_or(f64::NEG_INFINITY, |h| h.weight);
        best + self.hypotheses.iter().map(|h| (h.weight - best).exp()).sum::<f64>().ln()
    }

    fn extend(
        &mut self,
        votes: &Votes<N>,
        consensus: &mut Consensus<N>,
        params: &GcmParams,
        width: usize,
        t: usize,
    ) -> Result<(), Error> {
        let mut children: Vec<Child<N>> = Vec::new();
        let expected = consensus.expect(votes, t, &self.carriers(t));
        let forecasts: Vec<Forecast<N>> =
            self.hypotheses.iter().map(|h| h.biases.forecast(&expected)).collect();
        for (parent, (hypothesis, forecast)) in self.hypotheses.iter().zip(&forecasts).enumerate() {
            hypothesis.children(votes, params, t, parent, forecast, &mut children);
        }
        let best = children.iter().reduce(|best, child| if child.score > best.score { child } else { best });
        let best = best.ok_or_else(|| votes.list[t].singular())?;
        let agreed = consensus.settle(votes, t, best.state)?;
        let kept = self.prune(&children, best.score, params.depth, width);
        let mut parents = std::mem::take(&mut self.hypotheses);
        let mut survivors =
            children.into_iter().zip(kept).filter(|(_, keep)| *keep).map(|(child, _)| child).peekable();
        while let Some(child) = survivors.next() {
            let is_last = survivors.peek().is_none_or(|next| next.parent != child.parent);
            let (parent, forecast) = (&mut parents[child.parent], &forecasts[child.parent]);
            let parent = if is_last { std::mem::take(parent) } else { parent.clone() };
            let own = own_bias(&votes.list[t], child.state) - agreed;
            self.hypotheses.push(parent.grown(votes, t, forecast, &own, child));
        }
        Ok(())
    }

    /// Whether any hypothesis has a bias of each of the first `count` votes.
    fn carriers(&self, count: usize) -> Vec<bool> {
        let mut carries = vec![false; count];
        self.hypotheses.iter().for_each(|h| h.biases.mark_carriers(&mut carries));
        carries
    }

    /// Which children survive: the best `width`, none deeper than `depth`; ties to the smaller state vector.
    fn prune(&mut self, children: &[Child<N>], best: f64, depth: f64, width: usize) -> Vec<bool> {
        let mut survivors: Vec<usize> =
            (0..children.len()).filter(|&c| children[c].score >= best - depth).collect();
        if survivors.len() > width {
            let by_score =
                |a: &usize, b: &usize| children[*b].score.total_cmp(&children[*a].score).then(a.cmp(b));
            survivors.select_nth_unstable_by(width, by_score);
            survivors.truncate(width);
        }
        let mut kept = vec![false; children.len()];
        survivors.into_iter().for_each(|c| kept[c] = true);
        for (child, _) in children.iter().zip(&kept).filter(|(_, kept)| !**kept) {
            self.dropped = self.dropped.max(child.score - best);
        }
        kept
    }
}

fn residuals<const N: usize>(votes: &Votes<N>) -> Vec<SVector<f64, N>> {
    votes.list.iter().map(|vote| vote.rho).collect()
}

impl<const N: usize> Hypothesis<N> {
    fn children(
        &self,
        votes: &Votes<N>,
        params: &GcmParams,
        t: usize,
        parent: usize,
        forecast: &Forecast<N>,
        children: &mut Vec<Child<N>>,
    ) {
        let vote = &votes.list[t];
        let Forecast { covariance, residual, with_biases } = forecast;
        let mut push = |state, log_prior: f64, shared: &SMatrix<f64, N, N>, residual: &SVector<f64, N>| {
            let covariance = shared + own_bias(vote, state);
            if let Some((density, diagonal, y)) = log_normal(&covariance, residual) {
                children.push(Child { parent, state, score: self.score + log_prior + density, diagonal, y });
            }
        };
        match &vote.kind {
            Kind::Prior { .. } => {
                push(State::Good, params.prior_sound.ln(), covariance, residual);
                push(State::BadPrior, (1.0 - params.prior_sound).ln(), covariance, residual);
            }
            Kind::Cluster { single, neighbor, .. } => {
                let prior = StatePrior {
                    sound: self.sound_counts.predicted(*single, params),
                    gross: if *single { params.gross_share_single } else { params.gross_share },
                    alpha: if vote.placed { params.alpha } else { params.alpha_unplaced },
                    params,
                    slip_counts: &self.slip_counts(votes, t),
                    neighbor: neighbor.map(|(v, kappa)| (self.states[v], kappa)),
                };
                for state in [State::Good, State::YawSlip, State::Gross, State::Elsewhere] {
                    push(state, prior.log(state), covariance, residual);
                }
                for (j, &slip) in self.slips.iter().enumerate() {
                    let state = State::Slip(j as u16);
                    let cross = with_biases[slip];
                    let shared = covariance + self.biases.covariance(slip) + cross + cross.transpose();
                    push(state, prior.log(state), &shared, &(residual - self.biases.mean(slip)));
                }
                let fresh = State::Slip(self.slips.len() as u16);
                push(fresh, prior.log(fresh), &(covariance + votes.slip.searched()), residual);
            }
        }
    }

    /// How many votes so far of the robot pair of vote `t` have each slip.
    fn slip_counts(&self, votes: &Votes<N>, t: usize) -> Vec<u32> {
        let mut counts = vec![0; self.slips.len()];
        for (vote, state) in votes.list.iter().zip(&self.states) {
            if let (State::Slip(j), true) = (state, vote.robots == votes.list[t].robots) {
                counts[usize::from(*j)] += 1;
            }
        }
        counts
    }

    /// The hypothesis with one more vote; `own` is what the state adds to the covariance of the vote's own bias under the
    /// consensus.
    fn grown(
        mut self,
        votes: &Votes<N>,
        t: usize,
        forecast: &Forecast<N>,
        own: &SMatrix<f64, N, N>,
        child: Child<N>,
    ) -> Self {
        (self.score, self.weight) = (child.score, child.score);
        self.states.push(child.state);
        if let Kind::Cluster { single, .. } = votes.list[t].kind {
            self.sound_counts.add(single, child.state == State::Good);
        }
        let mut with_biases = forecast.with_biases.clone();
        if let State::Slip(slip) = child.state {
            match self.slips.get(usize::from(slip)) {
                Some(&joined) => self.biases.share(t, joined, &mut with_biases),
                None => self.slips.push(self.biases.add(t, *votes.slip.searched(), &mut with_biases)),
            }
        }
        if own.iter().any(|entry| *entry != 0.0) {
            self.biases.add(t, *own, &mut with_biases);
        }
        self.biases.observe(&child.diagonal, &child.y, &with_biases);
        self
    }

    /// `K_H⁻¹ ρ`, one block a vote.
    pub(crate) fn solution(&self, votes: &Votes<N>, consensus: &Consensus<N>) -> Vec<SVector<f64, N>> {
        let mut rho = residuals(votes);
        self.biases.subtract_means(&mut rho);
        consensus.solve(rho)
    }
}

/// log N(r; 0, S) with the factor of `S` and the whitened residual; `None` when `S` has no factor.
fn log_normal<const N: usize>(
    covariance: &SMatrix<f64, N, N>,
    residual: &SVector<f64, N>,
) -> Option<(f64, SMatrix<f64, N, N>, SVector<f64, N>)> {
    let l = nalgebra::linalg::Cholesky::new(*covariance)?.l();
    let y = l.solve_lower_triangular(residual)?;
    let half_log_determinant: f64 = (0..N).map(|row| l[(row, row)].ln()).sum();
    let constant = 0.5 * N as f64 * std::f64::consts::TAU.ln();
    Some((-constant - half_log_determinant - 0.5 * y.norm_squared(), l, y))
}

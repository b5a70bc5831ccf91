use std::rc::Rc;

use nalgebra::{SMatrix, SVector};

use super::params::GcmParams;
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
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis<const N: usize> {
    /// log prior plus log likelihood.
    pub(crate) score: f64,
    /// The score with slips short and long and none too short to be any: what the posterior is made of.
    pub(crate) weight: f64,
    pub(crate) states: Vec<State>,
    sound_counts: SoundCounts,
    rows: Vec<Rc<Row<N>>>,
    slips: Vec<Slip<N>>,
}

/// What the votes so far tell of one slip, or of the bias of one vote.
#[derive(Debug, Clone, Copy)]
struct Slip<const N: usize> {
    mean: SVector<f64, N>,
    covariance: SMatrix<f64, N, N>,
}

/// One block row of the Cholesky factor of `K_H`, with its part of `y = L⁻¹ ρ`.
#[derive(Debug)]
struct Row<const N: usize> {
    /// Transposed blocks left of the diagonal.
    w: Vec<SMatrix<f64, N, N>>,
    diagonal: SMatrix<f64, N, N>,
    y: SVector<f64, N>,
    /// Its block of `L⁻¹ E_j S_T` for each slip `j` that was open then.
    slips: Vec<SMatrix<f64, N, N>>,
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

/// The next vote `t` given the rows of one hypothesis, before its own state is known.
#[derive(Debug, Clone)]
struct Forward<const N: usize> {
    /// `w = L⁻¹ K_·t`.
    w: Vec<SMatrix<f64, N, N>>,
    /// After each row, how the vote's covariance, residual and covariance with each slip then open stand.
    after: Vec<Given<N>>,
}

/// A vote given some rows.
#[derive(Debug, Clone)]
struct Given<const N: usize> {
    covariance: SMatrix<f64, N, N>,
    residual: SVector<f64, N>,
    /// Minus `Cov(τ_j, ρ_t)`, transposed.
    with_slips: Vec<SMatrix<f64, N, N>>,
}

/// Searches the states of all votes, best first and a limited number at a time. With an unlimited beam it is exact.
///
/// Adding vote `t` costs one forward substitution a hypothesis: the row of `L` but for shared slips is the same for
/// all its states, and a shared slip adds a column kept with the rows. Hypotheses that agree on a prefix of
/// states share those rows of `L`, and the substitution starts where they part.
///
/// # Errors
/// [`Error::VoteCovariance`] at a vote whose covariance given the earlier ones is not positive definite in any state.
pub(crate) fn search<const N: usize, G: Pose<N>>(
    votes: &Votes<N>,
    params: &GcmParams,
    width: usize,
) -> Result<Beam<N>, Error> {
    let root = Hypothesis {
        score: 0.0,
        weight: 0.0,
        states: Vec::new(),
        sound_counts: SoundCounts::default(),
        rows: Vec::new(),
        slips: Vec::new(),
    };
    let mut beam = Beam { hypotheses: vec![root], dropped: f64::NEG_INFINITY };
    for t in 0..votes.list.len() {
        beam.extend(votes, params, width, t)?;
    }
    beam.weigh_biases::<G>(votes);
    Ok(beam)
}

impl<const N: usize> Beam<N> {
    /// The hypothesis with the highest score; of equals the smallest state vector.
    pub(crate) fn best(&self) -> Option<&Hypothesis<N>> {
        self.hypotheses.iter().reduce(|best, h| if h.weight > best.weight { h } else { best })
    }

    /// Gives each hypothesis the evidence of slips and yaw slips as they are thought of, instead of the normals
    /// searched with.
    fn weigh_biases<G: Pose<N>>(&mut self, votes: &Votes<N>) {
        for hypothesis in &mut self.hypotheses {
            // biases are taken one by one
            let of = |slip: &Slip<N>| votes.slip.log_evidence::<G>(&slip.mean, &slip.covariance);
            let slips = hypothesis.slips.iter().map(of).sum::<f64>();
            let turned = |(t, yaw): (usize, &SMatrix<f64, N, N>)| {
                let found = hypothesis.bias(t, yaw);
                votes.slip.log_turned::<G>(&found.mean, &found.covariance)
            };
            let turns = hypothesis.yaw_slips(votes).map(turned).sum::<f64>();
            hypothesis.weight = hypothesis.score + slips + turns;
        }
    }

    /// Log of the sum of all hypotheses' weights: the log evidence, as far as the beam holds it.
    pub(crate) fn log_evidence(&self) -> f64 {
        let best = self.best().map_or(f64::NEG_INFINITY, |h| h.weight);
        best + self.hypotheses.iter().map(|h| (h.weight - best).exp()).sum::<f64>().ln()
    }

    fn extend(&mut self, votes: &Votes<N>, params: &GcmParams, width: usize, t: usize) -> Result<(), Error> {
        let mut children: Vec<Child<N>> = Vec::new();
        let mut bases = Vec::with_capacity(self.hypotheses.len());
        let mut forward = Forward { w: Vec::with_capacity(t), after: Vec::with_capacity(t + 1) };
        for (parent, hypothesis) in self.hypotheses.iter().enumerate() {
            let shared = parent.checked_sub(1).map_or(0, |p| common_rows(&self.hypotheses[p], hypothesis));
            forward.go_on(votes, t, shared, &hypothesis.rows);
            let Some(given) = forward.after.last() else { continue };
            hypothesis.children(votes, params, t, parent, given, &mut children);
            bases.push((forward.w.clone(), given.with_slips.clone()));
        }
        if children.is_empty() {
            return Err(votes.list[t].singular());
        }
        let kept = self.prune(&mut children, params.depth, width);
        self.hypotheses = children
            .into_iter()
            .zip(kept)
            .filter(|(_, keep)| *keep)
            .map(|(child, _)| self.hypotheses[child.parent].grown(votes, t, &bases[child.parent], child))
            .collect();
        Ok(())
    }

    /// Which children survive: the best `width`, none deeper than `depth`; ties to the smaller state vector.
    fn prune(&mut self, children: &mut [Child<N>], depth: f64, width: usize) -> Vec<bool> {
        let mut order: Vec<usize> = (0..children.len()).collect();
        order.sort_by(|&a, &b| children[b].score.total_cmp(&children[a].score).then(a.cmp(&b)));
        let best = order.first().map_or(0.0, |&c| children[c].score);
        let mut kept = vec![false; children.len()];
        for (rank, &c) in order.iter().enumerate() {
            if rank < width && children[c].score >= best - depth {
                kept[c] = true;
            } else {
                self.dropped = self.dropped.max(children[c].score - best);
                break;
            }
        }
        kept
    }
}

fn common_rows<const N: usize>(a: &Hypothesis<N>, b: &Hypothesis<N>) -> usize {
    a.rows.iter().zip(&b.rows).take_while(|(a, b)| Rc::ptr_eq(a, b)).count()
}

/// `target -= aᵀ b`, unrolled.
fn subtract_product<const N: usize>(
    target: &mut SMatrix<f64, N, N>,
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, N>,
) {
    for (column, of_b) in target.data.0.iter_mut().zip(&b.data.0) {
        for (entry, of_a) in column.iter_mut().zip(&a.data.0) {
            *entry -= of_a.iter().zip(of_b).map(|(x, y)| x * y).sum::<f64>();
        }
    }
}

impl<const N: usize> Forward<N> {
    /// Vote `t` given `rows`, of which the first `shared` are those of the last call.
    fn go_on(&mut self, votes: &Votes<N>, t: usize, shared: usize, rows: &[Rc<Row<N>>]) {
        self.w.truncate(shared);
        self.after.truncate(shared + 1);
        if self.after.is_empty() {
            let (covariance, residual) = (*votes.block(t, t), votes.list[t].rho);
            self.after.push(Given { covariance, residual, with_slips: Vec::new() });
        }
        for (s, row) in rows.iter().enumerate().skip(self.w.len()) {
            let mut w = votes.block(t, s).transpose();
            for (left, above) in row.w.iter().zip(&self.w) {
                subtract_product(&mut w, left, above);
            }
            row.diagonal.solve_lower_triangular_mut(&mut w);
            let mut given = self.after[s].clone();
            subtract_product(&mut given.covariance, &w, &w);
            given.residual.gemv_tr(-1.0, &w, &row.y, 1.0);
            given.with_slips.resize(row.slips.len(), SMatrix::zeros());
            for (cross, u) in given.with_slips.iter_mut().zip(&row.slips) {
                subtract_product(cross, &w, u);
            }
            self.w.push(w);
            self.after.push(given);
        }
    }
}

impl<const N: usize> Hypothesis<N> {
    fn children(
        &self,
        votes: &Votes<N>,
        params: &GcmParams,
        t: usize,
        parent: usize,
        given: &Given<N>,
        children: &mut Vec<Child<N>>,
    ) {
        let vote = &votes.list[t];
        let Given { covariance, residual, with_slips } = given;
        let mut push = |state, log_prior: f64, covariance, residual: &SVector<f64, N>| {
            if let Some((density, diagonal, y)) = log_normal(&covariance, residual) {
                children.push(Child { parent, state, score: self.score + log_prior + density, diagonal, y });
            }
        };
        match &vote.kind {
            Kind::Prior { bad } => {
                push(State::Good, params.prior_sound.ln(), *covariance, residual);
                push(State::BadPrior, (1.0 - params.prior_sound).ln(), covariance + bad, residual);
            }
            Kind::Cluster { single, spike, yaw, gross, elsewhere, neighbor, .. } => {
                let prior = StatePrior {
                    sound: self.sound_counts.predicted(*single, params),
                    gross: if *single { params.gross_share_single } else { params.gross_share },
                    alpha: if vote.placed { params.alpha } else { params.alpha_unplaced },
                    params,
                    slip_counts: &self.slip_counts(votes, t),
                    neighbor: neighbor.map(|(v, kappa)| (self.states[v], kappa)),
                };
                push(State::Good, prior.log(State::Good), covariance + spike, residual);
                push(State::YawSlip, prior.log(State::YawSlip), covariance + yaw, residual);
                push(State::Gross, prior.log(State::Gross), covariance + gross, residual);
                push(State::Elsewhere, prior.log(State::Elsewhere), covariance + elsewhere, residual);
                // harmless bias is common to slipped groups too; without it equal slips would fit better than truth
                let slipped = covariance + spike;
                for (j, (slip, cross)) in self.slips.iter().zip(with_slips).enumerate() {
                    let state = State::Slip(j as u16);
                    let shared = slipped + slip.covariance + cross + cross.transpose();
                    push(state, prior.log(state), shared, &(residual - slip.mean));
                }
                let fresh = State::Slip(self.slips.len() as u16);
                push(fresh, prior.log(fresh), slipped + votes.slip.searched(), residual);
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

    /// The hypothesis with one more vote; `base` is its row and its covariance with the slips before its state.
    fn grown(
        &self,
        votes: &Votes<N>,
        t: usize,
        (base, with_slips): &(Vec<SMatrix<f64, N, N>>, Vec<SMatrix<f64, N, N>>),
        child: Child<N>,
    ) -> Self {
        let mut next = Self {
            score: child.score,
            weight: child.score,
            states: self.states.clone(),
            sound_counts: self.sound_counts,
            rows: Vec::with_capacity(t + 1),
            slips: self.slips.clone(),
        };
        next.rows.extend_from_slice(&self.rows);
        if let Kind::Cluster { single, .. } = votes.list[t].kind {
            next.sound_counts.add(single, child.state == State::Good);
        }
        let (mut w, mut columns) = (base.clone(), with_slips.clone());
        if let State::Slip(joined) = child.state {
            let joined = usize::from(joined);
            if joined == next.slips.len() {
                next.slips.push(Slip { mean: SVector::zeros(), covariance: *votes.slip.searched() });
                columns.push(*votes.slip.searched());
            } else {
                self.join(joined, &mut w, &mut columns);
            }
        }
        for (slip, column) in next.slips.iter_mut().zip(&mut columns) {
            child.diagonal.solve_lower_triangular_mut(column);
            subtract_product(&mut slip.covariance, column, column);
            slip.mean.gemv_tr(1.0, column, &child.y, 1.0);
        }
        next.states.push(child.state);
        next.rows.push(Rc::new(Row { w, diagonal: child.diagonal, y: child.y, slips: columns }));
        next
    }

    /// Turns the next row and its covariance with each slip into those of a vote that has slip `joined`, too.
    fn join(&self, joined: usize, w: &mut [SMatrix<f64, N, N>], columns: &mut [SMatrix<f64, N, N>]) {
        columns[joined] += self.slips[joined].covariance;
        for (w, row) in w.iter_mut().zip(&self.rows) {
            let Some(u) = row.slips.get(joined) else { continue };
            *w += u;
            for (other, column) in row
                .slips
                .iter()
                .zip(columns.iter_mut())
                .enumerate()
                .filter(|(j, _)| *j != joined)
                .map(|(_, pair)| pair)
            {
                subtract_product(column, u, other);
            }
        }
    }

    /// The votes that have a yaw slip, with its covariance.
    fn yaw_slips<'a>(&'a self, votes: &'a Votes<N>) -> impl Iterator<Item = (usize, &'a SMatrix<f64, N, N>)> {
        let turned = votes.list.iter().zip(&self.states).enumerate();
        turned.filter_map(|(t, (vote, state))| match (&vote.kind, state) {
            (Kind::Cluster { yaw, .. }, State::YawSlip) => Some((t, yaw)),
            _ => None,
        })
    }

    /// What all votes tell of the bias of vote `t`, which is `N(0, own)` by itself: with `U = L⁻¹ E_t S` its mean is
    /// `Uᵀ y` and its covariance `S - Uᵀ U`.
    fn bias(&self, t: usize, own: &SMatrix<f64, N, N>) -> Slip<N> {
        let mut found = Slip { mean: SVector::zeros(), covariance: *own };
        let mut columns: Vec<SMatrix<f64, N, N>> = Vec::with_capacity(self.rows.len() - t);
        for row in &self.rows[t..] {
            let mut column = if columns.is_empty() { *own } else { SMatrix::zeros() };
            for (left, above) in row.w.iter().skip(t).zip(&columns) {
                subtract_product(&mut column, left, above);
            }
            row.diagonal.solve_lower_triangular_mut(&mut column);
            subtract_product(&mut found.covariance, &column, &column);
            found.mean.gemv_tr(1.0, &column, &row.y, 1.0);
            columns.push(column);
        }
        found
    }

    /// `K_H⁻¹ ρ`, one block a vote.
    pub(crate) fn solution(&self) -> Vec<SVector<f64, N>> {
        let mut x: Vec<SVector<f64, N>> = self.rows.iter().map(|row| row.y).collect();
        for t in (0..x.len()).rev() {
            let row = &self.rows[t];
            row.diagonal.tr_solve_lower_triangular_mut(&mut x[t]);
            let solved = x[t];
            for (above, w) in x.iter_mut().zip(&row.w) {
                above.gemv(-1.0, w, &solved, 1.0);
            }
        }
        x
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

/// How many votes so far are sound: `[lone closures, groups]`, each `(sound, all)`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SoundCounts([(u32, u32); 2]);

impl SoundCounts {
    fn add(&mut self, single: bool, sound: bool) {
        let (good, all) = &mut self.0[usize::from(!single)];
        *good += u32::from(sound);
        *all += 1;
    }

    /// Predictive share of sound votes under `Beta(strength · share, strength · (1 - share))`.
    fn predicted(&self, single: bool, params: &GcmParams) -> f64 {
        let (good, all) = self.0[usize::from(!single)];
        let share = params.sound_share(single);
        share + (f64::from(good) - share * f64::from(all)) / (params.sound_strength + f64::from(all))
    }
}

/// Prior of a cluster's state given the hypothesis so far.
struct StatePrior<'a> {
    sound: f64,
    gross: f64,
    /// α of the robot pair.
    alpha: f64,
    params: &'a GcmParams,
    /// Of the same robot pair.
    slip_counts: &'a [u32],
    neighbor: Option<(State, f64)>,
}

impl StatePrior<'_> {
    fn independent(&self, state: State) -> f64 {
        let local = (1.0 - self.sound) * (1.0 - self.gross);
        let slips: u32 = self.slip_counts.iter().sum();
        match state {
            State::Good => self.sound,
            State::Gross => (1.0 - self.sound) * self.gross * (1.0 - self.params.elsewhere_share),
            State::Elsewhere => (1.0 - self.sound) * self.gross * self.params.elsewhere_share,
            State::YawSlip => local * (1.0 - self.params.slip_share),
            State::BadPrior => 0.0,
            State::Slip(j) => {
                // Pitman-Yor with discount 1 - α: whatever the order, slips that repeat make repetition likelier
                let discount = 1.0 - self.alpha;
                let distinct = self.slip_counts.iter().filter(|count| **count > 0).count() as f64;
                let new = if slips == 0 { 1.0 } else { discount * distinct / f64::from(slips) };
                let step = match self.slip_counts.get(usize::from(j)) {
                    Some(0) => self.params.alpha_across * new,
                    Some(&count) => (f64::from(count) - discount) / f64::from(slips),
                    None => new,
                };
                local * self.params.slip_share * step
            }
        }
    }

    fn log(&self, state: State) -> f64 {
        let independent = self.independent(state);
        match self.neighbor {
            Some((same, kappa)) => {
                (kappa * f64::from(u8::from(same == state)) + (1.0 - kappa) * independent).ln()
            }
            None => independent.ln(),
        }
    }
}

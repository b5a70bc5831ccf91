//! The beam against enumeration of all states with dense matrices: no code in common but the list of votes.

use nalgebra::{DMatrix, DVector, Isometry2, Isometry3, Matrix3, SMatrix};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::beam::{Hypothesis, State, search};
use super::consensus::Consensus;
use super::frames::Frames;
use super::params::{GcmParams, Sigma};
use super::problem::Problem;
use super::votes::{Kind, Votes};
use crate::Pose;
use crate::simulate::{Harbor, Meetings, SimulatedTeam, harbor};

type Team = SimulatedTeam<Isometry2<f64>, 3>;

/// Three robots with six groups and two priors.
fn six_groups(seed: u64) -> Team {
    let meetings = [(0, 1, 2), (0, 2, 2), (1, 2, 2)];
    let meetings =
        meetings.map(|(first, second, n)| Meetings { first, second, groups: vec![None; n] }).to_vec();
    let params =
        Harbor { meetings, gross_share: 0.0, biased_share: 0.5, group_size: (2, 6), ..Harbor::default() };
    harbor(&params, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

/// The votes of the whole team, each of `order` once, else in the usual order; `kappa` false cuts the ties between
/// neighbouring groups.
fn votes<const N: usize, G: Pose<N>>(
    team: &SimulatedTeam<G, N>,
    params: &GcmParams,
    kappa: bool,
) -> Votes<N> {
    let problem = Problem::new(&team.trajectories, &team.closures, &team.priors, params).unwrap();
    let evidence = problem.evidence(&team.trajectories, params);
    let frames = Frames::new(0, &team.trajectories, evidence.closures, evidence.transforms, evidence.priors);
    let chosen: Vec<usize> = (0..evidence.clusters.len()).collect();
    let mut votes = Votes::new(&evidence, &frames, &chosen, |_| true);
    if !kappa {
        votes.list.iter_mut().for_each(|vote| {
            if let Kind::Cluster { neighbor, .. } = &mut vote.kind {
                *neighbor = None;
            }
        });
    }
    votes
}

fn unlimited() -> GcmParams {
    GcmParams { beam: usize::MAX, depth: f64::INFINITY, ..GcmParams::default() }
}

/// Every state vector, slips numbered as they first occur.
fn all_states(votes: &Votes<3>) -> Vec<Vec<State>> {
    let mut all: Vec<Vec<State>> = vec![Vec::new()];
    for vote in &votes.list {
        let mut next = Vec::new();
        for states in all {
            let open =
                states.iter().filter_map(|s| if let State::Slip(j) = s { Some(j + 1) } else { None }).max();
            let mut choices = match vote.kind {
                Kind::Prior { .. } => vec![State::Good, State::BadPrior],
                Kind::Cluster { .. } => vec![State::Good, State::YawSlip, State::Gross, State::Elsewhere],
            };
            if matches!(vote.kind, Kind::Cluster { .. }) {
                choices.extend((0..=open.unwrap_or(0)).map(State::Slip));
            }
            next.extend(choices.into_iter().map(|state| [&states[..], &[state]].concat()));
        }
        all = next;
    }
    all
}

/// Log prior of a state vector by the formulas of the module docs.
fn log_prior<const N: usize>(votes: &Votes<N>, params: &GcmParams, states: &[State]) -> f64 {
    let mut sum = 0.0;
    for (t, vote) in votes.list.iter().enumerate() {
        let Kind::Cluster { single, neighbor, .. } = &vote.kind else {
            sum += if states[t] == State::Good { params.prior_sound } else { 1.0 - params.prior_sound }.ln();
            continue;
        };
        let earlier = |wanted: &dyn Fn(State) -> bool| {
            let alike = (0..t).filter(
                |&s| matches!(votes.list[s].kind, Kind::Cluster { single: other, .. } if other == *single),
            );
            alike.filter(|&s| wanted(states[s])).count() as f64
        };
        let (share, gross) = if *single {
            (params.sound_single, params.gross_share_single)
        } else {
            (params.sound, params.gross_share)
        };
        let weight = params.sound_strength;
        let sound = (weight * share + earlier(&|s| s == State::Good)) / (weight + earlier(&|_| true));
        let of_pair: Vec<State> =
            (0..t).filter(|&s| votes.list[s].robots == vote.robots).map(|s| states[s]).collect();
        let slips: Vec<State> = of_pair.into_iter().filter(|s| matches!(s, State::Slip(_))).collect();
        let same = slips.iter().filter(|s| **s == states[t]).count() as f64;
        let distinct = slips.iter().collect::<std::collections::BTreeSet<_>>().len() as f64;
        let slips = slips.len() as f64;
        let pair = std::collections::BTreeSet::from([vote.robots.0, vote.robots.1]);
        let placed = votes.list.iter().any(|v| {
            matches!(v.kind, Kind::Prior { .. })
                && std::collections::BTreeSet::from([v.robots.0, v.robots.1]) == pair
        });
        let alpha = if placed { params.alpha } else { params.alpha_unplaced };
        let elsewhere = states[..t].contains(&states[t]);
        let slipped = (1.0 - sound) * (1.0 - gross);
        let own = match states[t] {
            State::Good => sound,
            State::Gross => (1.0 - sound) * gross * (1.0 - params.elsewhere_share),
            State::Elsewhere => (1.0 - sound) * gross * params.elsewhere_share,
            State::YawSlip => slipped * (1.0 - params.slip_share),
            State::Slip(_) if same > 0.0 => slipped * params.slip_share * (same - 1.0 + alpha) / slips,
            State::Slip(_) => {
                let new = if slips == 0.0 { 1.0 } else { (1.0 - alpha) * distinct / slips };
                slipped * params.slip_share * new * if elsewhere { params.alpha_across } else { 1.0 }
            }
            State::BadPrior => 0.0,
        };
        let (tied, kappa) =
            neighbor.map_or((0.0, 0.0), |(v, k)| (f64::from(u8::from(states[v] == states[t])), k));
        sum += (kappa * tied + (1.0 - kappa) * own).ln();
    }
    sum
}

/// `K_H` as one dense matrix.
fn covariance<const N: usize>(votes: &Votes<N>, states: &[State]) -> DMatrix<f64> {
    let n = votes.list.len();
    let mut k = DMatrix::zeros(N * n, N * n);
    for g in 0..n {
        for h in 0..=g {
            let mut block: SMatrix<f64, N, N> = *votes.block(g, h);
            if g != h && states[g] == states[h] && matches!(states[g], State::Slip(_)) {
                block += votes.slip.searched();
            }
            if g == h {
                block += match (&votes.list[g].kind, states[g]) {
                    (Kind::Prior { bad }, State::BadPrior) => *bad,
                    (Kind::Cluster { spike, .. }, State::Good) => *spike,
                    (Kind::Cluster { spike, .. }, State::Slip(_)) => spike + votes.slip.searched(),
                    (Kind::Cluster { yaw, .. }, State::YawSlip) => *yaw,
                    (Kind::Cluster { gross, .. }, State::Gross) => *gross,
                    (Kind::Cluster { elsewhere, .. }, State::Elsewhere) => *elsewhere,
                    _ => SMatrix::zeros(),
                };
            }
            k.fixed_view_mut::<N, N>(N * g, N * h).copy_from(&block);
            k.fixed_view_mut::<N, N>(N * h, N * g).copy_from(&block.transpose());
        }
    }
    k
}

fn log_normal<const N: usize>(votes: &Votes<N>, states: &[State]) -> f64 {
    let rho: Vec<f64> = votes.list.iter().flat_map(|v| v.rho.iter().copied()).collect();
    let rho = DVector::from_vec(rho);
    let factor = covariance(votes, states).cholesky().unwrap();
    let log_determinant = 2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    -0.5 * (rho.dot(&factor.solve(&rho)) + log_determinant + rho.len() as f64 * std::f64::consts::TAU.ln())
}

fn score<const N: usize>(votes: &Votes<N>, params: &GcmParams, states: &[State]) -> f64 {
    log_prior(votes, params, states) + log_normal(votes, states)
}

/// Posterior that each vote is good.
fn posterior(scored: &[(Vec<State>, f64)]) -> Vec<f64> {
    let best = scored.iter().map(|(_, s)| *s).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = scored.iter().map(|(_, s)| (s - best).exp()).sum();
    let good = |t: usize| {
        let of_good = scored.iter().filter(|(states, _)| states[t] == State::Good);
        of_good.map(|(_, s)| (s - best).exp()).sum::<f64>() / total
    };
    (0..scored[0].0.len()).map(good).collect()
}

fn of_beam(hypotheses: &[Hypothesis<3>]) -> Vec<(Vec<State>, f64)> {
    hypotheses.iter().map(|h| (h.states.clone(), h.score)).collect()
}

#[test]
fn a_beam_of_unlimited_width_is_enumeration_of_all_states() {
    let params = unlimited();
    let mut most = 0;
    for seed in 0..4 {
        let mut team = six_groups(seed);
        if seed % 2 == 1 {
            team.priors.pop();
        }
        let votes = votes(&team, &params, true);
        let clusters = votes.list.iter().filter(|v| matches!(v.kind, Kind::Cluster { .. })).count();
        if clusters > 6 {
            continue;
        }
        let scored: Vec<(Vec<State>, f64)> = all_states(&votes)
            .into_iter()
            .map(|states| {
                let score = score(&votes, &params, &states);
                (states, score)
            })
            .collect();
        let beam = search::<3, Isometry2<f64>>(&votes, &mut Consensus::new(), &params, params.beam).unwrap();
        assert_eq!(beam.dropped, f64::NEG_INFINITY);
        assert_eq!(beam.hypotheses.len(), scored.len());
        for (p, q) in posterior(&scored).iter().zip(posterior(&of_beam(&beam.hypotheses))) {
            assert!((p - q).abs() < 1e-9, "seed {seed}: {p} by enumeration, {q} by the beam");
        }
        most = most.max(scored.len());
    }
    assert!(most > 10_000, "{most} states at most");
}

#[test]
fn every_kept_hypothesis_has_the_score_of_the_dense_normal() {
    for seed in 0..10 {
        let params = GcmParams::default();
        let team: Team = harbor(&Harbor::default(), &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let votes = votes(&team, &params, true);
        for hypothesis in &search::<3, Isometry2<f64>>(&votes, &mut Consensus::new(), &params, params.beam)
            .unwrap()
            .hypotheses
        {
            let dense = score(&votes, &params, &hypothesis.states);
            assert!(
                (dense - hypothesis.score).abs() < 1e-8 * (1.0 + dense.abs()),
                "{dense} {}",
                hypothesis.score
            );
        }
    }
}

/// Teams with many errors: every hypothesis has the score and the solution of the dense normal, whatever the consensus.
/// Returns which states were seen, and whether two robot pairs shared a slip.
fn hypotheses_are_those_of_the_dense_normal<const N: usize, G: Pose<N>>(
    harbour: &Harbor,
    params: &GcmParams,
    seeds: std::ops::Range<u64>,
) -> (std::collections::BTreeSet<State>, bool) {
    const TOLERANCE: f64 = 1e-9;
    let (mut seen, mut shared_across) = (std::collections::BTreeSet::new(), false);
    for seed in seeds {
        let team: SimulatedTeam<G, N> = harbor(harbour, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let votes = votes(&team, params, true);
        let rho = DVector::from_vec(votes.list.iter().flat_map(|v| v.rho.iter().copied()).collect());
        let mut consensus = Consensus::new();
        // the consensus of a greedy search is further from the hypotheses than their own
        search::<N, G>(&votes, &mut consensus, params, 1).unwrap();
        let beam = search::<N, G>(&votes, &mut consensus, params, 24).unwrap();
        let alone = search::<N, G>(&votes, &mut Consensus::new(), params, 24).unwrap();
        assert_eq!(beam.hypotheses.len(), alone.hypotheses.len());
        for (hypothesis, alone) in beam.hypotheses.iter().zip(&alone.hypotheses) {
            let states = &hypothesis.states;
            assert_eq!(states, &alone.states, "seed {seed}");
            let dense = score(&votes, params, states);
            let close = |a: f64, b: f64| (a - b).abs() < TOLERANCE * (1.0 + b.abs());
            assert!(close(hypothesis.score, dense), "seed {seed}: {} {dense}", hypothesis.score);
            assert!(close(alone.score, dense), "seed {seed}: {} {dense}", alone.score);
            assert!(close(hypothesis.weight, alone.weight), "{} {}", hypothesis.weight, alone.weight);
            let solved = covariance(&votes, states).cholesky().unwrap().solve(&rho);
            let found = hypothesis.solution(&votes, &consensus);
            let found = DVector::from_vec(found.iter().flat_map(|x| x.iter().copied()).collect());
            assert!((&found - &solved).norm() < 1e-7 * (1.0 + solved.norm()), "seed {seed}");
            seen.extend(states);
            shared_across |= votes.list.iter().zip(states).any(|(vote, state)| {
                let pairs = votes.list.iter().zip(states).filter(|(_, other)| *other == state);
                matches!(state, State::Slip(_)) && pairs.into_iter().any(|(v, _)| v.robots != vote.robots)
            });
        }
    }
    (seen, shared_across)
}

#[test]
fn teams_full_of_errors_have_the_scores_of_the_dense_normal() {
    let harbour = Harbor { biased_share: 0.5, gross_share: 0.2, ..Harbor::star(2, 4).with_cycles(3) };
    let wild = GcmParams { alpha_across: 1.0, prior_sound: 0.5, ..GcmParams::default() };
    let (seen, shared_across) =
        hypotheses_are_those_of_the_dense_normal::<3, Isometry2<f64>>(&harbour, &wild, 0..12);
    let kinds =
        [State::Good, State::YawSlip, State::Gross, State::Elsewhere, State::BadPrior, State::Slip(3)];
    assert!(kinds.iter().all(|state| seen.contains(state)) && shared_across, "{seen:?} {shared_across}");
    // a yaw slip that is narrower than good groups in translation: what it adds to them is indefinite
    let narrow = GcmParams { yaw: Sigma { translation: 0.02, rotation: 0.07 }, ..wild.clone() };
    let (seen, _) = hypotheses_are_those_of_the_dense_normal::<3, Isometry2<f64>>(&harbour, &narrow, 0..12);
    assert!(seen.contains(&State::YawSlip));
    let (seen, _) = hypotheses_are_those_of_the_dense_normal::<6, Isometry3<f64>>(&harbour, &wild, 0..4);
    assert!(seen.contains(&State::Slip(1)) && seen.contains(&State::Gross), "{seen:?}");
}

#[test]
fn yaw_slips_weigh_by_what_all_votes_tell_of_their_bias() {
    let params = GcmParams::default();
    let mut judged = 0;
    for seed in 0..20 {
        let team: Team = harbor(&Harbor::default(), &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let votes = votes(&team, &params, true);
        let rho = DVector::from_vec(votes.list.iter().flat_map(|v| v.rho.iter().copied()).collect());
        for hypothesis in &search::<3, Isometry2<f64>>(&votes, &mut Consensus::new(), &params, params.beam)
            .unwrap()
            .hypotheses
        {
            let states = &hypothesis.states;
            if states.iter().any(|s| matches!(s, State::Slip(_))) || !states.contains(&State::YawSlip) {
                continue;
            }
            let inverse = covariance(&votes, states).try_inverse().unwrap();
            let solved = &inverse * &rho;
            let mut sum = 0.0;
            for (t, vote) in votes.list.iter().enumerate().filter(|(t, _)| states[*t] == State::YawSlip) {
                let Kind::Cluster { yaw, .. } = &vote.kind else { panic!("a prior with a yaw slip") };
                let own: Matrix3<f64> = inverse.fixed_view::<3, 3>(3 * t, 3 * t).into();
                let mean = yaw * solved.fixed_rows::<3>(3 * t);
                sum += votes.slip.log_turned::<Isometry2<f64>>(&mean, &(yaw - yaw * own * yaw));
            }
            let weighed = hypothesis.weight - hypothesis.score;
            assert!((weighed - sum).abs() < 1e-6 * (1.0 + sum.abs()), "seed {seed}: {weighed} {sum}");
            judged += 1;
        }
    }
    assert!(judged > 20, "{judged}");
}

#[test]
fn without_ties_between_neighbours_the_order_of_the_votes_does_not_matter() {
    let params = GcmParams::default();
    for seed in 0..10 {
        let team: Team = harbor(&Harbor::default(), &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let votes = votes(&team, &params, false);
        let backwards = votes.reordered(&(0..votes.list.len()).rev().collect::<Vec<_>>());
        let best = search::<3, Isometry2<f64>>(&votes, &mut Consensus::new(), &params, params.beam).unwrap();
        for hypothesis in best.hypotheses.iter().take(8) {
            let turned: Vec<State> = renumbered(hypothesis.states.iter().rev().copied());
            let score = score(&backwards, &params, &turned);
            assert!(
                (score - hypothesis.score).abs() < 1e-8 * (1.0 + score.abs()),
                "{score} {}",
                hypothesis.score
            );
        }
    }
}

/// Slips numbered as they occur.
fn renumbered(states: impl Iterator<Item = State>) -> Vec<State> {
    let mut seen: Vec<u16> = Vec::new();
    states
        .map(|state| match state {
            State::Slip(j) => {
                let at = seen.iter().position(|s| *s == j).unwrap_or_else(|| {
                    seen.push(j);
                    seen.len() - 1
                });
                State::Slip(at as u16)
            }
            other => other,
        })
        .collect()
}

/// χ² of all residuals of teams without outliers over its degrees of freedom.
fn normalized_chi2(params: &Harbor, trials: u64) -> f64 {
    let settings = GcmParams::default();
    let (mut sum, mut freedom) = (0.0, 0.0);
    for seed in 0..trials {
        let team: Team = harbor(params, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let votes = votes(&team, &settings, false);
        let states = vec![State::Good; votes.list.len()];
        let rho: Vec<f64> = votes.list.iter().flat_map(|v| v.rho.iter().copied()).collect();
        let rho = DVector::from_vec(rho);
        let factor = covariance(&votes, &states).cholesky().unwrap();
        sum += rho.dot(&factor.solve(&rho));
        // each map transform is fitted: its base is so wide that it takes its three degrees of freedom
        freedom += rho.len() as f64 - 3.0 * f64::from(params.robots - 1);
    }
    sum / freedom
}

#[test]
fn residuals_of_sound_groups_have_the_covariance_told() {
    for (name, sigma, odometry) in
        [("tight", 0.05, 0.3), ("usual", 1.0, 0.3), ("wide", 2.0, 0.1), ("odometry", 0.3, 1.0)]
    {
        let cycles = Harbor::star(2, 4).with_cycles(3);
        let params = Harbor { biased_share: 0.0, gross_share: 0.0, prior_sigma: sigma, odometry, ..cycles };
        let ratio = normalized_chi2(&params, 40);
        assert!((0.9..1.1).contains(&ratio), "{name}: {ratio}");
    }
}

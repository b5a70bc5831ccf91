//! How far are the verdicts from the best that anyone could give? The posterior of an observer who knows how the
//! harbour was made: the true groups, where the maps lie, the steps of the lattice, all shares, honest priors.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};
use std::rc::Rc;

use nalgebra::{Isometry2, Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::beam::{State, search};
use super::clusters::Cluster;
use super::consensus::Consensus;
use super::findings::Findings;
use super::frames::Frames;
use super::params::GcmParams;
use super::problem::Problem;
use super::verdict::{Case, Verdict, verdicts};
use super::votes::{Kind, Votes};
use crate::simulate::{Bias, Harbor, Label, Meetings, SimulatedTeam, harbor};

type Team = SimulatedTeam<Isometry2<f64>, 3>;

/// The team of a seed, two robots without prior, and the heading of robot 0's first pose, the generator's first two
/// draws.
fn team(params: &Harbor, seed: u64) -> (Team, f64) {
    let mut team = harbor(params, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
    if params.robots == 2 {
        team.priors.clear();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let start: f64 = rng.random_range(0.0..TAU);
    let direction = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    (team, start + direction * PI / 2.0)
}

/// The generator's groups without their lone outliers.
fn true_clusters(team: &Team) -> Vec<Cluster> {
    let of_group = |g: usize| {
        let sound =
            (0..team.closures.len()).filter(|&m| team.groups[m] == g && team.labels[m] != Label::Gross);
        sound.collect::<Vec<_>>()
    };
    let all = (0..team.biases.len()).map(of_group).filter(|members| !members.is_empty());
    all.map(|members| {
        let closure = &team.closures[members[0]];
        let robots = (closure.source.robot, closure.target.robot);
        Cluster { robots, group: members[0], members, is_main: true }
    })
    .collect()
}

/// One way a group may have come about.
struct Cause {
    log_share: f64,
    shift: Vector3<f64>,
    extra: Matrix3<f64>,
}

fn spread(metres: f64, radians: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(metres * metres, metres * metres, radians * radians))
}

/// Causes of a bias as [`Bias::Mixed`] or [`Bias::Translation`] draw them; `yaw` turns about the group's place.
fn causes(params: &Harbor, heading: f64, yaw: &Matrix3<f64>) -> Vec<Cause> {
    let mut all = Vec::new();
    let mut add = |share: f64, angle: f64, length: f64, sigma: f64| {
        let shift = Vector3::new(length * angle.cos(), length * angle.sin(), 0.0);
        all.push(Cause { log_share: (params.biased_share * share).ln(), shift, extra: spread(sigma, 1e-4) });
    };
    let mut ring = |share: f64, radius: f64, sigma: f64| {
        let n = (TAU * radius / (2.0 * sigma)).ceil() as usize;
        (0..n).for_each(|i| add(share / n as f64, TAU * i as f64 / n as f64, radius, sigma));
    };
    match params.bias {
        Bias::Translation(length) => ring(1.0, length, 0.1),
        Bias::SharedSlip => {
            for axis in 0..4 {
                for spacing in [1.6, 6.0] {
                    add(1.0 / 8.0, f64::from(axis) * PI / 2.0 - heading, spacing, 1e-3);
                }
            }
        }
        _ => {
            (0..10).for_each(|i| ring(0.03, 1.15 + 0.3 * f64::from(i), 0.15));
            for axis in 0..4 {
                for spacing in [1.6, 6.0] {
                    add(0.5 / 8.0, f64::from(axis) * PI / 2.0 - heading, spacing, 1e-3);
                }
            }
            all.push(Cause {
                log_share: (params.biased_share * 0.2).ln(),
                shift: Vector3::zeros(),
                extra: *yaw,
            });
        }
    }
    all
}

#[derive(Clone)]
struct Hypothesis {
    score: f64,
    good: Vec<bool>,
    step: Option<usize>,
    w: Vec<Rc<Vec<Matrix3<f64>>>>,
    diagonal: Vec<Matrix3<f64>>,
    y: Vec<Vector3<f64>>,
}

/// Posterior that each vote is sound for who knows the generator.
fn informed(votes: &Votes<3>, params: &Harbor, heading: f64) -> Vec<f64> {
    const WIDTH: usize = 100;
    let root = Hypothesis { score: 0.0, good: vec![], step: None, w: vec![], diagonal: vec![], y: vec![] };
    let mut beam = vec![root];
    for (t, vote) in votes.list.iter().enumerate() {
        let honest = Cause { log_share: 0.0, shift: Vector3::zeros(), extra: Matrix3::zeros() };
        let options: Vec<(bool, Cause)> = match &vote.kind {
            Kind::Prior { .. } => vec![(true, honest)],
            Kind::Cluster { spike, yaw, .. } => {
                // four degrees, no translation: the preset's yaw slip without its 0.3 m
                let turn = (yaw - spike * 9.0) * (4f64.to_radians() / 0.0684).powi(2).min(1.1) + spike * 1e-4;
                let sound = Cause { log_share: (1.0 - params.biased_share).ln(), extra: *spike, ..honest };
                let biased = causes(params, heading, &turn).into_iter().map(|c| (false, c));
                std::iter::once((true, sound)).chain(biased).collect()
            }
        };
        let mut next = Vec::new();
        for h in &beam {
            let (mut c, mut r, mut row) = (*votes.block(t, t), vote.rho, Vec::with_capacity(t));
            for s in 0..t {
                let mut w = votes.block(t, s).transpose();
                h.w[s]
                    .iter()
                    .zip(&row)
                    .for_each(|(left, above): (_, &Matrix3<f64>)| w -= left.transpose() * above);
                h.diagonal[s].solve_lower_triangular_mut(&mut w);
                c -= w.transpose() * w;
                r -= w.transpose() * h.y[s];
                row.push(w);
            }
            let row = Rc::new(row);
            for (at, (good, cause)) in options.iter().enumerate() {
                let shared = params.bias == Bias::SharedSlip && !good;
                if shared && h.step.is_some_and(|step| step != at) {
                    continue;
                }
                let again = if shared && h.step.is_some() { 8f64.ln() } else { 0.0 };
                let step = if shared { Some(at) } else { h.step };
                let Some(factor) = (c + cause.extra).cholesky() else { continue };
                let l = factor.l();
                let y = l.solve_lower_triangular(&(r - cause.shift)).unwrap();
                let density = -0.5 * y.norm_squared() - l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
                next.push((h, h.score + cause.log_share + again + density, *good, row.clone(), l, y, step));
            }
        }
        next.sort_by(|a, b| b.1.total_cmp(&a.1));
        next.truncate(WIDTH);
        let grown = next.into_iter().map(|(h, score, good, row, l, y, step)| {
            let mut h = h.clone();
            h.score = score;
            h.step = step;
            h.good.push(good);
            h.w.push(row);
            h.diagonal.push(l);
            h.y.push(y);
            h
        });
        beam = grown.collect();
    }
    let best = beam[0].score;
    let total: f64 = beam.iter().map(|h| (h.score - best).exp()).sum();
    let of =
        |t: usize| beam.iter().filter(|h| h.good[t]).map(|h| (h.score - best).exp()).sum::<f64>() / total;
    (0..votes.list.len()).map(of).collect()
}

/// The posterior of the model.
fn by_model(votes: &Votes<3>, params: &GcmParams) -> Vec<f64> {
    let beam = search::<3, Isometry2<f64>>(votes, &mut Consensus::new(), params, params.beam).unwrap();
    let best = beam.best().unwrap().weight;
    let total: f64 = beam.hypotheses.iter().map(|h| (h.weight - best).exp()).sum();
    let of = |t: usize| {
        let good = beam.hypotheses.iter().filter(|h| h.states[t] == State::Good);
        good.map(|h| (h.weight - best).exp()).sum::<f64>() / total
    };
    (0..votes.list.len()).map(of).collect()
}

/// A group: its probability and verdict, and how many of its closures are good and biased.
struct Graded {
    probability: f64,
    verdict: Verdict,
    good: usize,
    biased: usize,
}

/// What each vote's probability is of its cluster.
fn by_cluster(votes: &Votes<3>, p: &[f64], clusters: usize) -> Vec<f64> {
    let mut sound = vec![0.0; clusters];
    for (vote, &p) in votes.list.iter().zip(p) {
        if let Kind::Cluster { cluster, .. } = vote.kind {
            sound[cluster] = p;
        }
    }
    sound
}

/// The groups of a team as `gcm` judges them from the posterior of each.
fn graded(team: &Team, clusters: &[Cluster], settings: &GcmParams, sound: Vec<f64>) -> Vec<Graded> {
    let mut findings = Findings::new(clusters.len());
    findings.sound = sound;
    findings.weigh_evidence(clusters, settings);
    let has_priors = !team.priors.is_empty();
    let case = Case { clusters, findings: &findings, params: settings, held: &BTreeSet::new(), has_priors };
    let verdicts = verdicts(&case, |_| Some(0));
    let of = |((cluster, &probability), verdict): ((&Cluster, &f64), Verdict)| {
        let count = |l| cluster.members.iter().filter(|&&m| team.labels[m] == l).count();
        Graded { probability, verdict, good: count(Label::Good), biased: count(Label::Biased) }
    };
    clusters.iter().zip(&findings.sound).zip(verdicts).map(of).collect()
}

/// Shares of biased and of good closures in the groups that are taken.
fn shares(groups: &[Graded], taken: impl Fn(&Graded) -> bool) -> (f64, f64) {
    let share = |count: &dyn Fn(&Graded) -> usize| {
        let of_taken = groups.iter().filter(|g| taken(g)).map(count).sum::<usize>();
        of_taken as f64 / groups.iter().map(count).sum::<usize>().max(1) as f64
    };
    (share(&|g| g.biased), share(&|g| g.good))
}

fn compare(params: &Harbor, trials: std::ops::Range<u64>, settings: &GcmParams) -> [Vec<Graded>; 3] {
    // who knows the generator needs no calibration
    let as_told = GcmParams { evidence_exponent: 1.0, doubt: 0.0, ..settings.clone() };
    let mut all = [const { Vec::new() }; 3];
    for seed in trials {
        let (team, heading) = team(params, seed);
        let mut problem = Problem::new(&team.trajectories, &team.closures, &team.priors, settings).unwrap();
        for truly in [false, true] {
            if truly {
                problem.clusters = true_clusters(&team);
                problem.noise_scale = 1.0;
            }
            let evidence = problem.evidence(&team.trajectories, settings);
            let mut frames =
                Frames::new(0, &team.trajectories, evidence.closures, evidence.transforms, evidence.priors);
            let centre = frames.of(0);
            for (robot, place) in (0..).zip(&team.reference_from_robot) {
                frames.centre_from_map.insert(robot, centre * place);
            }
            let chosen: Vec<usize> = (0..problem.clusters.len()).collect();
            let votes = Votes::new(&evidence, &frames, &chosen, |_| true);
            let p = by_model(&votes, settings);
            let sound = by_cluster(&votes, &p, problem.clusters.len());
            all[usize::from(truly)].extend(graded(&team, &problem.clusters, settings, sound));
            if truly {
                let p = informed(&votes, params, heading);
                let sound = by_cluster(&votes, &p, problem.clusters.len());
                all[2].extend(graded(&team, &problem.clusters, &as_told, sound));
            }
        }
    }
    all
}

/// What the model says, and what an observer says who knows the generator.
fn told(name: &str, params: &Harbor) -> [Vec<Graded>; 2] {
    let [model, grouped, informed] = compare(params, 1000..1200, &GcmParams::default());
    for (who, groups) in [("model", &model), ("true groups", &grouped), ("informed", &informed)] {
        let at = |least| {
            let (biased, good) = shares(groups, |g| g.probability >= least);
            format!("{least}: {biased:.3}/{good:.3}")
        };
        println!("{name:<12} {who:<12} {}", [0.5, 0.6, 0.7, 0.8, 0.85, 0.9].map(at).join("  "));
    }
    [model, informed]
}

#[test]
#[ignore = "an experiment: a minute"]
fn equal_slips_within_the_drift_deceive_who_knows_the_generator() {
    let star = Harbor::majority(Bias::SharedSlip, 0.5);
    let mut cycles = star.clone();
    cycles.meetings.push(Meetings { first: 1, second: 2, groups: vec![Some((6, false)); 2] });
    // The bars of the comparison: .04 and .02 of the biased closures.
    for (name, params, bar) in [("star", star, 0.04), ("cycles", cycles, 0.02)] {
        let accepted = |groups: Vec<Graded>| shares(&groups, |g| g.verdict == Verdict::Accepted).0;
        let [model, informed] = told(name, &params).map(accepted);
        assert!(informed > bar && informed < model, "{name}: {informed}, {model}");
    }
}

#[test]
#[ignore = "an experiment: a minute"]
fn one_vote_against_one_is_undecided_where_the_drift_is_less_than_the_slip() {
    let undecided = |groups: &[Graded]| {
        let open = groups.iter().filter(|g| g.verdict == Verdict::Undecided);
        open.count() as f64 / groups.len() as f64
    };
    let lone = |odometry| Harbor {
        robots: 2,
        meetings: vec![Meetings { first: 0, second: 1, groups: vec![Some((6, false)), Some((6, true))] }],
        bias: Bias::Translation(2.0),
        gross_share: 0.0,
        odometry,
        ..Harbor::default()
    };
    let [model, _] = told("drift .1", &lone(0.1));
    assert!(undecided(&model) >= 0.98);
    // With the drift of the comparison the two votes often agree, whoever looks at them.
    let [_, informed] = told("drift .3", &lone(0.3));
    assert!(undecided(&informed) < 0.95);
}

#[test]
#[ignore = "an experiment: a minute"]
fn who_knows_the_generator_keeps_no_more_where_a_prior_of_half_a_metre_decides() {
    // The bars of the comparison: .90 of the good closures, .97 of them with `leading`.
    let [model, informed] = told("fixed .5", &Harbor::fixed_regression(0.5));
    let accepted = |groups: &[Graded]| shares(groups, |g| g.verdict == Verdict::Accepted);
    let leading = |groups: &[Graded]| shares(groups, |g| g.probability >= GcmParams::leading().accept);
    for (who, groups) in [("model", &model), ("informed", &informed)] {
        println!("{who:<12} default {:.3?}, leading {:.3?}", accepted(groups), leading(groups));
    }
    assert!(leading(&informed).1 < leading(&model).1 + 0.01);
    assert!(accepted(&informed).1 < accepted(&model).1 + 0.02);
}

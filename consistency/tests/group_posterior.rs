//! The group posterior on seeded harbours: invariances, abstention, and the bars with margins for few trials.

use draco_consistency::simulate::{Bias, Harbor, Label, Meetings, SimulatedTeam, harbor};
use draco_consistency::{
    Closure2, Error, Event, Gcm, GcmOnline, GcmParams, MapTransform2, Pcm, PcmParams, PoseKey, Selection,
    Trajectories2, Trajectory, gcm, isotropic_covariance, pcm,
};
use nalgebra::{Isometry2, Matrix3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

type Team = SimulatedTeam<Isometry2<f64>, 3>;

fn team(params: &Harbor, seed: u64) -> Team {
    harbor(params, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

fn solve(team: &Team, params: &GcmParams) -> Gcm<3> {
    gcm(&team.trajectories, &team.closures, &team.priors, params).unwrap()
}

/// Shares of biased accepted and good kept over many seeds.
fn shares(params: &Harbor, trials: u64, rule: impl Fn(&Team) -> Selection) -> (f64, f64) {
    let (mut biased, mut good) = ((0, 0), (0, 0));
    for seed in 0..trials {
        let team = team(params, seed);
        let selection = rule(&team);
        for (m, label) in team.labels.iter().enumerate() {
            let count = match label {
                Label::Biased => &mut biased,
                Label::Good => &mut good,
                _ => continue,
            };
            count.0 += usize::from(selection.accepts(m));
            count.1 += 1;
        }
    }
    let share = |(kept, all): (i32, i32)| f64::from(kept) / f64::from(all.max(1));
    (share((biased.0 as i32, biased.1)), share((good.0 as i32, good.1)))
}

fn by_pcm(team: &Team) -> Selection {
    pcm(&team.trajectories, &team.closures, &PcmParams::default()).unwrap()
}

#[test]
fn correlated_groups_are_rejected_where_pcm_accepts_them() {
    let params = Harbor::default();
    let ours = shares(&params, 40, |t| solve(t, &GcmParams::default()).selection);
    let pairs = shares(&params, 40, by_pcm);
    assert!(ours.0 < 0.05 && ours.1 > 0.90, "biased {} good {}", ours.0, ours.1);
    assert!(3.0 * ours.0 < pairs.0, "ours {} pcm {}", ours.0, pairs.0);
}

#[test]
fn unbiased_closures_are_kept() {
    let params = Harbor { biased_share: 0.0, ..Harbor::default() };
    let (_, good) = shares(&params, 20, |t| solve(t, &GcmParams::default()).selection);
    assert!(good > 0.975, "good {good}");
}

#[test]
fn gross_closures_alone_are_not_accepted() {
    let params = Harbor { gross_share: 1.0, ..Harbor::default() };
    for seed in 0..10 {
        let team = team(&params, seed);
        assert!(team.labels.iter().all(|l| *l == Label::Gross));
        let accepted = solve(&team, &GcmParams::default()).selection.accepted.len();
        assert!(accepted * 20 <= team.closures.len(), "{accepted} of {}", team.closures.len());
    }
}

/// One neighbour, groups of six, the biased ones 2 m off.
fn lone(groups: &[bool]) -> Harbor {
    let groups = groups.iter().map(|&biased| Some((6, biased))).collect();
    Harbor {
        robots: 2,
        meetings: vec![Meetings { first: 0, second: 1, groups }],
        bias: Bias::Translation(2.0),
        gross_share: 0.0,
        ..Harbor::default()
    }
}

#[test]
fn one_group_without_prior_is_undecided_at_the_prior_share() {
    for seed in 0..20 {
        let mut team = team(&lone(&[seed % 2 == 0]), seed);
        team.priors.clear();
        let found = solve(&team, &GcmParams::default());
        assert_eq!(found.selection.undecided.len(), 6);
        assert!((found.clusters[0].probability - 0.7).abs() < 0.03);
    }
}

#[test]
fn every_closure_has_one_verdict_and_every_refusal_a_reason() {
    let team = team(&Harbor::default(), 3);
    let s = solve(&team, &GcmParams::default()).selection;
    assert_eq!(s.accepted.len() + s.rejected.len() + s.undecided.len(), team.closures.len());
    assert!(s.rejected.iter().chain(&s.undecided).all(|r| !r.reason.to_string().is_empty()));
}

#[test]
fn reversed_closures_and_priors_change_nothing() {
    for seed in 0..10 {
        let mut team = team(&Harbor::default(), seed);
        let before = solve(&team, &GcmParams::default());
        team.closures.iter_mut().step_by(2).for_each(|c| *c = c.reversed());
        team.priors.iter_mut().for_each(|p| *p = p.reversed());
        let after = solve(&team, &GcmParams::default());
        assert_eq!(before.selection.accepted, after.selection.accepted);
        for (a, b) in before.clusters.iter().zip(&after.clusters) {
            assert!((a.probability - b.probability).abs() < 1e-6);
        }
    }
}

#[test]
fn order_of_arrival_changes_no_verdict() {
    for seed in 0..10 {
        let team = team(&Harbor::default(), seed);
        let before = solve(&team, &GcmParams::default()).selection;
        let reversed: Vec<Closure2> = team.closures.iter().rev().copied().collect();
        let after =
            gcm(&team.trajectories, &reversed, &team.priors, &GcmParams::default()).unwrap().selection;
        let mut accepted: Vec<usize> = after.accepted.iter().map(|m| team.closures.len() - 1 - m).collect();
        accepted.sort_unstable();
        assert_eq!(before.accepted, accepted, "seed {seed}");
    }
}

#[test]
fn online_without_hysteresis_equals_batch_at_every_prefix() {
    let team = team(&Harbor::default(), 2);
    let params = GcmParams { withdraw: 0.85, ..GcmParams::default() };
    let mut online = GcmOnline::new(team.trajectories.clone(), team.priors.clone(), params.clone()).unwrap();
    let mut accepted = std::collections::BTreeSet::new();
    let mut known = 0;
    for batch in team.closures.chunks(9) {
        known += batch.len();
        let (found, events) = online.insert(batch).unwrap();
        let whole = gcm(&team.trajectories, &team.closures[..known], &team.priors, &params).unwrap();
        assert_eq!(found, whole);
        for event in events {
            match event {
                Event::Accepted(c) | Event::Revived(c) => assert!(accepted.insert(c)),
                Event::Retracted(c) => assert!(accepted.remove(&c)),
            }
        }
        assert!(accepted.iter().eq(&whole.selection.accepted));
    }
}

#[test]
fn streamed_pcm_holds_a_largest_set_after_every_insert() {
    let team = team(&Harbor::default(), 4);
    let mut stream = Pcm::new(team.trajectories.clone(), PcmParams::default()).unwrap();
    for (index, closure) in team.closures.iter().enumerate() {
        stream.insert(closure).unwrap();
        if index % 10 == 0 || index + 1 == team.closures.len() {
            let batch = pcm(&team.trajectories, &team.closures[..=index], &PcmParams::default()).unwrap();
            assert_eq!(stream.selection().accepted.len(), batch.accepted.len());
        }
    }
}

#[test]
fn bad_input_is_a_typed_error() {
    let good = team(&Harbor::default(), 1);
    let fails = |closures: &[Closure2], priors: &[MapTransform2]| {
        gcm(&good.trajectories, closures, priors, &GcmParams::default()).unwrap_err()
    };
    let mut closure = good.closures[0];
    closure.covariance[(0, 0)] = f64::NAN;
    assert_eq!(fails(&[closure], &[]), Error::ClosureCovariance { closure: 0 });
    closure.covariance = Matrix3::from_element(1.0);
    assert_eq!(fails(&[good.closures[0], closure], &[]), Error::ClosureCovariance { closure: 1 });
    closure = good.closures[0];
    closure.target_from_source.translation.x = f64::INFINITY;
    assert_eq!(fails(&[closure], &[]), Error::ClosurePose { closure: 0 });
    closure = good.closures[0];
    closure.source = PoseKey::new(0, 4000);
    assert_eq!(fails(&[closure], &[]), Error::UnknownPose { closure: 0, robot: 0, index: 4000 });
    closure.source = PoseKey::new(77, 0);
    assert_eq!(fails(&[closure], &[]), Error::UnknownPose { closure: 0, robot: 77, index: 0 });
    let mut prior = good.priors[0];
    prior.covariance = Matrix3::zeros();
    assert_eq!(fails(&good.closures, &[prior]), Error::MapTransform { prior: 0 });
    let params = GcmParams { alpha: 1.5, ..GcmParams::default() };
    let wrong = gcm(&good.trajectories, &good.closures, &good.priors, &params).unwrap_err();
    assert_eq!(wrong, Error::Parameter { name: "alpha" });
    let nothing = gcm(&good.trajectories, &[], &good.priors, &GcmParams::default()).unwrap();
    assert!(nothing.clusters.is_empty());
}

/// Groups of six closures between two robots that stand still, their common error in metres; 1 mm of noise.
fn still(shifts: &[f64]) -> (Trajectories2, Vec<Closure2>) {
    const APART: usize = 30;
    let mut trajectories = Trajectories2::new();
    for robot in 0..2 {
        let poses = vec![Isometry2::identity(); APART * shifts.len()];
        let steps = vec![isotropic_covariance::<3, Isometry2<f64>>(1e-6, 1e-6); poses.len() - 1];
        trajectories.insert(robot, Trajectory::from_steps(poses, &steps).unwrap());
    }
    let closure = |group: usize, k: usize, shift: f64| Closure2 {
        source: PoseKey::new(0, APART * group + k),
        target: PoseKey::new(1, APART * group + k),
        target_from_source: Isometry2::translation(shift, 0.0),
        covariance: isotropic_covariance::<3, Isometry2<f64>>(1e-3, 1e-3),
    };
    let closures =
        shifts.iter().enumerate().flat_map(|(g, &s)| (0..6).map(move |k| closure(g, k, s))).collect();
    (trajectories, closures)
}

#[test]
fn precise_closures_two_to_one_have_the_odds_of_their_votes() {
    let (trajectories, closures) = still(&[0.0, 0.0, 2.0]);
    let params = GcmParams::default();
    let found = gcm(&trajectories, &closures, &[], &params).unwrap();
    let local = (1.0 - params.sound) * (1.0 - params.gross_share) * params.slip_share;
    let odds = params.sound / (local * params.alpha);
    let expected = odds / (1.0 + odds);
    for (cluster, expected) in found.clusters.iter().zip([expected, expected, 1.0 - expected]) {
        let p = cluster.probability;
        assert!((p - expected).abs() < 0.03, "{p} for {expected}");
    }
    // two equal slips look the same, so the strict preset leaves them open
    let strict = gcm(&trajectories, &closures, &[], &GcmParams::strict()).unwrap();
    assert!(strict.selection.accepted.is_empty());
    assert_eq!(strict.selection.undecided.len(), 12);
}

#[test]
fn drift_that_is_no_covariance_is_an_error_and_no_rejection() {
    let (mut trajectories, closures) = still(&[0.0]);
    let indices: Vec<usize> = (0..6).collect();
    let negative = nalgebra::DMatrix::from_diagonal_element(18, 18, -1e6);
    let poses = vec![Isometry2::identity(); 6];
    trajectories.insert(1, Trajectory::with_joint_covariance(poses, &indices, &negative).unwrap());
    let error = gcm(&trajectories, &closures, &[], &GcmParams::default()).unwrap_err();
    assert!(matches!(error, Error::VoteCovariance { source_robot: 0, target_robot: 1, .. }), "{error}");
}

#[test]
fn telling_slipped_groups_twice_accepts_none_of_them() {
    let mut told_twice = 0;
    for seed in 0..10 {
        let mut team = team(&Harbor::default(), seed);
        let before = solve(&team, &GcmParams::default()).selection;
        let slipped: Vec<usize> = before
            .rejected
            .iter()
            .map(|refusal| refusal.closure)
            .filter(|&m| team.labels[m] == Label::Biased)
            .collect();
        let again: Vec<Closure2> = slipped.iter().map(|&m| team.closures[m]).collect();
        team.closures.extend(again);
        let after = solve(&team, &GcmParams::default()).selection;
        assert!(slipped.iter().all(|&m| !after.accepts(m)), "seed {seed}");
        told_twice += slipped.len();
    }
    assert!(told_twice > 50, "{told_twice}");
}

/// The target is 0.05 in every team; the doubled closure also moves its group's mean, which costs one team more.
#[test]
fn a_closure_told_twice_is_no_second_vote() {
    let mut moves = Vec::new();
    for seed in 0..20 {
        let mut team = team(&lone(&[false, false, true]), seed);
        let before = solve(&team, &GcmParams::default());
        team.closures.push(team.closures[0]);
        let after = solve(&team, &GcmParams::default());
        let moved = before
            .cluster_of
            .iter()
            .zip(&after.cluster_of)
            .map(|(&was, &is)| (before.clusters[was].probability - after.clusters[is].probability).abs());
        moves.push(moved.fold(0.0, f64::max));
    }
    moves.sort_by(f64::total_cmp);
    assert!(moves[18] < 0.05 && moves[19] < 0.10, "{moves:?}");
}

//! Small teams made by hand, with verdicts that can be worked out.

use draco_consistency::{
    Closure2, Error, Event, GcmOnline, GcmParams, MapTransform2, PoseKey, Trajectories2, Trajectory, gcm,
    isotropic_covariance,
};
use nalgebra::{Isometry2, Matrix3};

/// Robots that stand still, closures `(first, second, error in metres)` in groups of six.
fn still_team(robots: u32, groups: &[(u32, u32, f64)]) -> (Trajectories2, Vec<Closure2>) {
    const APART: usize = 30;
    let mut trajectories = Trajectories2::new();
    for robot in 0..robots {
        let poses = vec![Isometry2::identity(); APART * groups.len()];
        let steps = vec![isotropic_covariance::<3, Isometry2<f64>>(1e-6, 1e-6); poses.len() - 1];
        trajectories.insert(robot, Trajectory::from_steps(poses, &steps).unwrap());
    }
    let closure = |(at, k): (usize, usize)| {
        let (first, second, shift) = groups[at];
        Closure2 {
            source: PoseKey::new(first, APART * at + k),
            target: PoseKey::new(second, APART * at + k),
            target_from_source: Isometry2::translation(shift, 0.0),
            covariance: isotropic_covariance::<3, Isometry2<f64>>(1e-3, 1e-3),
        }
    };
    let closures = (0..groups.len()).flat_map(|at| (0..6).map(move |k| (at, k))).map(closure).collect();
    (trajectories, closures)
}

/// The map of `source` in that of robot 0, 0.1 m and 5 mrad sure.
fn tight_prior(source: u32, x: f64, y: f64) -> MapTransform2 {
    MapTransform2 {
        source,
        target: 0,
        target_from_source: Isometry2::translation(x, y),
        covariance: isotropic_covariance::<3, Isometry2<f64>>(0.1, 0.005),
    }
}

#[test]
fn precise_closures_two_to_one_have_the_odds_of_their_votes() {
    let (trajectories, closures) = still_team(2, &[(0, 1, 0.0), (0, 1, 0.0), (0, 1, 2.0)]);
    let params = GcmParams { evidence_exponent: 1.0, doubt: 0.0, accept_among: 0.75, ..GcmParams::default() };
    let found = gcm(&trajectories, &closures, &[], &params).unwrap();
    let local = (1.0 - params.sound) * (1.0 - params.gross_share) * params.slip_share;
    // the share of sound votes under Beta(w π, w (1 - π)): two of three against one of three
    let learnt = |share: f64| (params.sound_strength * share + 1.0) / (params.sound_strength * share);
    let odds =
        params.sound * learnt(params.sound) / (local * learnt(1.0 - params.sound) * params.alpha_unplaced);
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
    let (mut trajectories, closures) = still_team(2, &[(0, 1, 0.0)]);
    let indices: Vec<usize> = (0..6).collect();
    let negative = nalgebra::DMatrix::from_diagonal_element(18, 18, -1e6);
    let poses = vec![Isometry2::identity(); 6];
    trajectories.insert(1, Trajectory::with_joint_covariance(poses, &indices, &negative).unwrap());
    let error = gcm(&trajectories, &closures, &[], &GcmParams::default()).unwrap_err();
    assert!(matches!(error, Error::VoteCovariance { source_robot: 0, target_robot: 1, .. }), "{error}");
}

#[test]
fn one_vote_against_one_without_prior_is_undecided_and_even() {
    let (trajectories, closures) = still_team(2, &[(0, 1, 0.0), (0, 1, 2.0)]);
    let found = gcm(&trajectories, &closures, &[], &GcmParams::default()).unwrap();
    let [a, b] = &found.clusters[..] else { panic!("two votes") };
    assert!((a.probability - b.probability).abs() < 0.02, "{} {}", a.probability, b.probability);
    assert_eq!(found.selection.undecided.len(), 12);
}

#[test]
fn a_cycle_rejects_a_slip_against_a_tight_wrong_prior() {
    let groups = [(0, 1, 2.0), (0, 2, 0.0), (0, 2, 0.0), (1, 2, 0.0), (1, 2, 0.0)];
    let (trajectories, closures) = still_team(3, &groups);
    let priors = [tight_prior(1, 0.0, 1.2), tight_prior(2, 0.0, 0.0)];
    let found = gcm(&trajectories, &closures, &priors, &GcmParams::default()).unwrap();
    assert!((0..6).all(|m| found.selection.rejected.iter().any(|r| r.closure == m)));
    assert!((6..18).all(|m| found.selection.accepts(m)), "{:?}", found.clusters);
    assert!(found.selection.rejected.iter().all(|r| r.closure < 6), "{:?}", found.clusters);
}

#[test]
fn two_equal_slips_without_prior_are_no_proof_under_strict() {
    let (trajectories, closures) = still_team(2, &[(0, 1, 0.0), (0, 1, 2.0), (0, 1, 2.0)]);
    let found = gcm(&trajectories, &closures, &[], &GcmParams::strict()).unwrap();
    assert!(found.selection.accepted.is_empty());
}

#[test]
fn what_later_groups_contradict_is_retracted() {
    let groups = [2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0].map(|shift| (0, 1, shift));
    let (trajectories, closures) = still_team(2, &groups);
    let mut online = GcmOnline::new(trajectories, Vec::new(), GcmParams::default()).unwrap();
    let mut events = Vec::new();
    for group in closures.chunks(6) {
        events.extend(online.insert(group).unwrap().1);
    }
    for m in 0..12 {
        assert!(events.contains(&Event::Accepted(m)) && events.contains(&Event::Retracted(m)), "{m}");
    }
    let last = online.update().unwrap().0.selection;
    assert_eq!(last.accepted, (12..42).collect::<Vec<_>>());
}

/// The same step between robots 0 and 1 and between 0 and 2 agrees with every closure between 1 and 2, and nothing
/// else speaks against it.
#[test]
fn a_slip_that_two_neighbours_share_is_never_accepted_by_strict() {
    let groups = [(0, 1, 2.0), (0, 2, 2.0), (1, 2, 0.0), (1, 2, 0.0)];
    let (trajectories, closures) = still_team(3, &groups);
    let found = gcm(&trajectories, &closures, &[], &GcmParams::strict()).unwrap();
    assert!((0..12).all(|m| !found.selection.accepts(m)), "{:?}", found.clusters);
}

#[test]
fn every_closure_accepted_is_of_a_group_that_is_believed() {
    let groups = [(0, 1, 0.0), (0, 1, 0.0), (0, 1, 0.0), (0, 1, 2.0)];
    let (trajectories, closures) = still_team(2, &groups);
    let found = gcm(&trajectories, &closures, &[], &GcmParams::default()).unwrap();
    assert!(!found.selection.accepted.is_empty());
    for &m in &found.selection.accepted {
        let cluster = &found.clusters[found.cluster_of[m]];
        assert!(
            cluster.members.contains(&m) && cluster.probability >= GcmParams::default().accept_among,
            "{m}: {cluster:?}"
        );
    }
}

#[test]
fn closures_of_one_place_weigh_like_one_vote_in_the_pose_graph() {
    let (trajectories, closures) = still_team(2, &[(0, 1, 0.0)]);
    // six measurements of one pair of poses
    let closures = vec![closures[0]; 6];
    let params = GcmParams::default();
    let found = gcm(&trajectories, &closures, &[], &params).unwrap();
    let information: Matrix3<f64> = found.covariances.iter().map(|c| c.try_inverse().unwrap()).sum();
    let spike = isotropic_covariance::<3, Isometry2<f64>>(params.spike.translation, params.spike.rotation);
    let vote = closures[0].covariance / 6.0 + spike;
    assert!((information * vote - Matrix3::identity()).norm() < 1e-9, "{information} {vote}");
}

#[test]
fn closures_of_places_far_apart_share_no_bias_in_the_pose_graph() {
    let (trajectories, closures) = still_team(2, &[(0, 1, 0.0), (0, 1, 0.0)]);
    let params = GcmParams::default();
    let spike = isotropic_covariance::<3, Isometry2<f64>>(params.spike.translation, params.spike.rotation);
    let ends = [closures[0], closures[6]];
    let found = gcm(&trajectories, &ends, &[], &params).unwrap();
    for (covariance, closure) in found.covariances.iter().zip(&ends) {
        assert!((covariance - closure.covariance - spike).norm() < 1e-9);
    }
}

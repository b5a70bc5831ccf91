//! Whole missions: every robot ends up in its place or is honestly left out.

use std::path::PathBuf;

use draco::consistency::Method;
use draco::dataset::read_keyframe_folder;
use draco::evaluate::{Decision, absolute_trajectory_error};
use draco::keyframe::MissionData;
use draco::link::Outage;
use draco::mission::{MissionParams, run};
use draco::report::RunReport;
use draco::simulate::{Scenario, SimulationParams, simulate};
use draco::two_step::Optimisation;

/// Metres. The smallest mistake the harbor invites, one column of pilings, puts a robot 6 m off.
const PLACE_BAR: f64 = 1.5;

/// Metres, of the team on the real recording.
const REAL_BAR: f64 = 2.07;

fn simulated(scenario: Scenario, seed: u64) -> MissionData {
    simulate(&SimulationParams { scenario, seed, ..SimulationParams::default() }).expect("defaults are valid")
}

fn fly(data: &MissionData, method: Method, optimisation: Optimisation) -> RunReport {
    let mut params = MissionParams::default();
    params.robot.method = method;
    params.robot.optimisation = optimisation;
    run(data, &params, |_| {}).expect("the mission runs")
}

fn by_default(data: &MissionData) -> RunReport {
    fly(data, Method::default(), Optimisation::default())
}

fn team_ate(report: &RunReport) -> f64 {
    report.team_error().map_or(f64::NAN, |error| error.rmse_m)
}

fn describe(name: &str, report: &RunReport) -> String {
    let merged: Vec<_> = report.merged().map(|robot| robot.id).collect();
    let team = report.summary().team;
    format!(
        "{name}: merged {merged:?}, team {:.2} m, precision {:.3?}, recall {:.3?}, {} of {} closures",
        team_ate(report),
        team.precision,
        team.recall,
        team.closures.accepted,
        team.closures.proposed
    )
}

/// Panics unless the merged robots are where they belong and the others have at least their own map.
fn assert_honest(name: &str, report: &RunReport) {
    let told = describe(name, report);
    println!("{told}");
    assert_ne!(report.merged().count(), 1, "nobody is merged alone; {told}");
    if report.merged().count() > 1 {
        assert!(team_ate(report) < PLACE_BAR, "{told}");
        // one small robot in a large team must not hide behind the others
        let truth_from_team = report.team_error().expect("truth").truth_from_estimate;
        for robot in report.merged() {
            let known = robot.trajectory.iter().zip(robot.truth.iter().flatten());
            let sum_sq: f64 = known
                .map(|(pose, truth)| {
                    ((truth_from_team * pose).translation.vector - truth.translation.vector).norm_squared()
                })
                .sum();
            let rmse = (sum_sq / robot.truth.len() as f64).sqrt();
            assert!(rmse < PLACE_BAR, "robot {} is {rmse:.2} m off in the team's frame; {told}", robot.id);
        }
    }
    for robot in report.robots.iter().filter(|robot| !robot.merged) {
        let error = absolute_trajectory_error(&robot.trajectory, &robot.truth).expect("truth").rmse_m;
        assert!(error < PLACE_BAR, "robot {} by itself: {error} m", robot.id);
    }
}

#[test]
fn wreck_robots_meet_in_their_places() {
    for seed in [0, 1] {
        let report = by_default(&simulated(Scenario::Wreck, seed));
        assert_honest(&format!("wreck {seed}"), &report);
    }
}

#[test]
#[ignore = "takes a minute; the test above flies the first two seeds"]
fn wreck_robots_meet_in_their_places_for_every_seed() {
    for seed in 0..5 {
        let report = by_default(&simulated(Scenario::Wreck, seed));
        assert_honest(&format!("wreck {seed}"), &report);
    }
}

#[test]
fn harbor_robots_meet_in_their_places() {
    for seed in [1, 2] {
        let report = by_default(&simulated(Scenario::Harbor, seed));
        assert_honest(&format!("harbor {seed}"), &report);
    }
}

/// The pilings are a lattice that half a turn maps onto itself: robots 1 and 2 see little else in common.
#[test]
#[ignore = "takes half a minute; the test above flies two of the seeds"]
fn harbor_robots_meet_in_their_places_for_every_seed() {
    let reports = (0..10).map(|seed| (seed, by_default(&simulated(Scenario::Harbor, seed))));
    let wrong: Vec<String> = reports
        .map(|(seed, report)| {
            (report.merged().count(), team_ate(&report), describe(&format!("harbor {seed}"), &report))
        })
        .inspect(|(_, _, told)| println!("{told}"))
        .filter(|(merged, ate, _)| *merged > 1 && *ate >= PLACE_BAR)
        .map(|(_, _, told)| told)
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Half a map that stays as it is fits a place of pilings wrongly, however much the other map grows meanwhile.
#[test]
fn harbor_robots_meet_in_their_places_after_an_outage_of_half_the_mission() {
    let data = simulated(Scenario::Harbor, 0);
    let mut params = MissionParams::default();
    params.modem.faults.outages = vec![Outage { robot: None, from_s: 200.0, to_s: 400.0 }];
    let report = run(&data, &params, |_| {}).expect("the mission runs");
    assert_honest("harbor 0, no link in the second half", &report);
    assert_eq!(report.merged().count(), 3, "{}", describe("harbor 0", &report));
}

#[test]
fn robots_at_different_sites_stay_apart() {
    let mut data = simulated(Scenario::Harbor, 0);
    let wreck = simulated(Scenario::Wreck, 0);
    data.recordings.truncate(1);
    data.recordings.extend(wreck.recordings.into_iter().filter(|recording| recording.robot == 2));
    let report = by_default(&data);
    println!("{}", describe("harbor 1 and wreck 2", &report));
    assert_eq!(report.robots.len(), 2);
    assert_eq!(report.merged().count(), 0);
    assert!(report.closures.iter().all(|closure| closure.decision != Decision::Accepted));
}

#[test]
fn every_consistency_test_and_every_optimisation_runs() {
    let data = short_mission_of_two(1);
    for (method, name) in Method::ALL {
        let report = fly(&data, method, Optimisation::default());
        assert_eq!(report.consistency, name);
        assert_honest(name, &report);
        let closures = report.summary().team.closures;
        assert_eq!(report.merged().count(), 2, "{name}");
        assert!(closures.accepted > 5, "{name}: {closures:?}");
        if method == Method::None {
            assert_eq!(closures.accepted, closures.proposed, "none believes everything");
        }
    }
    for (way, name) in Optimisation::ALL {
        let ate = team_ate(&fly(&data, Method::default(), way));
        println!("{name}: {ate:.4} m");
        assert!(ate < PLACE_BAR, "{name}: {ate} m");
    }
}

/// Robots 1 and 3 of the harbor for 36 keyframes.
fn short_mission_of_two(seed: u64) -> MissionData {
    let params =
        SimulationParams { scenario: Scenario::Harbor, keyframes: Some(36), seed, ..Default::default() };
    let mut data = simulate(&params).expect("defaults are valid");
    data.recordings.retain(|recording| recording.robot != 2);
    data
}

#[test]
fn two_steps_are_within_five_percent_of_full_optimisation() {
    let mean = |way: Optimisation| {
        let of = |seed: u64| team_ate(&fly(&short_mission_of_two(seed), Method::default(), way));
        let each = [1, 2, 3, 4].map(of);
        println!("{way}: {each:.4?}");
        each.iter().sum::<f64>() / each.len() as f64
    };
    let (full, two_step) = (mean(Optimisation::Full), mean(Optimisation::TwoStep));
    assert!(two_step <= 1.05 * full, "two-step: {two_step} m, full {full} m");
}

#[test]
fn the_real_mission_merges_all_robots_with_precise_closures() {
    let data = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let folder = data.join("sonar/aracati2017");
    if !folder.is_dir() {
        let required = std::env::var_os("DRACO_REQUIRE_DATA").is_some_and(|value| value == "1");
        assert!(!required, "no data at {}", folder.display());
        println!("skipped: no data at {}", folder.display());
        return;
    }
    let report = by_default(&read_keyframe_folder(&folder).expect("the recording is well formed"));
    println!("{}", describe("aracati2017", &report));
    assert_eq!(report.merged().count(), report.robots.len());
    assert!(team_ate(&report) < REAL_BAR, "{} m", team_ate(&report));
    let team = report.summary().team;
    assert!(team.precision.is_some_and(|precision| precision >= 0.95), "{:?}", team.precision);
    assert!(team.closures.accepted > 100, "{:?}", team.closures);
}

//! Missions over a link that is worse than it should be.

use draco::keyframe::MissionData;
use draco::link::{Faults, Outage};
use draco::mission::{MissionParams, run};
use draco::report::RunReport;
use draco::simulate::{SimulationParams, simulate};

/// Robots 1 and 3 of the harbor; their maps align at about 22 of these keyframes.
fn pair_of_robots() -> MissionData {
    let params = SimulationParams { keyframes: Some(32), seed: 1, ..SimulationParams::default() };
    let mut data = simulate(&params).expect("defaults are valid");
    data.recordings.retain(|recording| recording.robot != 2);
    data
}

fn over(faults: Faults) -> RunReport {
    let mut params = MissionParams::default();
    params.modem.faults = faults;
    let mut report = run(&pair_of_robots(), &params, |_| {}).expect("the mission runs");
    report.timing.clear();
    report
}

fn ate(report: &RunReport) -> f64 {
    report.team_error().map_or(f64::NAN, |error| error.rmse_m)
}

#[test]
fn repetition_and_disorder_change_nothing_at_all() {
    let clean = over(Faults::default());
    let disturbed = over(Faults { seed: 5, duplication: 0.4, reordering: 0.8, ..Faults::default() });
    assert_eq!(clean.merged().count(), 2);
    for (a, b) in clean.robots.iter().zip(&disturbed.robots) {
        assert_eq!(a.trajectory, b.trajectory);
        assert_eq!(a.matched, b.matched);
        assert!(b.refused["duplicate"] > 15, "{:?}", b.refused);
    }
    assert_eq!(clean.closures, disturbed.closures);
    assert_eq!(clean.graph_g2o, disturbed.graph_g2o);
    assert_eq!(clean.traffic, disturbed.traffic);
}

#[test]
fn losses_are_repaired() {
    let clean = over(Faults::default());
    for (seed, loss) in [(1, 0.3), (2, 0.6)] {
        let lossy = over(Faults { seed, loss, ..Faults::default() });
        let repeated: u64 = lossy.traffic.iter().filter(|t| t.kind == "repeat").map(|t| t.bits).sum();
        println!(
            "loss {loss}: {:.3} m, lossless {:.3} m, {repeated} bits repeated",
            ate(&lossy),
            ate(&clean)
        );
        assert_eq!(lossy.merged().count(), 2, "loss {loss}");
        assert!(ate(&lossy) <= 1.1 * ate(&clean) + 0.02, "{} m against {} m", ate(&lossy), ate(&clean));
        assert!(repeated > 0);
    }
}

#[test]
fn maps_merge_after_an_outage_of_half_the_mission() {
    let clean = over(Faults::default());
    let end = clean.robots[0].times.last().copied().expect("keyframes");
    let outage = Outage { robot: None, from_s: 0.5 * end, to_s: end };
    let cut_off = over(Faults { outages: vec![outage], ..Faults::default() });
    println!("outage: {:.3} m, without {:.3} m", ate(&cut_off), ate(&clean));
    assert_eq!(cut_off.merged().count(), 2);
    assert!(ate(&cut_off) <= 1.25 * ate(&clean) + 0.02, "{} m against {} m", ate(&cut_off), ate(&clean));
}

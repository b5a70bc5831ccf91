//! Robots and missions that are interrupted go on as if they had not been.

use draco::Error;
use draco::keyframe::MissionData;
use draco::link::Faults;
use draco::mission::{MissionParams, run, run_resumable};
use draco::report::RunReport;
use draco::robot::{Robot, RobotParams};
use draco::simulate::{SimulationParams, simulate};

fn pair_of_robots(keyframes: usize) -> MissionData {
    let params = SimulationParams { keyframes: Some(keyframes), seed: 1, ..SimulationParams::default() };
    let mut data = simulate(&params).expect("defaults are valid");
    data.recordings.retain(|recording| recording.robot != 2);
    data
}

fn lossy() -> MissionParams {
    let mut params = MissionParams::default();
    params.modem.faults = Faults { seed: 3, loss: 0.2, duplication: 0.1, reordering: 0.2, outages: vec![] };
    params
}

fn without_timing(mut report: RunReport) -> String {
    report.timing.clear();
    format!("{report:?}")
}

#[test]
fn an_interrupted_mission_ends_as_if_it_had_not_been() {
    let data = pair_of_robots(26);
    let folder = tempfile::tempdir().expect("temporary folder");
    let state = folder.path().join("mission.state");
    let mut steps = 0;
    let straight = without_timing(run(&data, &lossy(), |_| steps += 1).expect("the mission runs"));
    for stop_after in [1, 9, 25, steps - 1] {
        // an interrupted process leaves its state file; a panic in the progress is one way to end
        let mut done = 0;
        let interrupted = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            run_resumable(&data, &lossy(), &state, |_| {
                done += 1;
                assert!(done < stop_after, "interrupted");
            })
        }));
        assert!(interrupted.is_err() && state.exists(), "after {stop_after}");
        let mut rest = 0;
        let resumed = run_resumable(&data, &lossy(), &state, |_| rest += 1).expect("the mission goes on");
        assert_eq!(rest, steps - stop_after, "steps that were complete are not repeated");
        assert!(without_timing(resumed) == straight, "another result after stopping at {stop_after}");
        assert!(!state.exists());
    }
}

#[test]
fn the_state_of_another_mission_or_a_torn_one_is_refused() {
    let data = pair_of_robots(4);
    let folder = tempfile::tempdir().expect("temporary folder");
    let state = folder.path().join("mission.state");
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        run_resumable(&data, &lossy(), &state, |_| panic!("interrupted"))
    }));
    assert!(stopped.is_err());
    let bytes = std::fs::read(&state).expect("a state file");
    let go_on = |params: &MissionParams| run_resumable(&data, params, &state, |_| {}).map(without_timing);
    assert!(matches!(go_on(&MissionParams::default()), Err(Error::State { .. })), "other settings");
    std::fs::write(&state, &bytes[..bytes.len() / 2]).expect("written");
    let torn = go_on(&lossy());
    assert!(matches!(&torn, Err(Error::State { reason }) if reason.contains("torn")), "{torn:?}");
    std::fs::write(&state, &bytes).expect("written");
    assert!(go_on(&lossy()).is_ok());
}

#[test]
fn a_restored_robot_does_what_the_saved_one_would_have_done() {
    let data = pair_of_robots(12);
    let mut robots: Vec<Robot> =
        data.recordings.iter().map(|r| Robot::new(r.robot, RobotParams::default())).collect();
    let mut inbox: Vec<Vec<u8>> = Vec::new();
    for index in 0..12 {
        let mut sent = Vec::new();
        for (robot, recording) in robots.iter_mut().zip(&data.recordings) {
            let bytes = robot.save().expect("saved");
            let mut twin = Robot::restore(&bytes, RobotParams::default()).expect("restored");
            for one in [&mut *robot, &mut twin] {
                one.add_keyframe(&recording.keyframes[index]).expect("a simulated keyframe");
                inbox.iter().for_each(|packet| one.receive(packet));
            }
            let packets = robot.step(6.0 * index as f64).expect("a step");
            assert_eq!(packets, twin.step(6.0 * index as f64).expect("a step"));
            assert_eq!(robot.save().expect("saved"), twin.save().expect("saved"));
            sent.extend(packets);
        }
        inbox = sent.into_iter().map(|packet| packet.bytes).collect();
    }
}

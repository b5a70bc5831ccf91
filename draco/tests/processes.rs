//! One process a robot: the same bits as all robots in one process.

use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use draco::dataset::{read_keyframe_folder, write_keyframe_folder};
use draco::keyframe::{MissionData, Recording, RobotId};
use draco::link::ChannelKind;
use draco::mission::{MissionParams, run};
use draco::robot::{Robot, RobotParams};
use draco::simulate::{Scenario, SimulationParams, simulate};

/// A mission over the wreck in which all three robots meet, as a folder.
fn mission(folder: &Path) -> (PathBuf, MissionData) {
    let params = SimulationParams { scenario: Scenario::Wreck, ..SimulationParams::default() };
    let data = folder.join("wreck");
    write_keyframe_folder(&simulate(&params).expect("defaults are valid"), &data).expect("written");
    let read = read_keyframe_folder(&data).expect("what was written is read");
    (data, read)
}

/// The same mission flown by hand: what one robot says in a step all others hear in the next, in order of robot; every
/// robot has its own clock. Shares nothing with the program but the robot itself.
fn by_hand(data: &MissionData) -> BTreeMap<RobotId, String> {
    let clock = |recording: &Recording, step: usize| {
        let times: Vec<f64> =
            recording.keyframes.iter().map(|k| k.time - recording.keyframes[0].time).collect();
        let last = times.len() - 1;
        times
            .get(step)
            .copied()
            .unwrap_or(times[last] + (step.saturating_sub(last)) as f64 * (times[last] / last as f64))
    };
    let mut robots: Vec<Robot> =
        data.recordings.iter().map(|r| Robot::new(r.robot, RobotParams::default())).collect();
    let mut said: Vec<Vec<Vec<u8>>> = vec![Vec::new(); robots.len()];
    let longest = data.recordings.iter().map(|r| r.keyframes.len()).max().expect("robots");
    for step in 0..longest + 200 {
        let mut news = Vec::new();
        for (at, (robot, recording)) in robots.iter_mut().zip(&data.recordings).enumerate() {
            for (other, packets) in said.iter().enumerate() {
                packets.iter().filter(|_| other != at).for_each(|packet| robot.receive(packet));
            }
            if let Some(keyframe) = recording.keyframes.get(step) {
                robot.add_keyframe(keyframe).expect("a good keyframe");
            }
            let sent = robot.step(clock(recording, step)).expect("a step");
            news.push(sent.into_iter().map(|packet| packet.bytes).collect::<Vec<_>>());
        }
        said = news;
        let all = || robots.iter().zip(&data.recordings);
        let settled = all().all(|(robot, recording)| robot.is_settled(clock(recording, step)));
        if step >= longest && settled && said.iter().all(Vec::is_empty) {
            break;
        }
    }
    let met = robots.iter().filter(|robot| robot.team().robots().count() > 1).count();
    assert!(met >= 2, "robots have to meet for this to tell anything");
    robots.iter().map(|robot| (robot.id(), robot.fingerprint())).collect()
}

fn fingerprint(summary: &Path, robot: RobotId) -> String {
    let text = std::fs::read_to_string(summary.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let print = &summary["settings"][format!("fingerprint of robot {robot}")];
    print.as_str().expect("a fingerprint").to_owned()
}

/// A team of processes on this machine.
struct Team {
    carrier: &'static str,
    data: PathBuf,
    folder: PathBuf,
    endpoints: BTreeMap<RobotId, String>,
}

impl Team {
    fn new(carrier: &'static str, data: &Path, folder: &Path, robots: &[RobotId]) -> Self {
        let port = |_| UdpSocket::bind("127.0.0.1:0").expect("a free port");
        let sockets: Vec<_> = robots.iter().map(port).collect();
        let scheme = if carrier == "zenoh" { "tcp/" } else { "" };
        let endpoint = |s: &UdpSocket| format!("{scheme}{}", s.local_addr().expect("bound"));
        Team {
            carrier,
            data: data.to_owned(),
            folder: folder.to_owned(),
            endpoints: robots.iter().copied().zip(sockets.iter().map(endpoint)).collect(),
        }
    }

    fn state(&self, id: RobotId) -> PathBuf {
        self.folder.join(format!("robot-{id}.state"))
    }

    fn start(&self, id: RobotId) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_draco"));
        command.args(["robot", "--id", &id.to_string(), "--link", self.carrier, "--data"]).arg(&self.data);
        command.args(["--listen", &self.endpoints[&id]]);
        for (other, endpoint) in &self.endpoints {
            // with zenoh one of two robots connects
            if *other != id && (self.carrier != "zenoh" || *other < id) {
                command.args(["--connect", endpoint]);
            }
        }
        command.args(["--wait", "120", "--patience", "120", "--state"]).arg(self.state(id));
        command.arg("--out").arg(self.folder.join(id.to_string())).stdout(Stdio::null());
        command.spawn().expect("the program starts")
    }

    fn finish(&self, children: BTreeMap<RobotId, Child>) -> BTreeMap<RobotId, String> {
        let mut prints = BTreeMap::new();
        for (id, mut child) in children {
            assert!(child.wait().expect("ended").success(), "robot {id}");
            assert!(!self.state(id).exists(), "the state file of robot {id} is removed at the end");
            prints.insert(id, fingerprint(&self.folder.join(id.to_string()), id));
        }
        prints
    }

    /// Waits until robot `id` has done a few steps.
    fn await_steps(&self, id: RobotId, child: &mut Child) {
        let (begun, mut seen) = (Instant::now(), std::collections::BTreeSet::<SystemTime>::new());
        while seen.len() < 6 {
            assert!(begun.elapsed() < Duration::from_secs(120) && child.try_wait().expect("alive").is_none());
            seen.extend(std::fs::metadata(self.state(id)).and_then(|m| m.modified()).ok());
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn processes_agree(carrier: &'static str) {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (path, data) = mission(folder.path());
    let expected = by_hand(&data);
    let params = MissionParams { channel: ChannelKind::Direct, ..MissionParams::default() };
    let report = run(&data, &params, |_| {}).expect("the mission runs");
    for (robot, print) in &expected {
        let name = format!("fingerprint of robot {robot}");
        assert!(report.settings.contains(&(name, print.clone())), "{:?}", report.settings);
    }
    let robots: Vec<RobotId> = expected.keys().copied().collect();
    let team = Team::new(carrier, &path, folder.path(), &robots);
    let children = robots.iter().map(|&id| (id, team.start(id))).collect();
    assert_eq!(team.finish(children), expected, "undisturbed");
    // one is killed on the way and started again
    let mut children: BTreeMap<_, _> = robots.iter().map(|&id| (id, team.start(id))).collect();
    let victim = children.get_mut(&robots[1]).expect("three robots");
    team.await_steps(robots[1], victim);
    victim.kill().expect("killed");
    victim.wait().expect("dead");
    children.insert(robots[1], team.start(robots[1]));
    assert_eq!(team.finish(children), expected, "with one robot killed and started again");
}

#[test]
fn a_robot_with_a_torn_state_file_begins_anew_and_flies_to_the_end() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (path, data) = mission(folder.path());
    let robots: Vec<RobotId> = data.recordings.iter().map(|r| r.robot).collect();
    let team = Team::new("udp", &path, folder.path(), &robots);
    let mut children: BTreeMap<_, _> = robots.iter().map(|&id| (id, team.start(id))).collect();
    let victim = children.get_mut(&robots[2]).expect("three robots");
    team.await_steps(robots[2], victim);
    victim.kill().expect("killed");
    victim.wait().expect("dead");
    let state = std::fs::read(team.state(robots[2])).expect("a state file");
    std::fs::write(team.state(robots[2]), &state[..state.len() / 2]).expect("torn");
    children.insert(robots[2], team.start(robots[2]));
    assert_eq!(team.finish(children).len(), 3);
}

#[test]
fn three_processes_over_udp_end_with_the_bits_of_one() {
    processes_agree("udp");
}

#[cfg(feature = "zenoh")]
#[test]
fn three_processes_over_zenoh_end_with_the_bits_of_one() {
    processes_agree("zenoh");
}

#[test]
fn a_robot_alone_says_so_and_goes_on() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (path, data) = mission(folder.path());
    let out = folder.path().join("out");
    let alone = Command::new(env!("CARGO_BIN_EXE_draco"))
        .args([
            "robot",
            "--id",
            "2",
            "--listen",
            "127.0.0.1:0",
            "--wait",
            "0.3",
            "--patience",
            "0.3",
            "--data",
        ])
        .arg(&path)
        .arg("--out")
        .arg(&out)
        .output()
        .expect("the program starts");
    let told = String::from_utf8_lossy(&alone.stderr);
    assert!(alone.status.success(), "{told}");
    assert!(told.contains("robot 1 is not there") && told.contains("robot 3 is not there"), "{told}");
    let mut robot = Robot::new(2, RobotParams::default());
    let own = data.recordings.iter().find(|r| r.robot == 2).expect("robot 2");
    own.keyframes.iter().for_each(|keyframe| robot.add_keyframe(keyframe).expect("a good keyframe"));
    robot.step(0.0).expect("a step");
    assert_eq!(fingerprint(&out, 2), robot.fingerprint());
}

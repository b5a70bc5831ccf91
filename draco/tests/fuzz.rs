//! Mutated frames and mutated data sets: no panic, no wrong state, no memory without bound.
//!
//! The usual run is a short one; `cargo test --release -p draco-slam --test fuzz -- --ignored` is a million frames and ten
//! thousand data sets.

use draco::dataset::{read_keyframe_tables, write_keyframe_tables};
use draco::keyframe::MissionData;
use draco::robot::{Robot, RobotParams};
use draco::simulate::{Scenario, SimulationParams, simulate};
use draco::transport::{Packet, PacketKind, TAG_BYTES, TeamKey};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Frames a robot hears before a fresh one takes its place.
const FRAMES_A_ROBOT: u64 = 2000;
/// Frames between two steps of a robot.
const FRAMES_A_STEP: u64 = 100;

/// Two robots that have exchanged their first maps and are about to ask for scans, and all that both said.
fn team() -> (MissionData, Vec<Robot>, Vec<Vec<u8>>) {
    let params = SimulationParams {
        scenario: Scenario::Wreck,
        keyframes: Some(12),
        robots: 2,
        seed: 5,
        ..SimulationParams::default()
    };
    let data = simulate(&params).expect("defaults are valid");
    let mut params = RobotParams::default();
    params.exchange.map_interval = 2;
    let mut robots: Vec<Robot> =
        data.recordings.iter().map(|r| Robot::new(r.robot, params.clone())).collect();
    let (mut said, mut inbox) = (Vec::new(), Vec::<Vec<u8>>::new());
    for index in 0..14 {
        let mut sent = Vec::new();
        for (robot, recording) in robots.iter_mut().zip(&data.recordings) {
            recording
                .keyframes
                .get(index)
                .map_or(Ok(()), |k| robot.add_keyframe(k))
                .expect("a good keyframe");
            inbox.iter().for_each(|packet| robot.receive(packet));
            sent.extend(robot.step(30.0 * index as f64).expect("a step").into_iter().map(|p| p.bytes));
        }
        said.extend(sent.iter().cloned());
        inbox = sent;
    }
    (data, robots, said)
}

/// Changes, cuts or lengthens `bytes`.
fn mutate(bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    for _ in 0..rng.random_range(1..5) {
        let at = rng.random_range(0..=bytes.len());
        match rng.random_range(0..6) {
            0 => bytes.truncate(at),
            1 => bytes.insert(at, rng.random()),
            2 if at < bytes.len() => {
                bytes.remove(at);
            }
            // the encodings of the largest numbers
            3 => drop(bytes.splice(at..bytes.len().min(at + 5), [255, 255, 255, 255, 15])),
            _ if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            _ => {}
        }
    }
}

fn is_finite(robot: &Robot) -> bool {
    let team = robot.team();
    let mut poses = team.robots().filter_map(|r| team.trajectory(r)).flatten().chain(robot.local_poses());
    poses.all(|p| (p.translation.x + p.translation.y + p.rotation.angle()).is_finite())
}

/// Frames of somebody without the key: however they are mutated, the robot stays what it was but for its counts.
fn outsiders(frames: u64, seed: u64) {
    let (_, robots, said) = team();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut robot = robots[0].clone();
    let clean = robot.clone().step(1000.0).expect("a step");
    let refused = |robot: &Robot| robot.refusals().iter().map(|(_, count)| count).sum::<u64>();
    let before = refused(&robot);
    for _ in 0..frames {
        let good = &said[rng.random_range(0..said.len())];
        let mut bytes = good.clone();
        while bytes == *good {
            mutate(&mut bytes, &mut rng);
        }
        robot.receive(&bytes);
    }
    assert_eq!(refused(&robot) - before, frames, "every frame is refused and counted");
    let (mut a, b) = (robots[0].clone(), &mut robot);
    assert_eq!(a.fingerprint(), b.fingerprint());
    assert_eq!(a.known_versions(), b.known_versions());
    assert_eq!(b.step(1000.0).expect("a step"), clean, "the robot goes on as if nothing had been");
    assert_eq!(a.step(1000.0).expect("a step"), clean);
    assert_eq!(a.fingerprint(), b.fingerprint());
    assert!(robot.save().expect("saved").len() < robots[0].save().expect("saved").len() + 4096);
}

/// Mutated contents under the right key, as from a damaged or a hostile robot of the team itself: no panic, no failure of
/// the robot, finite estimates, and no more memory than was sent.
fn insiders(frames: u64, seed: u64) {
    let (_, robots, said) = team();
    let key = TeamKey::default();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let packets: Vec<Packet> = said.iter().filter_map(|bytes| Packet::decode(bytes, &key).ok()).collect();
    let local = robots[0].local_poses().to_vec();
    let size = robots[0].save().expect("saved").len();
    let mut robot = robots[0].clone();
    let (mut heard, mut numbers, mut worst) = (0, [0_u32; 3], 0.0_f64);
    for frame in 0..frames {
        let mut packet = packets[rng.random_range(0..packets.len())].clone();
        mutate(&mut packet.payload, &mut rng);
        // as the next packet of a stranger's stream, so that the contents are looked at; one in four is not the next
        let stranger = rng.random_range(0..numbers.len());
        (packet.sender, packet.epoch, packet.number) = (90 + stranger as u32, 0, numbers[stranger]);
        match rng.random_range(0..8) {
            0 => packet.number = rng.random(),
            1 => packet.kind = PacketKind::Part,
            2 => packet.kind = PacketKind::Status,
            _ => packet.kind = PacketKind::LastPart,
        }
        if packet.kind != PacketKind::Status && packet.number == numbers[stranger] {
            numbers[stranger] += 1;
        }
        let bytes = packet.encode(&key).expect("a packet that can be sent");
        heard += bytes.len() + TAG_BYTES;
        robot.receive(&bytes);
        if (frame + 1) % FRAMES_A_STEP == 0 {
            robot.step(1000.0 + frame as f64).expect("mutated messages never fail a robot");
        }
        if (frame + 1) % FRAMES_A_ROBOT == 0 || frame + 1 == frames {
            assert!(is_finite(&robot) && robot.local_poses() == local, "frame {frame}");
            let grown = robot.save().expect("saved").len().saturating_sub(size);
            worst = worst.max(grown as f64 / heard as f64);
            assert!(grown < 16 * heard + (1 << 16), "{grown} bytes of state for {heard} heard");
            (robot, heard, numbers) = (robots[0].clone(), 0, [0; 3]);
        }
    }
    println!("{frames} frames, at most {worst:.2} bytes of state for a byte heard");
}

/// Tables with mutated bytes: an error that says where, or data that hold what data have to hold.
fn data_sets(count: u64, seed: u64) {
    let (data, ..) = team();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut keyframes, mut points) = (Vec::new(), Vec::new());
    write_keyframe_tables(&data, &mut keyframes, &mut points).expect("written to memory");
    let mut taken = 0;
    for _ in 0..count {
        let (mut keyframes, mut points) = (keyframes.clone(), points.clone());
        let table = if rng.random_bool(0.7) { &mut keyframes } else { &mut points };
        mutate(table, &mut rng);
        match read_keyframe_tables(keyframes.as_slice(), points.as_slice()) {
            Err(error) => {
                let text = error.to_string();
                assert!(text.lines().count() == 1 && text.contains(".csv:"), "{text:?}");
            }
            Ok(read) => {
                taken += 1;
                assert!(!read.recordings.is_empty());
                for recording in &read.recordings {
                    assert!(!recording.keyframes.is_empty());
                    assert!(recording.truth.len() == recording.keyframes.len());
                    for (keyframe, index) in recording.keyframes.iter().zip(0..) {
                        assert_eq!(keyframe.index, index);
                        let (p, t) = (keyframe.odometry.translation.vector, keyframe.time);
                        assert!(p.x.is_finite() && p.y.is_finite() && t.is_finite());
                        assert!(keyframe.points.iter().all(|p| p.x.is_finite() && p.y.is_finite()));
                    }
                }
            }
        }
    }
    println!("{count} data sets, {taken} of them taken");
    assert!(taken > 0 && taken < count);
}

#[test]
fn frames_without_the_key_change_nothing() {
    outsiders(20_000, 1);
}

#[test]
fn mutated_messages_with_the_key_do_no_harm() {
    insiders(10_000, 2);
}

#[test]
fn mutated_data_sets_are_refused_by_line_or_taken_whole() {
    data_sets(200, 3);
}

#[test]
#[ignore = "minutes: run on a release build"]
fn a_million_frames() {
    outsiders(500_000, 11);
    insiders(500_000, 12);
}

#[test]
#[ignore = "minutes: run on a release build"]
fn ten_thousand_data_sets() {
    data_sets(10_000, 13);
}

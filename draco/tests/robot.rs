//! One robot among others: what may reach its estimate, and what may not.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

use draco::evaluate::Decision;
use draco::keyframe::{MissionData, Recording, RobotId};
use draco::link::{Modem, ModemParams, Outgoing};
use draco::message::{BROADCAST, Frame, GraphUpdate, KeyframeId, Message, VERSION};
use draco::mission::{MissionParams, run};
use draco::robot::{Robot, RobotParams};
use draco::simulate::{SimulationParams, simulate};
use nalgebra::Point2;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Keyframes of the short missions here: the maps of the two robots below align at about 22.
const KEYFRAMES: usize = 32;

/// Robots 1 and 3 of the harbor.
fn pair_of_robots() -> MissionData {
    let params = SimulationParams { keyframes: Some(KEYFRAMES), seed: 1, ..SimulationParams::default() };
    let mut data = simulate(&params).expect("defaults are valid");
    data.recordings.retain(|recording| recording.robot != 2);
    data
}

/// What a robot sent at each step, and the robot at the end.
struct Flight {
    sent: Vec<Vec<Vec<Outgoing>>>,
    robots: Vec<Robot>,
}

/// Lets robots talk without a modem: what one sends in a step all others hear before the next. `meddle` may change
/// what a robot, given by its number, is about to hear.
fn fly(data: &MissionData, mut meddle: impl FnMut(RobotId, &mut Vec<Vec<u8>>)) -> Flight {
    let mut robots: Vec<_> =
        data.recordings.iter().map(|r| Robot::new(r.robot, RobotParams::default())).collect();
    let mut sent: Vec<Vec<Vec<Outgoing>>> = Vec::new();
    let keyframes = data.recordings.iter().map(|r| r.keyframes.len()).max().unwrap_or(0);
    for index in 0..keyframes + 8 {
        let mut outgoing = Vec::new();
        for (robot, recording) in robots.iter_mut().zip(&data.recordings) {
            if let Some(keyframe) = recording.keyframes.get(index) {
                robot.add_keyframe(keyframe).expect("a simulated keyframe");
            }
            let before = sent.last().into_iter().flatten().zip(&data.recordings);
            let others = before.filter(|(_, other)| other.robot != recording.robot);
            let mut inbox: Vec<Vec<u8>> = others
                .flat_map(|(frames, _)| frames)
                .filter(|frame| frame.receiver == BROADCAST || frame.receiver == recording.robot)
                .map(|frame| frame.bytes.clone())
                .collect();
            meddle(recording.robot, &mut inbox);
            for bytes in &inbox {
                robot.receive(bytes);
            }
            outgoing.push(robot.step(6.0 * index as f64).expect("a step without failure"));
        }
        sent.push(outgoing);
    }
    Flight { sent, robots }
}

/// The flight in which nobody meddles; both robots have met in it.
fn undisturbed() -> &'static Flight {
    static FLIGHT: OnceLock<Flight> = OnceLock::new();
    FLIGHT.get_or_init(|| {
        let flight = fly(&pair_of_robots(), |_, _| {});
        for robot in &flight.robots {
            assert_eq!(robot.team().robots().collect::<Vec<_>>(), [1, 3], "robot {}", robot.id());
            assert!(robot.closure_reports().len() > 5, "robot {}", robot.id());
            assert_eq!(robot.refused_frames(), 0);
        }
        flight
    })
}

fn assert_same(a: &Flight, b: &Flight) {
    for (step, (a, b)) in a.sent.iter().zip(&b.sent).enumerate() {
        assert!(a == b, "the robots send other frames from step {step} on");
    }
    for (a, b) in a.robots.iter().zip(&b.robots) {
        assert_eq!(a.local_poses(), b.local_poses());
        assert_eq!(a.team(), b.team());
        assert_eq!(a.closure_reports(), b.closure_reports());
        assert_eq!(a.alignment_reports(), b.alignment_reports());
    }
}

fn with_checksum(mut body: Vec<u8>) -> Vec<u8> {
    let sum = crc32fast::hash(&body).to_le_bytes();
    body.extend_from_slice(&sum);
    body
}

/// Frames made from a good one that `receiver` has to refuse.
fn hostile(good: &[u8], receiver: RobotId, rng: &mut impl Rng) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    for bits in [1, 1, 2, 3] {
        let mut flipped = good.to_vec();
        let places = rand::seq::index::sample(rng, 8 * good.len(), bits);
        places.into_iter().for_each(|bit| flipped[bit / 8] ^= 1 << (bit % 8));
        frames.push(flipped);
    }
    let mut foreign = good[..good.len() - 4].to_vec();
    foreign[0] = VERSION.wrapping_add(rng.random_range(1..=255));
    frames.push(with_checksum(foreign));
    frames.push(good[..rng.random_range(0..good.len())].to_vec());
    let body_cut = rng.random_range(1..good.len() - 4);
    frames.push(with_checksum(good[..body_cut].to_vec()));
    frames.push(with_checksum([&good[..good.len() - 4], &[0][..]].concat()));
    frames.push((0..rng.random_range(0..200)).map(|_| rng.random()).collect());
    let mut own = Frame::decode(good).expect("a good frame");
    own.sender = receiver;
    frames.push(own.encode().expect("it was encoded before"));
    frames
}

#[test]
fn frames_that_cannot_be_are_counted_and_change_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut injected: BTreeMap<RobotId, u64> = BTreeMap::new();
    let flight = fly(&pair_of_robots(), |receiver, inbox| {
        let mut mixed = Vec::new();
        for good in std::mem::take(inbox) {
            let bad = hostile(&good, receiver, &mut rng);
            *injected.entry(receiver).or_default() += bad.len() as u64;
            let at = rng.random_range(0..=bad.len());
            mixed.extend_from_slice(&bad[..at]);
            mixed.push(good);
            mixed.extend_from_slice(&bad[at..]);
        }
        *inbox = mixed;
    });
    for robot in &flight.robots {
        println!("robot {}: {} frames refused", robot.id(), robot.refused_frames());
        assert!(robot.refused_frames() > 500);
        assert_eq!(robot.refused_frames(), injected[&robot.id()], "robot {}", robot.id());
    }
    assert_same(&flight, undisturbed());
}

#[test]
fn the_order_of_frames_within_a_step_does_not_matter() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut moved = 0;
    let flight = fly(&pair_of_robots(), |_, inbox| {
        let before = inbox.clone();
        inbox.shuffle(&mut rng);
        moved += usize::from(*inbox != before);
    });
    assert!(moved > 20, "only {moved} inboxes were shuffled");
    assert_same(&flight, undisturbed());
}

/// The same frames as text: an oracle of the bits that depends neither on the modem's log nor on the report.
type Sent = BTreeMap<(RobotId, String), u64>;

fn elapsed(recording: &Recording, index: usize) -> f64 {
    let last = recording.keyframes.len() - 1;
    recording.keyframes[index.min(last)].time - recording.keyframes[0].time
}

#[test]
fn counted_bits_are_those_of_the_bytes_that_cross_the_link() {
    let data = pair_of_robots();
    let report = run(&data, &MissionParams::default(), |_| {}).expect("the mission runs");
    let ids = || data.recordings.iter().map(|r| r.robot);
    let mut robots: Vec<_> = ids().map(|id| Robot::new(id, RobotParams::default())).collect();
    let mut modem = Modem::new(&ModemParams::default(), ids());
    let duration = data.recordings.iter().map(|r| elapsed(r, KEYFRAMES)).fold(0.0, f64::max);
    let (mut now, mut crossed) = (0.0_f64, Sent::new());
    for index in 0..KEYFRAMES + 200 {
        now = if index < KEYFRAMES {
            data.recordings.iter().map(|r| elapsed(r, index)).fold(now, f64::max)
        } else {
            now + duration / KEYFRAMES as f64
        };
        let delivered = modem.receive(now);
        let mut silent = true;
        for (robot, recording) in robots.iter_mut().zip(&data.recordings) {
            let id = robot.id();
            if let Some(keyframe) = recording.keyframes.get(index) {
                robot.add_keyframe(keyframe).expect("a simulated keyframe");
            }
            for delivery in delivered.iter().filter(|delivery| delivery.receiver == id) {
                // with two robots every frame is heard exactly once
                let frame = Frame::decode(&delivery.bytes).expect("the link loses nothing");
                let bits = 8 * delivery.bytes.len() as u64;
                *crossed.entry((frame.sender, frame.message.kind().to_owned())).or_default() += bits;
                robot.receive(&delivery.bytes);
            }
            for frame in robot.step(now).expect("a step without failure") {
                silent = false;
                modem.send(now, robot.id(), frame);
            }
        }
        if index >= KEYFRAMES && silent && modem.waiting_bits() == 0 {
            break;
        }
    }
    let mut counted = Sent::new();
    for message in &report.traffic {
        *counted.entry((message.robot, message.kind.clone())).or_default() += message.bits;
    }
    println!("{counted:?}");
    assert_eq!(report.message_kinds().len(), 6, "every type of message was sent: {counted:?}");
    assert_eq!(counted, crossed);
    let summed: u64 = crossed.values().sum();
    assert_eq!(report.summary().team.sent_bits, summed);
}

#[test]
fn equal_missions_give_equal_results_to_the_bit() {
    let data = pair_of_robots();
    let once = || {
        let mut report = run(&data, &MissionParams::default(), |_| {}).expect("the mission runs");
        report.timing.clear();
        report
    };
    let (a, b) = (once(), once());
    assert_eq!(a.merged().count(), 2);
    assert_eq!(a.summary(), b.summary());
    for (a, b) in a.robots.iter().zip(&b.robots) {
        assert_eq!(a.trajectory, b.trajectory);
    }
    assert_eq!(a.graph_g2o, b.graph_g2o);
    assert!(
        format!("{a:?}") == format!("{b:?}"),
        "the reports differ in a field that the summary leaves out"
    );
}

#[test]
fn partners_hold_exactly_the_closures_that_a_robot_believes() {
    // With this seed robots 1 and 2 withdraw an alignment on which closures had been announced.
    let params = SimulationParams { seed: 2, ..SimulationParams::default() };
    let mut data = simulate(&params).expect("defaults are valid");
    data.recordings.retain(|recording| recording.robot != 3);
    let flight = fly(&data, |_, _| {});
    let (mut retractions, mut told) = (0, BTreeMap::<RobotId, BTreeSet<_>>::new());
    for sent in flight.sent.iter().flatten().flatten() {
        let frame = Frame::decode(&sent.bytes).expect("a robot sends good frames");
        if let Message::Closures { accepted, retracted } = frame.message {
            let held = told.entry(frame.sender).or_default();
            retractions += retracted.len();
            retracted.iter().for_each(|pair| assert!(held.remove(pair), "{pair:?} was never announced"));
            held.extend(accepted.iter().map(|entry| (entry.source, entry.target)));
        }
    }
    for robot in &flight.robots {
        let believed: BTreeSet<_> = robot
            .closure_reports()
            .iter()
            .filter(|closure| closure.decision == Decision::Accepted)
            .map(|closure| [closure.b, closure.a].map(|k| KeyframeId { robot: k.robot, index: k.index }))
            .map(|[source, target]| (source, target))
            .collect();
        let held = told.remove(&robot.id()).unwrap_or_default();
        println!("robot {}: {} closures believed, {} held by others", robot.id(), believed.len(), held.len());
        assert_eq!(held, believed, "robot {}", robot.id());
    }
    assert!(retractions > 0, "nothing was withdrawn, so nothing was tested");
}

#[test]
fn a_request_for_another_robot_or_a_keyframe_there_is_not_is_not_answered() {
    let data = pair_of_robots();
    let ask = |receiver, keyframes: Vec<u32>| {
        let mut robot = Robot::new(1, RobotParams::default());
        robot.add_keyframe(&data.recordings[0].keyframes[0]).expect("a simulated keyframe");
        let frame = Frame { sender: 3, receiver, sequence: 0, message: Message::ScanRequest(keyframes) };
        robot.receive(&frame.encode().expect("a valid frame"));
        let sent = robot.step(0.0).expect("a step without failure");
        sent.iter().filter(|frame| frame.kind == "scan").count()
    };
    assert_eq!(ask(1, vec![0]), 1);
    assert_eq!(ask(1, vec![1, 7, u32::MAX]), 0);
    assert_eq!(ask(2, vec![0]), 0);
}

#[test]
fn well_formed_nonsense_does_not_stop_a_robot() {
    // Right checksums, wrong contents: a stranger that claims closures, factors and scans of keyframes nobody has.
    let nowhere = KeyframeId { robot: 200, index: u32::MAX };
    let nonsense = [
        Message::Graph(GraphUpdate { keyframes: u32::MAX, factors: vec![], removed: vec![(u32::MAX, 0)] }),
        Message::Scan { keyframe: u32::MAX, points: vec![Point2::new(9e4, -9e4)] },
        Message::ScanRequest(vec![u32::MAX]),
        Message::Closures { accepted: vec![], retracted: vec![(nowhere, nowhere)] },
        Message::Objects(vec![]),
    ];
    let mut sequence = 0;
    let flight = fly(&pair_of_robots(), |_, inbox| {
        for message in &nonsense {
            sequence += 1;
            let frame = Frame { sender: 77, receiver: BROADCAST, sequence, message: message.clone() };
            inbox.push(frame.encode().expect("a valid frame"));
        }
    });
    for (robot, clean) in flight.robots.iter().zip(&undisturbed().robots) {
        assert_eq!(robot.local_poses(), clean.local_poses());
        assert_eq!(robot.team(), clean.team());
        assert_eq!(robot.closure_reports(), clean.closure_reports());
    }
}

use std::collections::BTreeMap;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::intruder::{hostile, mutate, read_mutated_data};
use super::plan::{Plan, Restart, StateFile};
use super::site::record;
use crate::evaluate::Decision;
use crate::keyframe::{Keyframe, MissionData};
use crate::link::{Modem, Outgoing};
use crate::robot::{Robot, RobotParams};
use crate::transport::{Packet, TeamKey};

/// Steps after the last keyframe at most.
const CLOSING_STEPS: usize = 120;
const STEP_S: f64 = 6.0;
/// A robot keeps what it recorded and what it heard and sent, each a few times over, and a little besides.
const MEMORY_FACTOR: usize = 6;
const MEMORY_BASE: usize = 1 << 17;

/// What a mission was like.
#[derive(Debug, Clone, Default)]
pub(super) struct Flight {
    /// Hash of everything that robots believe at the end and have said on the way.
    pub(super) digest: [u8; 32],
    pub(super) steps: u64,
    pub(super) delivered: u64,
    pub(super) hostile: u64,
    pub(super) mutated_messages: u64,
    pub(super) mutated_data: u64,
    pub(super) restarts: u64,
    pub(super) torn: u64,
    pub(super) merged: u64,
    pub(super) robots: u64,
    /// Closures believed at the end, by all robots.
    pub(super) accepted: u64,
    /// Steps of a robot in which it had met another.
    pub(super) together: u64,
}

/// One place in the team; the robot in it may be down.
struct Berth {
    robot: Option<Robot>,
    state: Vec<u8>,
    epoch: u32,
    back_at: usize,
    /// Keyframes that the present robot has been given.
    given: u32,
    /// What the present robot has heard. Only that can be played back to it without being of use: a packet it has not
    /// heard yet is welcome from anyone.
    heard: Vec<Vec<u8>>,
    /// Keyframes recorded that have not been given to a robot yet.
    recorded: Vec<Keyframe>,
}

struct Mission<'a> {
    plan: &'a Plan,
    berths: Vec<Berth>,
    modem: Modem,
    now: f64,
    /// Bits that robots have handed to the modem.
    handed_bits: u64,
    /// Everything said.
    said: Vec<Vec<u8>>,
    hasher: blake3::Hasher,
    versions: BTreeMap<(usize, u32), (u32, [u32; 3])>,
    rng: ChaCha8Rng,
    flight: Flight,
}

/// Flies the plan and checks what must hold. An error tells what did not.
pub(super) fn fly(plan: &Plan) -> Result<Flight, String> {
    let data = record(plan).map_err(|e| e.to_string())?;
    let ids = || data.recordings.iter().map(|r| r.robot);
    let params = &plan.robot;
    let berth = |id| Berth {
        robot: Some(Robot::new(id, params.clone())),
        state: Vec::new(),
        epoch: 0,
        back_at: 0,
        given: 0,
        heard: Vec::new(),
        recorded: Vec::new(),
    };
    let mut mission = Mission {
        plan,
        berths: ids().map(berth).collect(),
        modem: Modem::new(&plan.modem, ids(), params.transport.mtu).map_err(|e| e.to_string())?,
        now: 0.0,
        handed_bits: 0,
        said: Vec::new(),
        hasher: blake3::Hasher::new(),
        versions: BTreeMap::new(),
        // intruders draw from a stream of their own, so that their absence moves nothing
        rng: ChaCha8Rng::seed_from_u64(plan.seed ^ 0x5eed),
        flight: Flight::default(),
    };
    mission.flight.mutated_data += read_mutated_data(&data, &mut mission.rng).map_err(|e| e.to_string())?;
    let keyframes = data.recordings.iter().map(|r| r.keyframes.len()).max().unwrap_or(0);
    for step in 0..keyframes + CLOSING_STEPS {
        let silent = mission.step(&data, step).map_err(|reason| format!("step {step}: {reason}"))?;
        if silent && step >= keyframes {
            break;
        }
    }
    mission.land()
}

impl Mission<'_> {
    fn step(&mut self, data: &MissionData, step: usize) -> Result<bool, String> {
        let plan = self.plan;
        for restart in plan.restarts.iter().filter(|restart| restart.step == step) {
            self.kill(restart)?;
        }
        // one round in the middle only keeps the link going
        self.round(None, step)?;
        for (berth, recording) in self.berths.iter_mut().zip(&data.recordings) {
            berth.recorded.extend(recording.keyframes.get(step).cloned());
            if berth.robot.is_none() && step >= berth.back_at {
                berth.robot = Some(berth.revive(recording.robot, &plan.robot)?);
            }
        }
        let silent = self.round(Some(data), step)?;
        self.check(step)?;
        let now = self.now;
        let settled = self.berths.iter().all(|b| b.robot.as_ref().is_some_and(|r| r.is_settled(now)));
        Ok(silent && settled && self.modem.is_idle())
    }

    fn kill(&mut self, restart: &Restart) -> Result<(), String> {
        let berth = &mut self.berths[restart.robot];
        let Some(robot) = berth.robot.take() else { return Ok(()) };
        let mut bytes = robot.save().map_err(|e| e.to_string())?;
        let at = |share: f64| (share * (bytes.len() - 1) as f64) as usize;
        match restart.file {
            StateFile::Whole => self.flight.restarts += 1,
            StateFile::Cut(share) => bytes.truncate(at(share)),
            StateFile::Flipped(share) => {
                let place = at(share);
                bytes[place] ^= 0x10;
            }
        }
        self.flight.torn += u64::from(restart.file != StateFile::Whole);
        let restored = Robot::restore(&bytes, self.plan.robot.clone());
        if restored.is_ok() != (restart.file == StateFile::Whole) {
            return Err(format!("a state file {:?} was {:?}", restart.file, restored.map(|r| r.id())));
        }
        berth.state = bytes;
        berth.back_at = restart.step + restart.down;
        Ok(())
    }

    /// Delivers what has arrived and lets every robot act: think if there are data, else only keep the link going.
    fn round(&mut self, data: Option<&MissionData>, step: usize) -> Result<bool, String> {
        let half = if data.is_some() { 1.0 } else { 0.5 };
        self.now = STEP_S * (step as f64 + half);
        let mut inbox: BTreeMap<u32, Vec<Vec<u8>>> = BTreeMap::new();
        for delivery in self.modem.receive(self.now) {
            self.flight.delivered += 1;
            inbox.entry(delivery.receiver).or_default().push(delivery.bytes);
        }
        let mut silent = true;
        for at in 0..self.berths.len() {
            let (offset, fast) = self.plan.clocks[at];
            let clock = (self.now + offset) * (1.0 + fast);
            let berth = &mut self.berths[at];
            let Some(robot) = berth.robot.as_mut() else { continue };
            let mut packets = inbox.remove(&robot.id()).unwrap_or_default();
            let news = packets.clone();
            if self.plan.intruder {
                let forged = hostile(&berth.heard, &mut self.rng);
                self.flight.hostile += forged.len() as u64;
                for bytes in forged {
                    let place = self.rng.random_range(0..=packets.len());
                    packets.insert(place, bytes);
                }
            }
            packets.iter().for_each(|bytes| robot.receive(bytes));
            berth.heard.extend(news);
            let sent = match data {
                Some(_) => {
                    let berth = &mut self.berths[at];
                    berth.take_keyframes()?;
                    let Some(robot) = berth.robot.as_mut() else { continue };
                    self.flight.steps += 1;
                    robot.step(clock)
                }
                None => robot.tick(clock),
            };
            let id = self.berths[at].robot.as_ref().map_or(0, Robot::id);
            for packet in sent.map_err(|e| format!("robot {id}: {e}"))? {
                silent = false;
                self.send(id, packet)?;
            }
        }
        Ok(silent)
    }

    fn send(&mut self, id: u32, packet: Outgoing) -> Result<(), String> {
        self.handed_bits += 8 * packet.bytes.len() as u64;
        self.hasher.update(&packet.bytes);
        self.said.push(packet.bytes.clone());
        self.modem.send(self.now, id, packet).map_err(|e| e.to_string())
    }

    /// What must hold after every step.
    fn check(&mut self, step: usize) -> Result<(), String> {
        let logged: u64 = self.modem.log().iter().map(|t| t.bits).sum();
        let accounted = logged + self.modem.waiting_bits() + self.modem.replaced_bits();
        if accounted != self.handed_bits {
            return Err(format!("{} bits were handed over, {accounted} are accounted for", self.handed_bits));
        }
        for (at, robot) in self.berths.iter().enumerate().filter_map(|(at, b)| Some((at, b.robot.as_ref()?)))
        {
            let team = robot.team();
            self.flight.together += u64::from(team.robots().count() > 1);
            let poses = team.robots().filter_map(|r| team.trajectory(r)).flatten().chain(robot.local_poses());
            if poses
                .into_iter()
                .any(|p| !(p.translation.x + p.translation.y + p.rotation.angle()).is_finite())
            {
                return Err(format!("robot {} has an estimate that is not finite", robot.id()));
            }
            for known in robot.known_versions() {
                let key = (at, known.robot);
                let new = [known.cells, known.objects, known.packets];
                let old = self.versions.insert(key, (known.epoch, new));
                let went_back = |(epoch, old): (u32, [u32; 3])| {
                    known.epoch < epoch || (known.epoch == epoch && new.iter().zip(old).any(|(n, o)| *n < o))
                };
                // a robot that has lost its state knows less than before, but no partner does
                if old.is_some_and(went_back) && self.berths[at].epoch == 0 {
                    return Err(format!(
                        "robot {} knows an older version of robot {}",
                        robot.id(),
                        known.robot
                    ));
                }
            }
        }
        if step.is_multiple_of(7) { self.mutate_messages() } else { Ok(()) }
    }

    /// Messages with flipped bits under the right key, to copies of the robots: they may not fail.
    fn mutate_messages(&mut self) -> Result<(), String> {
        let key = TeamKey::default();
        let rng = &mut ChaCha8Rng::seed_from_u64(self.plan.seed ^ self.said.len() as u64);
        for robot in self.berths.iter().filter_map(|b| b.robot.as_ref()) {
            let mut copy = robot.clone();
            for (number, said) in (0..).zip(pick(&self.said, rng)) {
                let Ok(mut packet) = Packet::decode(said, &key) else { continue };
                // as a stream of somebody else, from its beginning, so that it is looked at
                (packet.sender, packet.epoch, packet.number) = (99, 0, number);
                mutate(&mut packet.payload, rng);
                copy.receive(&packet.encode(&key).map_err(|e| e.to_string())?);
                self.flight.mutated_messages += 1;
            }
            copy.step(self.now)
                .map_err(|e| format!("robot {} fails on mutated messages: {e}", robot.id()))?;
        }
        Ok(())
    }

    /// What must hold at the end, and the digest.
    fn land(mut self) -> Result<Flight, String> {
        let said: usize = self.said.iter().map(Vec::len).sum();
        for berth in &self.berths {
            let Some(robot) = &berth.robot else { continue };
            let size = robot.save().map_err(|e| e.to_string())?.len();
            let recorded: usize = 16 * robot.point_count();
            let most = MEMORY_BASE + MEMORY_FACTOR * (said + recorded);
            if size > most {
                return Err(format!("the state of robot {} has {size} bytes, more than {most}", robot.id()));
            }
            let team = robot.team();
            for pose in team.robots().filter_map(|r| team.trajectory(r)).flatten() {
                for value in [pose.translation.x, pose.translation.y, pose.rotation.angle()] {
                    self.hasher.update(&value.to_le_bytes());
                }
            }
            self.flight.robots += 1;
            self.flight.merged += u64::from(team.robots().count() > 1);
            let closures = robot.closure_reports();
            let accepted = closures.iter().filter(|closure| closure.decision == Decision::Accepted);
            self.flight.accepted += accepted.count() as u64;
        }
        self.agree()?;
        self.flight.digest = *self.hasher.finalize().as_bytes();
        Ok(self.flight)
    }

    /// Where two robots both have met and know the same, they place each other alike.
    fn agree(&self) -> Result<(), String> {
        let robots: Vec<&Robot> = self.berths.iter().filter_map(|b| b.robot.as_ref()).collect();
        let all_settled = self.modem.is_idle() && robots.iter().all(|robot| robot.is_settled(self.now));
        for a in robots.iter().filter(|_| all_settled) {
            for b in robots.iter().filter(|b| b.id() > a.id()) {
                let place = |of: &Robot, other: &Robot| {
                    let seen = of.team().trajectory(other.id())?;
                    Some(
                        other
                            .team()
                            .trajectory(other.id())?
                            .last()?
                            .inv_mul(seen.get(other.local_poses().len() - 1)?),
                    )
                };
                let (Some(_), Some(_)) = (place(a, b), place(b, a)) else { continue };
                let (Some(ab), Some(ba)) = (a.places(b.id()), b.places(a.id())) else { continue };
                let middle = b.local_poses()[b.local_poses().len() / 2] * nalgebra::Point2::origin();
                let gap = (ba * ab * middle - middle).norm();
                if gap > self.plan.robot.alignment.same_distance {
                    return Err(format!(
                        "robots {} and {} place each other {gap:.1} m apart",
                        a.id(),
                        b.id()
                    ));
                }
            }
        }
        Ok(())
    }
}

impl Berth {
    /// The robot as its state file has it, or a new one that has lost everything.
    fn revive(&mut self, id: u32, params: &RobotParams) -> Result<Robot, String> {
        match Robot::restore(&self.state, params.clone()) {
            Ok(robot) => Ok(robot),
            Err(_) => {
                self.epoch += 1;
                self.given = 0;
                self.heard.clear();
                Ok(Robot::in_epoch(id, self.epoch, params.clone()))
            }
        }
    }

    /// Gives the robot what was recorded since it last took something.
    fn take_keyframes(&mut self) -> Result<(), String> {
        let Some(robot) = &mut self.robot else { return Ok(()) };
        for mut keyframe in self.recorded.drain(..) {
            keyframe.index = self.given;
            self.given += 1;
            robot.add_keyframe(&keyframe).map_err(|e| format!("robot {}: {e}", robot.id()))?;
        }
        Ok(())
    }
}

fn pick<'a>(all: &'a [Vec<u8>], rng: &mut impl Rng) -> Vec<&'a Vec<u8>> {
    let count = all.len().min(40);
    (0..count).map(|_| &all[rng.random_range(0..all.len())]).collect()
}

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::lock_step::{LockStep, Patience, Recent, with_step};
use super::{Network, Stage};
use crate::error::Error;
use crate::keyframe::{MissionData, Recording, RobotId};
use crate::link::Transmission;
use crate::mission::{Progress, robot_report};
use crate::pilot::Pilot;
use crate::report::{RobotReport, RunReport, Traffic};
use crate::robot::{Robot, RobotParams};
use crate::state;
use crate::unit::unit_of;

/// How one robot of a team in several processes is flown.
#[derive(Debug, Clone)]
pub struct FlightParams {
    /// Seed that the data were made with; told in the report.
    pub seed: u64,
    /// The robot's settings; the same for the whole team.
    pub robot: RobotParams,
    /// Numbers of all robots of the team.
    pub team: Vec<RobotId>,
    /// How long it waits for the others.
    pub patience: Patience,
    /// Steps after everybody's last keyframe at most. Default 200, as in [`MissionParams`](crate::mission::MissionParams).
    pub closing_steps: u64,
    /// File for the robot's state after every step. If it is there, the robot goes on from it, and begins a new epoch if it
    /// is torn. Removed at the end.
    pub state: Option<PathBuf>,
}

impl Default for FlightParams {
    fn default() -> Self {
        FlightParams {
            seed: 0,
            robot: RobotParams::default(),
            team: Vec::new(),
            patience: Patience::default(),
            closing_steps: 200,
            state: None,
        }
    }
}

/// How long a robot that is done repeats its last steps for those who have not heard them.
const LINGER: Duration = Duration::from_millis(500);

/// What a robot's process needs to go on.
#[derive(Debug, Serialize, Deserialize)]
struct Saved {
    robot: Vec<u8>,
    steps: u64,
    still: u64,
    stage: Stage,
    recent: Recent,
    log: Vec<Transmission>,
}

/// Flies robot `id` of `data` with its team over `network`, and reports what it knows at the end. Nothing of `data` but
/// the recording of this robot is looked at.
///
/// * `progress` – called after every step.
///
/// # Errors
/// [`Error::UnknownRobot`] and [`Error::EmptyRobot`] for data without recordings of the robot; [`Error::Parameter`] for data
/// that need a unit of length of their own, on which several processes could not agree; those of the network and of the
/// robot's own stages; [`Error::Io`] and [`Error::State`] for the state file.
pub fn fly(
    data: &MissionData,
    id: RobotId,
    network: impl Network,
    params: &FlightParams,
    mut progress: impl FnMut(Progress),
) -> Result<RunReport, Error> {
    let recording =
        data.recordings.iter().find(|r| r.robot == id).ok_or(Error::UnknownRobot { robot: id })?;
    if recording.keyframes.is_empty() {
        return Err(Error::EmptyRobot { robot: id });
    }
    let own = MissionData { recordings: vec![recording.clone()], ..data.clone() };
    let unit = unit_of(&own);
    if unit != 1.0 {
        let reason = "is needed by these data, and robots in processes of their own could not agree on one";
        return Err(Error::Parameter { name: "a unit of length", value: unit, reason });
    }
    let start = Instant::now();
    let mut flight = Flight::begin(recording, params)?;
    let key = params.robot.transport.key;
    let mut lock = LockStep::new(network, id, params.team.iter().copied(), key, params.patience);
    lock.start(flight.pilot.steps, std::mem::take(&mut flight.recent))?;
    while flight.step(&mut lock, params)? {
        let others = flight.pilot.robot.team().robots().count() - 1;
        progress(Progress { done: flight.pilot.steps, message: format!("sees {others} other robots") });
    }
    lock.linger(LINGER)?;
    let mut report = flight.report(&own, params)?;
    report.timing.insert("mission_s".into(), start.elapsed().as_secs_f64());
    let absent: Vec<_> = lock.absent().map(|robot| robot.to_string()).collect();
    if !absent.is_empty() {
        report.settings.push(("out of step".into(), absent.join(", ")));
    }
    if let Some(path) = params.state.as_deref().filter(|path| path.exists()) {
        std::fs::remove_file(path).map_err(|source| Error::io(path, source))?;
    }
    Ok(report)
}

struct Flight<'a> {
    pilot: Pilot<'a>,
    /// Steps since anybody last had a keyframe.
    still: u64,
    /// How far the robot was after its last step.
    stage: Stage,
    log: Vec<Transmission>,
    /// Envelopes of the steps before this process began.
    recent: Recent,
}

impl<'a> Flight<'a> {
    fn begin(recording: &'a Recording, params: &FlightParams) -> Result<Self, Error> {
        let mut flight = Flight {
            pilot: Pilot::new(recording, params.robot.clone()),
            still: 0,
            stage: Stage::Recording,
            log: Vec::new(),
            recent: Recent::new(),
        };
        if let Some(path) = params.state.as_deref().filter(|path| path.exists()) {
            flight.resume(recording, params, path)?;
        }
        Ok(flight)
    }

    fn resume(&mut self, recording: &'a Recording, params: &FlightParams, path: &Path) -> Result<(), Error> {
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        let saved = state::from_bytes::<Saved>(&bytes)
            .and_then(|saved| Ok((Robot::restore(&saved.robot, params.robot.clone())?, saved)));
        match saved {
            Ok((robot, _)) if robot.id() != recording.robot => {
                let reason = format!("{} is the state of robot {}", path.display(), robot.id());
                return Err(Error::State { reason });
            }
            Ok((robot, saved)) => {
                self.pilot = Pilot::resume(recording, robot, saved.steps);
                (self.still, self.stage) = (saved.still, saved.stage);
                (self.recent, self.log) = (saved.recent, saved.log);
            }
            Err(error) => {
                tracing::warn!(%error, "the robot begins anew, in a new epoch");
                // later than any epoch that began by counting from 0
                let epoch = std::time::UNIX_EPOCH.elapsed().map_or(1, |since| since.as_secs() as u32);
                let robot = Robot::in_epoch(recording.robot, epoch, params.robot.clone());
                self.pilot = Pilot::resume(recording, robot, 0);
            }
        }
        Ok(())
    }

    /// One step; returns whether there is another.
    fn step(&mut self, lock: &mut LockStep<impl Network>, params: &FlightParams) -> Result<bool, Error> {
        let mut frames = Vec::new();
        if let Some(last) = self.pilot.steps.checked_sub(1) {
            let heard = lock.gather(last)?;
            let stages = || heard.stages.values().copied().chain([self.stage]);
            if stages().all(|stage| stage == Stage::Done) {
                return Ok(false);
            }
            self.still = if stages().any(|stage| stage == Stage::Recording) { 0 } else { self.still + 1 };
            if self.still >= params.closing_steps {
                tracing::warn!(
                    steps = self.still,
                    "the mission ended while robots still had messages to send"
                );
                return Ok(false);
            }
            frames = heard.frames;
        }
        let step = self.pilot.steps;
        let sent = self.pilot.step(&frames)?;
        self.stage = match (self.pilot.is_recording(), sent.is_empty() && self.pilot.is_settled()) {
            (true, _) => Stage::Recording,
            (false, true) => Stage::Done,
            (false, false) => Stage::Closing,
        };
        let (time, sender) = (self.pilot.now(), self.pilot.robot.id());
        let mut packets = Vec::new();
        for packet in sent {
            let bits = 8 * packet.bytes.len() as u64;
            self.log.push(Transmission { time, sender, kind: packet.kind, bits });
            packets.push(packet.bytes);
        }
        let envelopes = lock.seal(step, &packets, self.stage)?;
        if let Some(path) = &params.state {
            // before anybody hears of the step, so that a robot never forgets what it has said
            self.save(path, with_step(lock.recent(), step, envelopes.clone()))?;
        }
        lock.publish(step, envelopes)?;
        Ok(true)
    }

    fn save(&self, path: &Path, recent: Recent) -> Result<(), Error> {
        let saved = Saved {
            robot: self.pilot.robot.save()?,
            steps: self.pilot.steps,
            still: self.still,
            stage: self.stage,
            recent,
            log: self.log.clone(),
        };
        state::write_whole(path, &state::to_bytes(&saved)?)
    }

    /// What this robot knows: itself, and the others as it sees them.
    fn report(&self, own: &MissionData, params: &FlightParams) -> Result<RunReport, Error> {
        let robot = &self.pilot.robot;
        let mut report = RunReport {
            scenario: own.name.clone(),
            seed: params.seed,
            consistency: params.robot.method.to_string(),
            truth_has_heading: own.truth_has_heading,
            closures: robot.closure_reports(),
            graph_g2o: robot.team_graph_g2o()?,
            ..Default::default()
        };
        let has_met = robot.team().robots().count() > 1;
        report.robots.push(robot_report(robot, &own.recordings[0], Some(robot).filter(|_| has_met))?);
        for other in robot.team().robots().filter(|other| *other != robot.id()) {
            let trajectory = robot.team().trajectory(other).unwrap_or_default().to_vec();
            // when the partner was where is not told on the link
            let times = (0..trajectory.len()).map(|index| index as f64).collect();
            report.robots.push(RobotReport {
                id: other,
                merged: true,
                times,
                truth: vec![None; trajectory.len()],
                trajectory,
                ..Default::default()
            });
        }
        report.robots.sort_by_key(|robot| robot.id);
        report.closures.sort_by(|a, b| a.time.total_cmp(&b.time));
        let traffic = |t: &Transmission| Traffic {
            time: t.time,
            robot: t.sender,
            kind: t.kind.to_string(),
            bits: t.bits,
        };
        report.traffic = self.log.iter().map(traffic).collect();
        report.settings.push(("seen by robot".into(), robot.id().to_string()));
        report.settings.push(("optimisation".into(), params.robot.optimisation.to_string()));
        report.settings.push((format!("fingerprint of robot {}", robot.id()), robot.fingerprint()));
        Ok(report)
    }
}

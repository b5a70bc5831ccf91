//! Many robots over a link, step by step.
//!
//! A step gives every robot its next keyframe, hands over what the link has carried meanwhile and lets every robot
//! act. After the last keyframe steps go on until nobody has anything to say. Recordings that were not made at the
//! same time are replayed side by side, each from its own first keyframe.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use nalgebra::Point2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::{MissionData, Recording};
use crate::link::{Channel, ChannelKind, ModemParams, Outgoing};
use crate::pilot::{PAUSE_WITHOUT_CLOCK, elapsed, own_time};
use crate::report::{RobotReport, RunReport, Traffic};
use crate::robot::{Robot, RobotParams};
use crate::state;
use crate::unit::{in_units_of, into_metres, unit_of};

/// Settings of a mission.
#[derive(Debug, Clone)]
pub struct MissionParams {
    /// Seed that the data were made with; told in the report.
    pub seed: u64,
    /// The robots' settings, the same for all.
    pub robot: RobotParams,
    /// What connects them. Default the modem.
    pub channel: ChannelKind,
    /// The modem, if that is what connects them.
    pub modem: ModemParams,
    /// Steps after the last keyframe at most. Default 200; a mission ends as soon as all robots are silent, and
    /// says so when it had to stop before.
    pub closing_steps: usize,
}

impl Default for MissionParams {
    fn default() -> Self {
        MissionParams {
            seed: 0,
            robot: RobotParams::default(),
            channel: ChannelKind::default(),
            modem: ModemParams::default(),
            closing_steps: 200,
        }
    }
}

/// How far a mission is.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub done: u64,
    /// What happens now, in a few words.
    pub message: String,
}

/// Number of steps with keyframes in a mission over `data`.
pub fn step_count(data: &MissionData) -> u64 {
    data.recordings.iter().map(|r| r.keyframes.len()).max().unwrap_or(0) as u64
}

/// Runs a mission and returns everything there is to say about it.
///
/// * `progress` – called after every step.
///
/// # Errors
/// [`Error::NoRobots`] for data without robots, [`Error::EmptyRobot`] for a robot without keyframes, and those of
/// the robots' own stages.
pub fn run(
    data: &MissionData,
    params: &MissionParams,
    progress: impl FnMut(Progress),
) -> Result<RunReport, Error> {
    run_to_end(data, params, None, progress)
}

/// As [`run`], with the mission's state in the file `state` after every step. If there is such a file, of a mission over
/// the same data with the same settings, the mission goes on from its last complete step, and ends as if it had never
/// been interrupted. The file is removed at the end.
///
/// # Errors
/// As [`run`]; [`Error::Io`] and [`Error::State`] for a state file that cannot be written, read or used.
pub fn run_resumable(
    data: &MissionData,
    params: &MissionParams,
    state: &Path,
    progress: impl FnMut(Progress),
) -> Result<RunReport, Error> {
    run_to_end(data, params, Some(state), progress)
}

fn run_to_end(
    data: &MissionData,
    params: &MissionParams,
    state: Option<&Path>,
    mut progress: impl FnMut(Progress),
) -> Result<RunReport, Error> {
    if data.recordings.is_empty() {
        return Err(Error::NoRobots);
    }
    if let Some(empty) = data.recordings.iter().find(|r| r.keyframes.is_empty()) {
        return Err(Error::EmptyRobot { robot: empty.robot });
    }
    let start = Instant::now();
    let unit = unit_of(data);
    let scaled = if unit == 1.0 { Cow::Borrowed(data) } else { Cow::Owned(in_units_of(data, unit)) };
    let data: &MissionData = &scaled;
    let mut team = match state {
        Some(path) if path.exists() => Team::resume(data, params, path)?,
        _ => Team::new(data, params)?,
    };
    team.unit = unit;
    let steps = step_count(data);
    while team.steps < steps {
        team.step(Some(team.steps as usize))?;
        state.map_or(Ok(()), |path| team.save(params, path))?;
        let merged = team.merged_count();
        progress(Progress { done: team.steps, message: format!("{merged} robots merged") });
    }
    let mut silent = false;
    while !silent && team.steps < steps + params.closing_steps as u64 {
        silent = team.step(None)?;
        state.map_or(Ok(()), |path| team.save(params, path))?;
        progress(Progress { done: steps, message: "last messages".into() });
    }
    if !silent {
        tracing::warn!(
            steps = params.closing_steps,
            "the mission ended while robots still had messages to send"
        );
    }
    let mut report = team.report(data, params)?;
    report.timing.insert("mission_s".into(), start.elapsed().as_secs_f64());
    if unit != 1.0 {
        into_metres(&mut report, unit);
    }
    if let Some(path) = state {
        std::fs::remove_file(path).map_err(|source| Error::io(path, source))?;
    }
    Ok(report)
}

/// The robots of a mission and the link between them.
pub(crate) struct Team<'a> {
    pub(crate) recordings: &'a [Recording],
    pub(crate) robots: Vec<Robot>,
    pub(crate) link: Channel,
    /// Seconds from the start of the mission.
    pub(crate) now: f64,
    /// Seconds of a step without keyframes.
    pause: f64,
    /// Metres in the unit of length of the recordings.
    unit: f64,
    /// Steps done.
    pub(crate) steps: u64,
    /// Tells missions apart, so that none goes on from the state of another.
    data_hash: [u8; 32],
}

/// A mission after a complete step, as its state file holds it.
#[derive(Serialize, Deserialize)]
struct SavedTeam<R, L> {
    mission: [u8; 32],
    steps: u64,
    now: f64,
    robots: R,
    link: L,
}

impl<'a> Team<'a> {
    /// The mission over `data` that the file `path` holds the state of.
    fn resume(data: &'a MissionData, params: &MissionParams, path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
        let mut team = Team::new(data, params)?;
        let saved: SavedTeam<Vec<Robot>, Channel> = state::from_bytes(&bytes)?;
        if saved.mission != team.hash(params) || saved.robots.len() != team.robots.len() {
            let reason = format!("{} is the state of another mission, or of other settings", path.display());
            return Err(Error::State { reason });
        }
        (team.steps, team.now, team.robots, team.link) = (saved.steps, saved.now, saved.robots, saved.link);
        team.robots.iter_mut().for_each(|robot| robot.set_params(params.robot.clone()));
        team.link.set_params(&params.modem);
        Ok(team)
    }

    fn save(&self, params: &MissionParams, path: &Path) -> Result<(), Error> {
        let mission = self.hash(params);
        let (robots, link) = (&self.robots, &self.link);
        let saved = SavedTeam { mission, steps: self.steps, now: self.now, robots, link };
        state::write_whole(path, &state::to_bytes(&saved)?)
    }

    fn hash(&self, params: &MissionParams) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.data_hash);
        hasher.update(format!("{params:?}").as_bytes());
        *hasher.finalize().as_bytes()
    }

    pub(crate) fn new(data: &'a MissionData, params: &MissionParams) -> Result<Self, Error> {
        let recordings = &data.recordings;
        let ids: Vec<_> = recordings.iter().map(|r| r.robot).collect();
        let duration = recordings.iter().map(|r| elapsed(r, r.keyframes.len() - 1)).fold(0.0, f64::max);
        let keyframes: Vec<_> = recordings.iter().map(|r| (r.robot, &r.keyframes)).collect();
        let data_bytes =
            postcard::to_stdvec(&keyframes).map_err(|e| Error::State { reason: e.to_string() })?;
        Ok(Team {
            steps: 0,
            unit: 1.0,
            data_hash: *blake3::hash(&data_bytes).as_bytes(),
            recordings,
            robots: ids.iter().map(|&id| Robot::new(id, params.robot.clone())).collect(),
            link: Channel::new(
                params.channel,
                &params.modem,
                ids.iter().copied(),
                params.robot.transport.mtu,
            )?,
            now: 0.0,
            pause: if duration > 0.0 {
                duration / step_count(data).max(1) as f64
            } else {
                PAUSE_WITHOUT_CLOCK
            },
        })
    }

    /// One step; `index` is the keyframe every robot gets that has it. Returns whether nothing is left to do.
    pub(crate) fn step(&mut self, index: Option<usize>) -> Result<bool, Error> {
        let now = match index {
            Some(index) => self.recordings.iter().map(|r| elapsed(r, index)).fold(self.now, f64::max),
            None => self.now + self.pause,
        };
        // between two keyframes robots only keep the link going, once in every round of the channel
        let rounds = self.link.rounds(now - self.now);
        let (last, length) = (self.now, now - self.now);
        for round in 1..rounds {
            self.advance(last + length * round as f64 / rounds as f64, |robot, _, now| robot.tick(now))?;
        }
        let unit = self.unit;
        let place = |r: &Recording| {
            let truth = r.truth.get(index?.min(r.truth.len().checked_sub(1)?))?.as_ref()?;
            Some(Point2::from(truth.translation.vector * unit))
        };
        for recording in self.recordings.iter().filter(|_| index.is_some()) {
            self.link.place(recording.robot, place(recording));
        }
        let (steps, own_clocks) = (self.steps, matches!(self.link, Channel::Direct(_)));
        let clock = |recording: &Recording| if own_clocks { own_time(recording, steps) } else { now };
        let silent = self.advance(now, |robot, recording, _| {
            if let Some(keyframe) = index.and_then(|i| recording.keyframes.get(i)) {
                robot.add_keyframe(keyframe)?;
            }
            robot.step(clock(recording))
        })?;
        self.steps += 1;
        let mut robots = self.robots.iter().zip(self.recordings);
        let settled = robots.all(|(robot, recording)| robot.is_settled(clock(recording)));
        Ok(silent && settled && self.link.is_idle())
    }

    /// Moves the clock to `now`, delivers what has arrived, lets every robot act and hands over what it sends. Returns
    /// whether nobody sent anything.
    fn advance(
        &mut self,
        now: f64,
        act: impl Fn(&mut Robot, &Recording, f64) -> Result<Vec<Outgoing>, Error> + Sync,
    ) -> Result<bool, Error> {
        self.now = now;
        let mut inbox: BTreeMap<u32, Vec<Vec<u8>>> = BTreeMap::new();
        for delivery in self.link.receive(now) {
            inbox.entry(delivery.receiver).or_default().push(delivery.bytes);
        }
        // robots meet only over the link, so they may act at the same time without changing the result
        let sent: Vec<Result<Vec<Outgoing>, Error>> = self
            .robots
            .par_iter_mut()
            .zip(self.recordings)
            .map(|(robot, recording)| {
                for bytes in inbox.get(&robot.id()).into_iter().flatten() {
                    robot.receive(bytes);
                }
                act(robot, recording, now)
            })
            .collect();
        let mut silent = true;
        for (robot, packets) in self.robots.iter().zip(sent) {
            for packet in packets? {
                silent = false;
                self.link.send(now, robot.id(), packet)?;
            }
        }
        Ok(silent)
    }

    pub(crate) fn merged_count(&self) -> usize {
        self.reference().map_or(0, |robot| robot.team().robots().count())
    }

    /// The robot whose view of the team is reported: of those that see most robots the one with the lowest number.
    pub(crate) fn reference(&self) -> Option<&Robot> {
        let seen = |robot: &Robot| robot.team().robots().count();
        self.robots
            .iter()
            .filter(|r| seen(r) > 1)
            .max_by(|a, b| seen(a).cmp(&seen(b)).then(b.id().cmp(&a.id())))
    }

    pub(crate) fn report(&self, data: &MissionData, params: &MissionParams) -> Result<RunReport, Error> {
        let reference = self.reference();
        let mut report = RunReport {
            scenario: data.name.clone(),
            seed: params.seed,
            consistency: params.robot.method.to_string(),
            truth_has_heading: data.truth_has_heading,
            link_bits_per_second: self.link.rate_bps(&params.modem),
            ..Default::default()
        };
        for (robot, recording) in self.robots.iter().zip(self.recordings) {
            report.robots.push(robot_report(robot, recording, reference)?);
            report.closures.extend(robot.closure_reports());
        }
        report.closures.sort_by(|a, b| a.time.total_cmp(&b.time));
        let mut log: Vec<_> = self.link.log().to_vec();
        log.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.sender.cmp(&b.sender)));
        report.traffic = log
            .iter()
            .map(|t| Traffic { time: t.time, robot: t.sender, kind: t.kind.to_string(), bits: t.bits })
            .collect();
        report.settings.push(("optimisation".into(), params.robot.optimisation.to_string()));
        if params.channel == ChannelKind::Direct {
            let print = |robot: &Robot| (format!("fingerprint of robot {}", robot.id()), robot.fingerprint());
            report.settings.extend(self.robots.iter().map(print));
        }
        if let Some(robot) = reference {
            report.settings.push(("reference robot".into(), robot.id().to_string()));
            report.graph_g2o = robot.team_graph_g2o()?;
        }
        Ok(report)
    }
}

/// * `reference` – the robot in whose frame it is reported, if there is one.
pub(crate) fn robot_report(
    robot: &Robot,
    recording: &Recording,
    reference: Option<&Robot>,
) -> Result<RobotReport, Error> {
    let local = robot.local_poses();
    let seen = reference.and_then(|r| r.team().trajectory(robot.id()));
    let trajectory = seen.unwrap_or(local).to_vec();
    Ok(RobotReport {
        id: robot.id(),
        merged: seen.is_some(),
        times: recording.keyframes.iter().map(|k| k.time).collect(),
        dead_reckoning: recording.keyframes.iter().map(|k| k.odometry).collect(),
        objects: robot.object_reports(&trajectory)?,
        trajectory,
        local: local.to_vec(),
        truth: recording.truth.clone(),
        points: recording.keyframes.iter().map(|k| k.points.clone()).collect(),
        own_closures: robot.own_closures(),
        refused: robot.refusals().iter().map(|(refusal, count)| (refusal.name().to_owned(), count)).collect(),
        matched: robot.alignment_reports(),
    })
}

//! Many robots over a link, step by step.
//!
//! A step gives every robot its next keyframe, hands over what the link has carried meanwhile and lets every robot
//! act. After the last keyframe steps go on until nobody has anything to say. Recordings that were not made at the
//! same time are replayed side by side, each from its own first keyframe.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::error::Error;
use crate::keyframe::{MissionData, Recording};
use crate::link::{Modem, ModemParams};
use crate::report::{RobotReport, RunReport, Traffic};
use crate::robot::{Robot, RobotParams};

/// Settings of a mission.
#[derive(Debug, Clone)]
pub struct MissionParams {
    /// Seed that the data were made with; told in the report.
    pub seed: u64,
    /// The robots' settings, the same for all.
    pub robot: RobotParams,
    /// The modem.
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
    mut progress: impl FnMut(Progress),
) -> Result<RunReport, Error> {
    if data.recordings.is_empty() {
        return Err(Error::NoRobots);
    }
    if let Some(empty) = data.recordings.iter().find(|r| r.keyframes.is_empty()) {
        return Err(Error::EmptyRobot { robot: empty.robot });
    }
    let start = Instant::now();
    let mut team = Team::new(data, params);
    let steps = step_count(data);
    for step in 0..steps {
        team.step(Some(step as usize))?;
        let merged = team.merged_count();
        progress(Progress { done: step + 1, message: format!("{merged} robots merged") });
    }
    let mut silent = false;
    for _ in 0..params.closing_steps {
        if team.step(None)? {
            silent = true;
            break;
        }
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
    Ok(report)
}

/// Seconds of a closing step where the data do not tell how long a step takes.
const PAUSE_WITHOUT_CLOCK: f64 = 10.0;

struct Team<'a> {
    recordings: &'a [Recording],
    robots: Vec<Robot>,
    modem: Modem,
    /// Seconds from the start of the mission.
    now: f64,
    /// Seconds of a step without keyframes.
    pause: f64,
}

impl<'a> Team<'a> {
    fn new(data: &'a MissionData, params: &MissionParams) -> Self {
        let recordings = &data.recordings;
        let ids: Vec<_> = recordings.iter().map(|r| r.robot).collect();
        let duration = recordings.iter().map(|r| elapsed(r, r.keyframes.len() - 1)).fold(0.0, f64::max);
        Team {
            recordings,
            robots: ids.iter().map(|&id| Robot::new(id, params.robot.clone())).collect(),
            modem: Modem::new(&params.modem, ids.iter().copied()),
            now: 0.0,
            pause: if duration > 0.0 {
                duration / step_count(data).max(1) as f64
            } else {
                PAUSE_WITHOUT_CLOCK
            },
        }
    }

    /// One step; `index` is the keyframe every robot gets that has it. Returns whether nothing is left to do.
    fn step(&mut self, index: Option<usize>) -> Result<bool, Error> {
        self.now = match index {
            Some(index) => self.recordings.iter().map(|r| elapsed(r, index)).fold(self.now, f64::max),
            None => self.now + self.pause,
        };
        let mut inbox: BTreeMap<u32, Vec<Vec<u8>>> = BTreeMap::new();
        for delivery in self.modem.receive(self.now) {
            inbox.entry(delivery.receiver).or_default().push(delivery.bytes);
        }
        let now = self.now;
        // robots meet only over the link, so they may act at the same time without changing the result
        let results: Vec<_> = std::thread::scope(|scope| {
            let handles: Vec<_> = self
                .robots
                .iter_mut()
                .zip(self.recordings)
                .map(|(robot, recording)| {
                    let keyframe = index.and_then(|i| recording.keyframes.get(i));
                    let frames = inbox.remove(&robot.id()).unwrap_or_default();
                    scope.spawn(move || {
                        if let Some(keyframe) = keyframe {
                            robot.add_keyframe(keyframe)?;
                        }
                        for bytes in &frames {
                            robot.receive(bytes);
                        }
                        robot.step(now)
                    })
                })
                .collect();
            handles.into_iter().map(|handle| handle.join()).collect()
        });
        let mut silent = true;
        for (robot, result) in self.robots.iter().zip(results) {
            let frames = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            for frame in frames {
                silent = false;
                self.modem.send(self.now, robot.id(), frame);
            }
        }
        Ok(silent && self.modem.waiting_bits() == 0)
    }

    fn merged_count(&self) -> usize {
        self.reference().map_or(0, |robot| robot.team().robots().count())
    }

    /// The robot whose view of the team is reported: of those that see most robots the one with the lowest number.
    fn reference(&self) -> Option<&Robot> {
        let seen = |robot: &Robot| robot.team().robots().count();
        self.robots
            .iter()
            .filter(|r| seen(r) > 1)
            .max_by(|a, b| seen(a).cmp(&seen(b)).then(b.id().cmp(&a.id())))
    }

    fn report(&self, data: &MissionData, params: &MissionParams) -> Result<RunReport, Error> {
        let reference = self.reference();
        let mut report = RunReport {
            scenario: data.name.clone(),
            seed: params.seed,
            consistency: params.robot.method.to_string(),
            truth_has_heading: data.truth_has_heading,
            link_bits_per_second: Some(params.modem.rate_bps),
            ..Default::default()
        };
        for (robot, recording) in self.robots.iter().zip(self.recordings) {
            report.robots.push(robot_report(robot, recording, reference)?);
            report.closures.extend(robot.closure_reports());
        }
        report.closures.sort_by(|a, b| a.time.total_cmp(&b.time));
        let mut log: Vec<_> = self.modem.log().to_vec();
        log.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.sender.cmp(&b.sender)));
        report.traffic = log
            .iter()
            .map(|t| Traffic { time: t.time, robot: t.sender, kind: t.kind.into(), bits: t.bits })
            .collect();
        report.settings.push(("optimisation".into(), params.robot.optimisation.to_string()));
        if let Some(robot) = reference {
            report.settings.push(("reference robot".into(), robot.id().to_string()));
            report.graph_g2o = robot.team_graph_g2o()?;
        }
        Ok(report)
    }
}

/// Seconds from the robot's first keyframe to keyframe `index`, or to its last one when it has fewer.
fn elapsed(recording: &Recording, index: usize) -> f64 {
    let keyframes = &recording.keyframes;
    keyframes[index.min(keyframes.len() - 1)].time - keyframes[0].time
}

fn robot_report(
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
        matched: robot.alignment_reports(),
    })
}

//! One robot with what it recorded, step by step.

use crate::error::Error;
use crate::keyframe::Recording;
use crate::link::Outgoing;
use crate::robot::{Robot, RobotParams};

/// Seconds of a closing step where the data do not tell how long a step takes.
pub(crate) const PAUSE_WITHOUT_CLOCK: f64 = 10.0;

/// Seconds from the robot's first keyframe to keyframe `index`, or to its last one when it has fewer.
pub(crate) fn elapsed(recording: &Recording, index: usize) -> f64 {
    let keyframes = &recording.keyframes;
    keyframes[index.min(keyframes.len() - 1)].time - keyframes[0].time
}

/// What the robot's own clock shows in step `step`: the time of that keyframe, and after the last one as long a step
/// further as its steps took on average.
pub(crate) fn own_time(recording: &Recording, step: u64) -> f64 {
    let last = recording.keyframes.len() - 1;
    let end = elapsed(recording, last);
    let pause = if end > 0.0 { end / last as f64 } else { PAUSE_WITHOUT_CLOCK };
    elapsed(recording, step as usize) + step.saturating_sub(last as u64) as f64 * pause
}

/// A robot that is given its recording keyframe by keyframe.
#[derive(Debug, Clone)]
pub(crate) struct Pilot<'a> {
    pub(crate) robot: Robot,
    recording: &'a Recording,
    /// Steps done.
    pub(crate) steps: u64,
}

impl<'a> Pilot<'a> {
    pub(crate) fn new(recording: &'a Recording, params: RobotParams) -> Self {
        Pilot { robot: Robot::new(recording.robot, params), recording, steps: 0 }
    }

    /// Goes on with a robot that has done `steps` of this recording.
    pub(crate) fn resume(recording: &'a Recording, robot: Robot, steps: u64) -> Self {
        Pilot { robot, recording, steps }
    }

    /// Hears, takes the keyframe of this step if there is one, thinks, and returns what to send.
    pub(crate) fn step(&mut self, heard: &[Vec<u8>]) -> Result<Vec<Outgoing>, Error> {
        heard.iter().for_each(|bytes| self.robot.receive(bytes));
        if let Some(keyframe) = self.recording.keyframes.get(self.steps as usize) {
            self.robot.add_keyframe(keyframe)?;
        }
        let sent = self.robot.step(own_time(self.recording, self.steps))?;
        self.steps += 1;
        Ok(sent)
    }

    /// Seconds on the robot's clock at the last step.
    pub(crate) fn now(&self) -> f64 {
        own_time(self.recording, self.steps.saturating_sub(1))
    }

    /// Whether the last step had a keyframe.
    pub(crate) fn is_recording(&self) -> bool {
        self.steps <= self.recording.keyframes.len() as u64
    }

    /// Whether the robot waits for nothing, and nobody it hears for anything of it.
    pub(crate) fn is_settled(&self) -> bool {
        self.robot.is_settled(self.now())
    }
}

use serde::{Deserialize, Serialize};

use crate::keyframe::RobotId;
use crate::message::{BROADCAST, WireError};
use crate::transport::{Refusal, TeamKey};

/// First byte of every envelope; no packet begins with it, so that neither can be taken for the other.
const VERSION: u8 = 0xD1;

/// How far a robot is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// The step had a keyframe.
    Recording,
    /// All keyframes are in; there is still something to say or to hear.
    Closing,
    /// There is nothing left to do.
    Done,
}

/// What one process says to the others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Envelope {
    /// "I am here, and this is how much I have heard of whom." Whoever has more repeats its last steps.
    Hello {
        /// Who says it.
        robot: RobotId,
        /// Grows whenever its process is started again.
        session: u64,
        /// Steps it has done.
        steps: u64,
        /// Robots heard, each with the number of its steps that are complete.
        heard: Vec<(RobotId, u64)>,
    },
    /// A packet.
    Frame {
        /// Who sends it.
        robot: RobotId,
        /// In which of its steps.
        step: u64,
        /// Place in the order of the step's packets, from 0.
        number: u32,
        /// The packet.
        bytes: Vec<u8>,
    },
    /// "My step is over."
    End {
        /// Whose.
        robot: RobotId,
        /// Which.
        step: u64,
        /// How many packets it had.
        frames: u32,
        /// How far the robot is.
        stage: Stage,
    },
}

#[derive(Serialize, Deserialize)]
enum Wire {
    Hello { robot: u8, session: u64, steps: u64, heard: Vec<(u8, u64)> },
    Frame { robot: u8, step: u64, number: u32, bytes: Vec<u8> },
    End { robot: u8, step: u64, frames: u32, stage: Stage },
}

impl Envelope {
    /// The bytes of this envelope, with the tag of `key`.
    ///
    /// # Errors
    /// [`WireError::Value`] for a robot number above 254.
    pub fn encode(&self, key: &TeamKey) -> Result<Vec<u8>, WireError> {
        let wire = match self {
            Envelope::Hello { robot, session, steps, heard } => {
                let heard = heard.iter().map(|&(of, steps)| Ok((short(of)?, steps)));
                let heard = heard.collect::<Result<_, WireError>>()?;
                Wire::Hello { robot: short(*robot)?, session: *session, steps: *steps, heard }
            }
            Envelope::Frame { robot, step, number, bytes } => {
                Wire::Frame { robot: short(*robot)?, step: *step, number: *number, bytes: bytes.clone() }
            }
            Envelope::End { robot, step, frames, stage } => {
                Wire::End { robot: short(*robot)?, step: *step, frames: *frames, stage: *stage }
            }
        };
        let body = postcard::to_extend(&wire, vec![VERSION])
            .map_err(|e| WireError::Malformed { reason: e.to_string() })?;
        Ok(key.seal(body))
    }

    /// The envelope in `bytes`, if the tag is that of `key`. Never panics, whatever the bytes are.
    ///
    /// # Errors
    /// The [`Refusal`] that says what is wrong.
    pub fn decode(bytes: &[u8], key: &TeamKey) -> Result<Self, Refusal> {
        if bytes.first() != Some(&VERSION) {
            return Err(if bytes.is_empty() { Refusal::Length } else { Refusal::Version });
        }
        let body = key.open(bytes).ok_or(Refusal::Tag)?;
        let (wire, rest) = postcard::take_from_bytes::<Wire>(body.get(1..).ok_or(Refusal::Length)?)
            .map_err(|_| Refusal::Malformed)?;
        if !rest.is_empty() {
            return Err(Refusal::Malformed);
        }
        let envelope = match wire {
            Wire::Hello { robot, session, steps, heard } => Envelope::Hello {
                robot: robot.into(),
                session,
                steps,
                heard: heard.into_iter().map(|(of, steps)| (of.into(), steps)).collect(),
            },
            Wire::Frame { robot, step, number, bytes } => {
                Envelope::Frame { robot: robot.into(), step, number, bytes }
            }
            Wire::End { robot, step, frames, stage } => {
                Envelope::End { robot: robot.into(), step, frames, stage }
            }
        };
        if envelope.robot() == BROADCAST { Err(Refusal::Impossible) } else { Ok(envelope) }
    }

    /// Who says it.
    pub fn robot(&self) -> RobotId {
        match self {
            Envelope::Hello { robot, .. } | Envelope::Frame { robot, .. } | Envelope::End { robot, .. } => {
                *robot
            }
        }
    }
}

fn short(robot: RobotId) -> Result<u8, WireError> {
    let fits = u8::try_from(robot).ok().filter(|_| robot < BROADCAST);
    fits.ok_or(WireError::Value { what: "a robot number above 254" })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn envelopes() -> [Envelope; 3] {
        [
            Envelope::Hello { robot: 3, session: 5, steps: 9, heard: vec![(1, 0), (2, 700)] },
            Envelope::Frame { robot: 3, step: 300, number: 2, bytes: vec![7, 8] },
            Envelope::End { robot: 3, step: 300, frames: 3, stage: Stage::Closing },
        ]
    }

    #[test]
    fn the_wire_format_has_not_changed() {
        let golden: [&[u8]; 3] = [
            &[0xD1, 0, 3, 5, 9, 2, 1, 0, 2, 188, 5],
            &[0xD1, 1, 3, 172, 2, 2, 2, 7, 8],
            &[0xD1, 2, 3, 172, 2, 3, 1],
        ];
        let key = TeamKey::from_phrase("golden");
        for (envelope, body) in envelopes().iter().zip(golden) {
            let bytes = envelope.encode(&key).unwrap();
            assert_eq!(&bytes[..bytes.len() - 8], body, "{envelope:?}");
            assert_eq!(Envelope::decode(&bytes, &key).as_ref(), Ok(envelope));
        }
    }

    #[test]
    fn only_the_teams_own_undamaged_envelopes_are_taken() {
        let key = TeamKey::from_phrase("ours");
        for envelope in envelopes() {
            let bytes = envelope.encode(&key).unwrap();
            assert_eq!(Envelope::decode(&bytes, &TeamKey::default()), Err(Refusal::Tag));
            for bit in 0..8 * bytes.len() {
                let mut flipped = bytes.clone();
                flipped[bit / 8] ^= 1 << (bit % 8);
                assert!(Envelope::decode(&flipped, &key).is_err(), "bit {bit}");
            }
            (0..bytes.len()).for_each(|length| assert!(Envelope::decode(&bytes[..length], &key).is_err()));
        }
        let nobody = Envelope::End { robot: 255, step: 0, frames: 0, stage: Stage::Done };
        assert!(nobody.encode(&key).is_err());
    }
}

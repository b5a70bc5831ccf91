use serde::{Deserialize, Serialize};

use super::Refusal;
use crate::keyframe::RobotId;
use crate::message::{BROADCAST, WireError};

/// Packets of one stream that a robot lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Want {
    /// Whose stream it is.
    pub(super) of: RobotId,
    /// The robot that shall repeat them.
    pub(super) asked: RobotId,
    /// First number and length of each gap.
    pub(super) ranges: Vec<(u32, u32)>,
}

/// What a robot has and lacks.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Status {
    /// For each stream, the sender's own included: its maker, its epoch, the number of packets in order.
    pub(super) has: Vec<(RobotId, u32, u32)>,
    /// What the sender lacks.
    pub(super) wants: Vec<Want>,
}

#[derive(Serialize, Deserialize)]
struct WireStatus {
    has: Vec<(u8, u32, u32)>,
    wants: Vec<WireWant>,
}

#[derive(Serialize, Deserialize)]
struct WireWant {
    of: u8,
    asked: u8,
    /// Numbers between the end of the last gap and the start of this one, and this one's length less one.
    gaps: Vec<(u32, u32)>,
}

impl Status {
    /// At most `room` bytes: what does not fit is asked for the next time.
    pub(super) fn encode(&self, room: usize) -> Result<Vec<u8>, WireError> {
        let robot = |id: RobotId| {
            u8::try_from(id)
                .ok()
                .filter(|_| id < BROADCAST)
                .ok_or(WireError::Value { what: "a robot number above 254" })
        };
        let mut wire = WireStatus { has: Vec::new(), wants: Vec::new() };
        for &(of, epoch, count) in &self.has {
            wire.has.push((robot(of)?, epoch, count));
        }
        for want in &self.wants {
            let mut end = 0;
            let gap = |&(from, length): &(u32, u32)| {
                let skipped = from - end;
                end = from + length;
                (skipped, length - 1)
            };
            let gaps = want.ranges.iter().map(gap).collect();
            wire.wants.push(WireWant { of: robot(want.of)?, asked: robot(want.asked)?, gaps });
        }
        loop {
            let bytes =
                postcard::to_stdvec(&wire).map_err(|e| WireError::Malformed { reason: e.to_string() })?;
            if bytes.len() <= room {
                return Ok(bytes);
            }
            // the newest gaps go first, then whole streams from the last
            match wire.wants.last_mut() {
                Some(want) if want.gaps.len() > 1 => want.gaps.truncate(want.gaps.len() / 2),
                Some(_) => drop(wire.wants.pop()),
                None if wire.has.len() > 1 => drop(wire.has.pop()),
                None => return Ok(bytes),
            }
        }
    }

    pub(super) fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        let (wire, rest) = postcard::take_from_bytes::<WireStatus>(bytes).map_err(|_| Refusal::Malformed)?;
        if !rest.is_empty() {
            return Err(Refusal::Malformed);
        }
        let mut status = Status::default();
        for (of, epoch, count) in wire.has {
            if RobotId::from(of) == BROADCAST {
                return Err(Refusal::Impossible);
            }
            status.has.push((of.into(), epoch, count));
        }
        let mut packets = 0_u32;
        for want in wire.wants {
            let (mut ranges, mut end) = (Vec::new(), 0_u32);
            for (skipped, length) in want.gaps {
                let from = end.checked_add(skipped).ok_or(Refusal::Impossible)?;
                end = from.checked_add(length).and_then(|e| e.checked_add(1)).ok_or(Refusal::Impossible)?;
                ranges.push((from, end - from));
                packets = packets.saturating_add(end - from);
            }
            status.wants.push(Want { of: want.of.into(), asked: want.asked.into(), ranges });
        }
        // nobody asks for so many at once
        if packets > 1 << 16 { Err(Refusal::Impossible) } else { Ok(status) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status() -> Status {
        let want = |of, ranges: &[(u32, u32)]| Want { of, asked: of, ranges: ranges.to_vec() };
        Status {
            has: vec![(1, 0, 20), (2, 3, 500)],
            wants: vec![want(2, &[(500, 1), (502, 96), (700, 2)]), want(9, &[(0, 4)])],
        }
    }

    #[test]
    fn what_was_said_is_understood() {
        let bytes = status().encode(512).unwrap();
        assert_eq!(Status::decode(&bytes), Ok(status()));
        assert!(bytes.len() < 32, "{}", bytes.len());
    }

    #[test]
    fn what_does_not_fit_waits() {
        for room in 5..40 {
            let bytes = status().encode(room).unwrap();
            assert!(bytes.len() <= room);
            let shorter = Status::decode(&bytes).unwrap();
            assert_eq!(shorter.has[0], status().has[0]);
            for (kept, all) in shorter.wants.iter().zip(status().wants) {
                assert_eq!(kept.ranges, all.ranges[..kept.ranges.len()]);
            }
        }
    }

    #[test]
    fn nonsense_is_refused() {
        assert_eq!(Status::decode(&[200]), Err(Refusal::Malformed));
        assert_eq!(Status::decode(&[1, 255, 0, 0, 0]), Err(Refusal::Impossible));
        let huge = [0, 1, 1, 1, 1, 0, 255, 255, 255, 255, 14];
        assert_eq!(Status::decode(&huge), Err(Refusal::Malformed).or(Err::<Status, _>(Refusal::Impossible)));
    }
}

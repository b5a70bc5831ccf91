use std::fmt;

use serde::{Deserialize, Serialize};

use super::Refusal;
use crate::keyframe::RobotId;
use crate::message::{BROADCAST, WireError};

/// Version of the wire format; the first byte of every packet.
pub const VERSION: u8 = 4;

/// Bytes of the tag at the end of every packet: a forger who tries one a millisecond succeeds once in half a billion
/// years.
pub const TAG_BYTES: usize = 8;

/// Most bytes a packet needs besides its payload: version, sender, kind, two numbers of at most five bytes, tag.
pub(super) const OVERHEAD_BYTES: usize = 3 + 5 + 5 + TAG_BYTES;

/// The secret a team shares. Whoever holds it can speak for every robot of the team.
///
/// The default is no secret at all, the same for everyone: its tag still finds damage as a checksum would.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct TeamKey([u8; 32]);

impl TeamKey {
    /// The key that `phrase` makes. Choose a phrase nobody can guess: it is not stretched.
    pub fn from_phrase(phrase: &str) -> Self {
        TeamKey(blake3::derive_key(
            "draco-slam 2026 team key, packets on the acoustic link",
            phrase.as_bytes(),
        ))
    }

    /// `body` with its tag.
    pub(crate) fn seal(&self, mut body: Vec<u8>) -> Vec<u8> {
        body.extend_from_slice(&self.tag(&body));
        body
    }

    /// What [`TeamKey::seal`] was given, if `bytes` end in its tag.
    pub(crate) fn open<'a>(&self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let (body, tag) = bytes.split_last_chunk::<TAG_BYTES>()?;
        // every byte is compared whatever the others are, so that time tells nothing about the right tag
        (self.tag(body).iter().zip(tag).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0).then_some(body)
    }

    /// BLAKE3 keyed with this, of `body`, cut to [`TAG_BYTES`].
    fn tag(&self, body: &[u8]) -> [u8; TAG_BYTES] {
        let mut tag = [0; TAG_BYTES];
        tag.copy_from_slice(&blake3::keyed_hash(&self.0, body).as_bytes()[..TAG_BYTES]);
        tag
    }
}

impl Default for TeamKey {
    fn default() -> Self {
        TeamKey::from_phrase("")
    }
}

impl fmt::Debug for TeamKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TeamKey(..)")
    }
}

/// What a packet carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PacketKind {
    /// A part of a message of which more parts follow.
    Part,
    /// The last, or only, part of a message.
    LastPart,
    /// What the sender has and lacks; see the module's text.
    Status,
}

/// The least thing that crosses the link: it arrives whole or not at all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Packet {
    /// Robot that made it; not always the one that sends it, since robots repeat each other's packets.
    pub sender: RobotId,
    /// Counts how often the sender has begun anew without remembering its numbers.
    pub epoch: u32,
    /// Parts are counted from 0 in the sender's stream; statuses by themselves.
    pub number: u32,
    /// What it carries.
    pub kind: PacketKind,
    /// The contents.
    pub payload: Vec<u8>,
}

#[derive(Serialize, Deserialize)]
struct Header {
    sender: u8,
    kind: PacketKind,
    epoch: u32,
    number: u32,
}

impl Packet {
    /// The bytes of this packet, with the tag of `key`.
    ///
    /// # Errors
    /// [`WireError::Value`] for a robot number above 254.
    pub fn encode(&self, key: &TeamKey) -> Result<Vec<u8>, WireError> {
        let sender = u8::try_from(self.sender)
            .ok()
            .filter(|_| self.sender < BROADCAST)
            .ok_or(WireError::Value { what: "a robot number above 254" })?;
        let header = Header { sender, kind: self.kind, epoch: self.epoch, number: self.number };
        let mut bytes = postcard::to_extend(&header, vec![VERSION])
            .map_err(|e| WireError::Malformed { reason: e.to_string() })?;
        bytes.extend_from_slice(&self.payload);
        Ok(key.seal(bytes))
    }

    /// The packet in `bytes`, if the tag is that of `key`. Never panics, whatever the bytes are.
    ///
    /// # Errors
    /// The [`Refusal`] that says what is wrong. Nothing but version and tag of a packet is looked at before the tag has
    /// been found right.
    pub fn decode(bytes: &[u8], key: &TeamKey) -> Result<Self, Refusal> {
        if bytes.len() <= TAG_BYTES + 4 {
            return Err(Refusal::Length);
        }
        if bytes[0] != VERSION {
            return Err(Refusal::Version);
        }
        let body = key.open(bytes).ok_or(Refusal::Tag)?;
        let (header, payload) =
            postcard::take_from_bytes::<Header>(&body[1..]).map_err(|_| Refusal::Malformed)?;
        if RobotId::from(header.sender) == BROADCAST {
            return Err(Refusal::Impossible);
        }
        Ok(Packet {
            sender: header.sender.into(),
            epoch: header.epoch,
            number: header.number,
            kind: header.kind,
            payload: payload.to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet() -> Packet {
        Packet { sender: 3, epoch: 1, number: 300, kind: PacketKind::LastPart, payload: vec![7, 8, 9] }
    }

    #[test]
    fn the_wire_format_has_not_changed() {
        let key = TeamKey::from_phrase("golden");
        let bytes = packet().encode(&key).unwrap();
        assert_eq!(bytes[..9], [4, 3, 1, 1, 172, 2, 7, 8, 9]);
        assert_eq!(bytes[9..], key.tag(&bytes[..9]));
        assert_eq!(Packet::decode(&bytes, &key), Ok(packet()));
        assert!(bytes.len() - 3 <= OVERHEAD_BYTES);
    }

    #[test]
    fn only_the_teams_own_undamaged_packets_are_taken() {
        let key = TeamKey::from_phrase("ours");
        let bytes = packet().encode(&key).unwrap();
        assert_eq!(Packet::decode(&bytes, &TeamKey::default()), Err(Refusal::Tag));
        assert_eq!(Packet::decode(&bytes[..10], &key), Err(Refusal::Length));
        for bit in 8..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Packet::decode(&flipped, &key), Err(Refusal::Tag), "bit {bit}");
        }
    }
}

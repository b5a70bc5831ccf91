use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Packet, PacketKind, Refusal};

/// Packets kept that arrived before their predecessors. Half a megabyte a partner at the default packet size.
const WINDOW: u32 = 1024;

/// Longest message that is put together, bytes; a scan of ten thousand points takes a tenth.
const MESSAGE_LIMIT: usize = 1 << 20;

/// One other robot's stream as far as it has arrived: packets in any order in, messages in the sender's order out.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Incoming {
    /// The stream is that of this epoch of the sender.
    pub(super) epoch: u32,
    /// Packets `0..arrived.len()` in order, as they came, so that they can be repeated for others.
    arrived: Vec<Vec<u8>>,
    /// Packets whose predecessors are missing.
    ahead: BTreeMap<u32, (Packet, Vec<u8>)>,
    /// Packets that are known to exist, from whoever told.
    told: u32,
    /// Parts of the message that is not complete.
    message: Vec<u8>,
    /// Whether that message is too long, so that it is read to its end and dropped.
    too_long: bool,
}

impl Incoming {
    pub(super) fn new(epoch: u32) -> Self {
        Incoming { epoch, ..Default::default() }
    }

    /// Number of the first packet that is missing.
    pub(super) fn next(&self) -> u32 {
        self.arrived.len() as u32
    }

    /// Somebody says that packets below `count` exist.
    pub(super) fn tell(&mut self, count: u32) {
        self.told = self.told.max(count);
    }

    /// The bytes of packet `number`, if it has arrived.
    pub(super) fn bytes(&self, number: u32) -> Option<&[u8]> {
        let in_order = self.arrived.get(number as usize);
        in_order.or_else(|| self.ahead.get(&number).map(|(_, bytes)| bytes)).map(Vec::as_slice)
    }

    /// Ranges of packets known to exist that have not arrived, as first number and length, oldest first; at most
    /// `limit` packets.
    pub(super) fn missing(&self, mut limit: u32) -> Vec<(u32, u32)> {
        let mut ranges = Vec::new();
        let end = self.told.max(self.ahead.last_key_value().map_or(0, |(number, _)| number + 1));
        let mut from = self.next();
        for number in self.ahead.keys().copied().chain([end]) {
            let length = number.saturating_sub(from).min(limit);
            if length > 0 {
                ranges.push((from, length));
                limit -= length;
            }
            from = number + 1;
        }
        ranges
    }

    /// Takes a part in. Returns the messages it completes, and how many messages were dropped as too long.
    pub(super) fn take(&mut self, packet: Packet, bytes: &[u8]) -> Result<(Vec<Vec<u8>>, u32), Refusal> {
        let number = packet.number;
        if number < self.next() || self.ahead.contains_key(&number) {
            return Err(Refusal::Duplicate);
        }
        self.tell(number.saturating_add(1));
        if number - self.next() >= WINDOW {
            return Err(Refusal::Ahead);
        }
        self.ahead.insert(number, (packet, bytes.to_vec()));
        let (mut complete, mut dropped) = (Vec::new(), 0);
        while let Some((packet, bytes)) = self.ahead.remove(&self.next()) {
            self.arrived.push(bytes);
            self.too_long |= self.message.len() + packet.payload.len() > MESSAGE_LIMIT;
            if !self.too_long {
                self.message.extend_from_slice(&packet.payload);
            }
            if packet.kind == PacketKind::LastPart {
                let message = std::mem::take(&mut self.message);
                if std::mem::take(&mut self.too_long) { dropped += 1 } else { complete.push(message) }
            }
        }
        Ok((complete, dropped))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A stream of `lengths.len()` messages of so many parts each; every part holds its own number.
    fn stream(lengths: &[usize]) -> (Vec<Packet>, Vec<Vec<u8>>) {
        let (mut packets, mut messages) = (Vec::new(), Vec::new());
        for &length in lengths {
            let mut message = Vec::new();
            for part in 0..length {
                let number = packets.len() as u32;
                message.push(number as u8);
                let kind = if part + 1 == length { PacketKind::LastPart } else { PacketKind::Part };
                packets.push(Packet { sender: 1, epoch: 0, number, kind, payload: vec![number as u8] });
            }
            messages.push(message);
        }
        (packets, messages)
    }

    proptest! {
        #[test]
        fn any_order_and_any_repetition_gives_the_same_messages(
            lengths in prop::collection::vec(1..5usize, 1..20),
            picks in prop::collection::vec(any::<prop::sample::Index>(), 0..200),
        ) {
            let (packets, messages) = stream(&lengths);
            let mut incoming = Incoming::default();
            let mut received = Vec::new();
            let all = picks.iter().map(|pick| pick.index(packets.len())).chain(0..packets.len());
            for at in all {
                let known = incoming.bytes(at as u32).is_some();
                match incoming.take(packets[at].clone(), &[at as u8]) {
                    Ok((complete, 0)) => received.extend(complete),
                    Err(Refusal::Duplicate) => prop_assert!(known),
                    other => prop_assert!(false, "{other:?}"),
                }
                // what is neither there nor missing nor past the last one heard of cannot be
                let missing: u32 = incoming.missing(u32::MAX).iter().map(|range| range.1).sum();
                let present = (0..packets.len() as u32).filter(|n| incoming.bytes(*n).is_some()).count();
                prop_assert_eq!(missing + present as u32, incoming.told);
            }
            prop_assert_eq!(received, messages);
        }
    }

    #[test]
    fn a_message_without_end_is_dropped_and_the_next_one_arrives() {
        let mut incoming = Incoming::default();
        let part =
            |number, kind, length| Packet { sender: 1, epoch: 0, number, kind, payload: vec![1; length] };
        assert_eq!(incoming.take(part(0, PacketKind::Part, MESSAGE_LIMIT), &[]), Ok((vec![], 0)));
        assert_eq!(incoming.take(part(1, PacketKind::Part, 1), &[]), Ok((vec![], 0)));
        assert_eq!(incoming.take(part(2, PacketKind::LastPart, 9), &[]), Ok((vec![], 1)));
        assert_eq!(incoming.take(part(3, PacketKind::LastPart, 2), &[]), Ok((vec![vec![1, 1]], 0)));
    }

    #[test]
    fn packets_far_ahead_are_not_kept_but_known_to_be_missing() {
        let mut incoming = Incoming::default();
        let far = Packet { sender: 1, epoch: 0, number: WINDOW, kind: PacketKind::LastPart, payload: vec![] };
        assert_eq!(incoming.take(far, &[]), Err(Refusal::Ahead));
        assert_eq!(incoming.missing(u32::MAX), [(0, WINDOW + 1)]);
        assert_eq!(incoming.missing(5), [(0, 5)]);
    }
}

//! Reliable streams over a link that loses, repeats and reorders packets.
//!
//! Each robot speaks to everybody at once, in one stream: its messages, cut into packets no longer than the modem
//! takes and numbered from 0. Whoever listens puts the packets in order and hands the messages on in the order in which
//! they were sent, each once. So repetition and order on the link cannot change what a robot knows, and two robots that
//! have heard the same part of a stream know the same.
//!
//! Losses are repaired on demand. Now and then a robot tells in a *status* how much of every stream it has, its own
//! included, and at once what it lacks and whom it asks for it. That is the maker of the stream while it is heard, else
//! another robot that has the packets: robots that meet only through a third learn of each other this way, and late
//! joiners catch up. A lossless link carries statuses but no repairs.
//!
//! Every packet ends in a keyed tag ([`TeamKey`]). Nothing of a packet is believed before its tag has been found right;
//! numbers that were taken in before are not taken in again, so a recorded packet does no harm when it is played back.
//! The numbers of a robot must not start again at 0 under the same key: a robot that has lost its state begins a new
//! epoch, and its partners forget what they knew of it.

mod incoming;
mod packet;
mod refusal;
mod status;

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

pub use packet::{Packet, PacketKind, TAG_BYTES, TeamKey, VERSION};
pub use refusal::{Refusal, RefusalCounts};

use crate::error::Error;
use crate::keyframe::RobotId;
use crate::link::Outgoing;
use incoming::Incoming;
use packet::OVERHEAD_BYTES;
use status::{Status, Want};

/// How a robot speaks.
#[derive(Debug, Clone, PartialEq)]
pub struct TransportParams {
    /// Longest packet in bytes, tag included. Default 512: 66 ms at the rate of the published system's modem.
    pub mtu: usize,
    /// Seconds between two statuses. Default 30: a status is some 30 bytes, and half a minute is a few keyframes.
    pub status_interval_s: f64,
    /// Seconds between two requests for what is missing, and between two repetitions of one packet. Default 4, a few
    /// turns of three robots on the channel.
    pub repair_interval_s: f64,
    /// Packets asked for in one status at most. Default 96: at the default size that fills three seconds.
    pub repair_batch: u32,
    /// Seconds after which a robot that is not heard counts as gone; nobody waits for it. Default 300.
    pub live_s: f64,
    /// The team's secret.
    pub key: TeamKey,
}

impl Default for TransportParams {
    fn default() -> Self {
        TransportParams {
            mtu: 512,
            status_interval_s: 30.0,
            repair_interval_s: 4.0,
            repair_batch: 96,
            live_s: 300.0,
            key: TeamKey::default(),
        }
    }
}

/// Another robot on the link.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Peer {
    stream: Incoming,
    /// Number of its newest status.
    status: Option<u32>,
    /// How much of each stream it has: epoch and packets in order.
    has: BTreeMap<RobotId, (u32, u32)>,
    /// When its last status came: those come from the robot itself, while anybody may repeat its other packets.
    heard_at: Option<f64>,
    heard: bool,
    /// When anything of its stream came last, whoever sent it.
    seen_at: Option<f64>,
    seen: bool,
}

/// What a packet brought.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Received {
    /// Robot whose stream it belongs to.
    pub(crate) sender: RobotId,
    /// Whether that robot has begun anew, so that all that was known of it is void.
    pub(crate) restarted: bool,
    /// Messages that are complete now.
    pub(crate) messages: Vec<Vec<u8>>,
}

/// One robot's end of the link.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Transport {
    id: RobotId,
    epoch: u32,
    /// All own packets.
    log: Vec<Vec<u8>>,
    /// Own packets and repetitions that wait for the next tick.
    #[serde(skip)]
    waiting: Vec<Outgoing>,
    peers: BTreeMap<RobotId, Peer>,
    /// Packets others have asked this robot for, by stream.
    asked: BTreeSet<(RobotId, u32)>,
    /// When packets were last repeated.
    repeated: BTreeMap<(RobotId, u32), f64>,
    statuses: u32,
    status_at: f64,
    wanted_at: f64,
    refusals: RefusalCounts,
}

impl Transport {
    pub(crate) fn new(id: RobotId, epoch: u32) -> Self {
        Transport {
            id,
            epoch,
            log: Vec::new(),
            waiting: Vec::new(),
            peers: BTreeMap::new(),
            asked: BTreeSet::new(),
            repeated: BTreeMap::new(),
            statuses: 0,
            status_at: 0.0,
            wanted_at: f64::NEG_INFINITY,
            refusals: RefusalCounts::default(),
        }
    }

    pub(crate) fn refusals(&self) -> &RefusalCounts {
        &self.refusals
    }

    /// Epoch of a robot's stream and how many packets of it have arrived in order.
    pub(crate) fn progress_of(&self, robot: RobotId) -> (u32, u32) {
        self.peers.get(&robot).map_or((0, 0), |peer| (peer.stream.epoch, peer.stream.next()))
    }

    pub(crate) fn refuse(&mut self, refusal: Refusal) {
        self.refusals.add(refusal);
    }

    /// Cuts a message into packets, which leave at the next tick.
    pub(crate) fn send(
        &mut self,
        kind: &'static str,
        message: &[u8],
        params: &TransportParams,
    ) -> Result<(), Error> {
        let room =
            params.mtu.checked_sub(OVERHEAD_BYTES).filter(|room| *room > 0).ok_or(Error::Parameter {
                name: "mtu",
                value: params.mtu as f64,
                reason: "leaves no room for a message",
            })?;
        let count = message.len().div_ceil(room);
        for (index, part) in message.chunks(room).enumerate() {
            let packet = Packet {
                sender: self.id,
                epoch: self.epoch,
                number: self.log.len() as u32,
                kind: if index + 1 == count { PacketKind::LastPart } else { PacketKind::Part },
                payload: part.to_vec(),
            };
            let bytes = packet.encode(&params.key)?;
            self.log.push(bytes.clone());
            self.waiting.push(Outgoing { kind: kind.into(), bytes });
        }
        Ok(())
    }

    /// Takes in whatever was heard. What is refused is counted.
    pub(crate) fn receive(&mut self, bytes: &[u8], params: &TransportParams) -> Option<Received> {
        let packet = match Packet::decode(bytes, &params.key) {
            Ok(packet) => packet,
            Err(refusal) => {
                self.refusals.add(refusal);
                return None;
            }
        };
        let mut received = Received { sender: packet.sender, ..Default::default() };
        if let Err(refusal) = self.take(packet, bytes, &mut received) {
            self.refusals.add(refusal);
        }
        Some(received)
    }

    fn take(&mut self, packet: Packet, bytes: &[u8], received: &mut Received) -> Result<(), Refusal> {
        let sender = packet.sender;
        if sender == self.id {
            return Err(Refusal::Own);
        }
        let known = self.peers.contains_key(&sender);
        let peer = self
            .peers
            .entry(sender)
            .or_insert_with(|| Peer { stream: Incoming::new(packet.epoch), ..Default::default() });
        if packet.epoch < peer.stream.epoch {
            return Err(Refusal::Old);
        }
        if packet.epoch > peer.stream.epoch {
            received.restarted = known;
            *peer = Peer { stream: Incoming::new(packet.epoch), ..Default::default() };
            self.asked.retain(|(of, _)| *of != sender);
            self.repeated.retain(|(of, _), _| *of != sender);
        }
        if packet.kind == PacketKind::Status {
            if peer.status.is_some_and(|newest| packet.number <= newest) {
                return Err(Refusal::Old);
            }
            let status = Status::decode(&packet.payload)?;
            peer.status = Some(packet.number);
            peer.heard = true;
            self.take_status(sender, status);
            return Ok(());
        }
        let (messages, too_long) = peer.stream.take(packet, bytes)?;
        for _ in 0..too_long {
            self.refusals.add(Refusal::Malformed);
        }
        peer.seen = true;
        received.messages = messages;
        Ok(())
    }

    fn take_status(&mut self, sender: RobotId, status: Status) {
        for &(of, epoch, count) in &status.has {
            if of == self.id {
                continue;
            }
            let peer = self
                .peers
                .entry(of)
                .or_insert_with(|| Peer { stream: Incoming::new(epoch), ..Default::default() });
            // a new epoch is believed when its own packets say so
            if epoch == peer.stream.epoch {
                peer.stream.tell(count);
            }
        }
        for want in &status.wants {
            if want.asked == self.id {
                let numbers =
                    want.ranges.iter().flat_map(|&(from, length)| from..from.saturating_add(length));
                self.asked.extend(numbers.map(|number| (want.of, number)));
            }
        }
        if let Some(peer) = self.peers.get_mut(&sender) {
            peer.has = status.has.into_iter().map(|(of, epoch, count)| (of, (epoch, count))).collect();
        }
    }

    /// What to send at time `now`: new packets, repetitions asked for, and a status when it is due.
    pub(crate) fn tick(&mut self, now: f64, params: &TransportParams) -> Result<Vec<Outgoing>, Error> {
        for peer in self.peers.values_mut() {
            peer.heard_at = if std::mem::take(&mut peer.heard) { Some(now) } else { peer.heard_at };
            peer.seen_at = if std::mem::take(&mut peer.seen) { Some(now) } else { peer.seen_at };
        }
        self.repeated.retain(|_, at| now - *at < params.repair_interval_s);
        for (of, number) in std::mem::take(&mut self.asked) {
            let bytes = if of == self.id {
                self.log.get(number as usize).map(Vec::as_slice)
            } else {
                self.peers.get(&of).and_then(|peer| peer.stream.bytes(number))
            };
            if let Some(bytes) = bytes.filter(|_| !self.repeated.contains_key(&(of, number))) {
                self.waiting.push(Outgoing { kind: "repeat".into(), bytes: bytes.to_vec() });
                self.repeated.insert((of, number), now);
            }
        }
        let wants = if now - self.wanted_at >= params.repair_interval_s {
            self.wants(now, params)
        } else {
            Vec::new()
        };
        let due = now - self.status_at >= params.status_interval_s
            && (!self.log.is_empty() || !self.peers.is_empty());
        if !wants.is_empty() || due {
            if !wants.is_empty() {
                self.wanted_at = now;
            }
            self.status_at = now;
            let bytes = self.status(wants, params)?;
            self.waiting.push(Outgoing { kind: "status".into(), bytes });
        }
        Ok(std::mem::take(&mut self.waiting))
    }

    fn status(&mut self, wants: Vec<Want>, params: &TransportParams) -> Result<Vec<u8>, Error> {
        let own = [(self.id, self.epoch, self.log.len() as u32)];
        let others = self.peers.iter().map(|(&id, peer)| (id, peer.stream.epoch, peer.stream.next()));
        let status = Status { has: own.into_iter().chain(others).collect(), wants };
        let packet = Packet {
            sender: self.id,
            epoch: self.epoch,
            number: self.statuses,
            kind: PacketKind::Status,
            payload: status.encode(params.mtu.saturating_sub(OVERHEAD_BYTES))?,
        };
        self.statuses += 1;
        Ok(packet.encode(&params.key)?)
    }

    /// What is missing and whom to ask for it.
    fn wants(&self, now: f64, params: &TransportParams) -> Vec<Want> {
        let mut left = params.repair_batch;
        let mut wants = Vec::new();
        for (&of, peer) in &self.peers {
            let ranges = peer.stream.missing(left);
            if let Some(asked) = self.source(of, now, params).filter(|_| !ranges.is_empty()) {
                left -= ranges.iter().map(|range| range.1).sum::<u32>();
                wants.push(Want { of, asked, ranges });
            }
        }
        wants
    }

    /// Who can be asked for the stream of `of`: its maker while it is heard, else the first robot that has more of it,
    /// else the maker, who may have been near enough for its packets if not for a status.
    fn source(&self, of: RobotId, now: f64, params: &TransportParams) -> Option<RobotId> {
        let peer = self.peers.get(&of)?;
        if is_live(peer, now, params) {
            return Some(of);
        }
        let wanted = (peer.stream.epoch, peer.stream.next());
        let has_more = |other: &&Peer| {
            other.has.get(&of).is_some_and(|(epoch, count)| *epoch == wanted.0 && *count > wanted.1)
        };
        let mut others = self.peers.iter().filter(|(_, other)| is_live(other, now, params));
        let seen = peer.seen || peer.seen_at.is_some_and(|at| now - at <= params.live_s);
        others.find(|(_, other)| has_more(other)).map(|(&id, _)| id).or(seen.then_some(of))
    }

    /// Whether nothing is waiting or missing, and every robot that is heard has all of this robot's packets.
    pub(crate) fn is_settled(&self, now: f64, params: &TransportParams) -> bool {
        let own = (self.epoch, self.log.len() as u32);
        let lacks = |peer: &Peer| is_live(peer, now, params) && peer.has.get(&self.id) != Some(&own);
        self.waiting.is_empty()
            && self.asked.is_empty()
            && self.wants(now, params).is_empty()
            && !self.peers.values().any(lacks)
    }
}

fn is_live(peer: &Peer, now: f64, params: &TransportParams) -> bool {
    peer.heard || peer.heard_at.is_some_and(|at| now - at <= params.live_s)
}

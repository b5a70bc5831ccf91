//! The acoustic modem between robots.
//!
//! [`Modem`] is a model, not a driver: it takes frames, lets them wait until the channel has carried their bits, and
//! hands them over in an order that depends on nothing but its input. It loses nothing. The channel is shared in equal
//! time slots, so a robot's share is the bit rate divided by the number of robots; a broadcast is sent once and heard
//! by all.

use std::collections::{BTreeMap, VecDeque};

use crate::keyframe::RobotId;
use crate::message::BROADCAST;

/// What the modem can do.
#[derive(Debug, Clone, PartialEq)]
pub struct ModemParams {
    /// Bits per second of the whole channel. Default 62 500, the class of the acoustic modem of the published system.
    pub rate_bps: f64,
}

impl Default for ModemParams {
    fn default() -> Self {
        ModemParams { rate_bps: 62_500.0 }
    }
}

/// A frame to be sent, with what the accounting needs to know about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Outgoing {
    /// Receiver, or [`BROADCAST`].
    pub receiver: RobotId,
    /// Name of the message type, for the traffic table.
    pub kind: &'static str,
    /// The encoded frame.
    pub bytes: Vec<u8>,
}

/// A frame that has arrived.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivery {
    /// Seconds from the start of the mission when its last bit arrived.
    pub time: f64,
    /// Robot that gets it.
    pub receiver: RobotId,
    /// The encoded frame.
    pub bytes: Vec<u8>,
}

/// One frame that crossed the channel, for the record.
#[derive(Debug, Clone, PartialEq)]
pub struct Transmission {
    /// Seconds from the start of the mission when its last bit was sent.
    pub time: f64,
    /// Robot that sent it.
    pub sender: RobotId,
    /// Name of the message type.
    pub kind: &'static str,
    /// Bits on the channel.
    pub bits: u64,
}

struct Queue {
    frames: VecDeque<Outgoing>,
    /// When the frame at the front begins: the channel share is free and the frame has been handed over.
    free_at: f64,
}

/// The shared channel.
pub struct Modem {
    share_bps: f64,
    queues: BTreeMap<RobotId, Queue>,
    log: Vec<Transmission>,
}

impl Modem {
    /// A channel between `robots`.
    pub fn new(params: &ModemParams, robots: impl IntoIterator<Item = RobotId>) -> Self {
        let queue = |robot| (robot, Queue { frames: VecDeque::new(), free_at: 0.0 });
        let queues: BTreeMap<_, _> = robots.into_iter().map(queue).collect();
        Modem { share_bps: params.rate_bps / queues.len().max(1) as f64, queues, log: Vec::new() }
    }

    /// Takes a frame of `sender` at time `now`. A frame of a robot this channel does not know is dropped.
    pub fn send(&mut self, now: f64, sender: RobotId, frame: Outgoing) {
        if let Some(queue) = self.queues.get_mut(&sender) {
            if queue.frames.is_empty() {
                queue.free_at = queue.free_at.max(now);
            }
            queue.frames.push_back(frame);
        }
    }

    /// Everything that has arrived by time `now`, in order of arrival, then sender, then receiver.
    pub fn receive(&mut self, now: f64) -> Vec<Delivery> {
        let robots: Vec<RobotId> = self.queues.keys().copied().collect();
        let mut arrived = Vec::new();
        for (&sender, queue) in &mut self.queues {
            while let Some(front) = queue.frames.front() {
                let bits = front.bytes.len() as u64 * 8;
                let time = queue.free_at + bits as f64 / self.share_bps;
                if time > now {
                    break;
                }
                queue.free_at = time;
                if let Some(frame) = queue.frames.pop_front() {
                    self.log.push(Transmission { time, sender, kind: frame.kind, bits });
                    arrived.push((time, sender, frame));
                }
            }
        }
        arrived.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut deliveries = Vec::new();
        for (time, sender, frame) in arrived {
            let hears = |r: &RobotId| *r != sender && (frame.receiver == BROADCAST || frame.receiver == *r);
            for receiver in robots.iter().copied().filter(hears) {
                deliveries.push(Delivery { time, receiver, bytes: frame.bytes.clone() });
            }
        }
        deliveries
    }

    /// Bits that still wait to be sent.
    pub fn waiting_bits(&self) -> u64 {
        self.queues.values().flat_map(|q| &q.frames).map(|f| f.bytes.len() as u64 * 8).sum()
    }

    /// Everything that crossed the channel so far; within one robot in order of time.
    pub fn log(&self) -> &[Transmission] {
        &self.log
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(receiver: RobotId, length: usize) -> Outgoing {
        Outgoing { receiver, kind: "scan", bytes: vec![0; length] }
    }

    #[test]
    fn a_frame_arrives_when_its_bits_have_been_sent() {
        let mut modem = Modem::new(&ModemParams { rate_bps: 1600.0 }, [0, 1]);
        modem.send(10.0, 0, frame(1, 100)); // 800 bits at a share of 800 bit/s: one second
        modem.send(10.0, 0, frame(1, 100));
        assert!(modem.receive(10.9).is_empty());
        assert_eq!(modem.waiting_bits(), 1600);
        let first = modem.receive(11.5);
        assert_eq!(first.len(), 1);
        assert_eq!(first[0].time, 11.0);
        assert_eq!(modem.receive(12.0)[0].time, 12.0);
        assert_eq!(modem.waiting_bits(), 0);
    }

    #[test]
    fn an_idle_channel_saves_no_bandwidth_for_later() {
        let mut modem = Modem::new(&ModemParams { rate_bps: 800.0 }, [0]);
        assert!(modem.receive(100.0).is_empty());
        modem.send(100.0, 0, frame(1, 100));
        assert!(modem.receive(100.5).is_empty());
    }

    #[test]
    fn a_broadcast_is_counted_once_and_heard_by_all_others() {
        let mut modem = Modem::new(&ModemParams::default(), [3, 4, 9]);
        modem.send(0.0, 4, frame(BROADCAST, 50));
        let receivers: Vec<_> = modem.receive(1.0).iter().map(|d| d.receiver).collect();
        assert_eq!(receivers, [3, 9]);
        assert_eq!(modem.log().iter().map(|t| t.bits).sum::<u64>(), 400);
    }
}

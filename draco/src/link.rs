//! The link between robots in one process.
//!
//! [`Modem`] is a model, not a driver. Robots take turns in time slots; in its slot a robot sends its waiting packets at
//! the full rate of the channel and everybody else listens, so nobody ever sends while it should hear. What is sent
//! arrives after the time sound needs for the distance, at those within range, unless a fault of [`Faults`] is in the
//! way. A packet sent is counted once, whoever hears it. The same calls give the same result, to the bit. [`Direct`] is no
//! modem at all, but what a network of processes that wait for each other amounts to.

mod channel;
mod direct;
mod faults;

use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::keyframe::RobotId;
use faults::Dice;

pub(crate) use channel::Channel;
pub use channel::ChannelKind;
pub use direct::Direct;
pub use faults::{Faults, Outage};

/// What the modem can do.
#[derive(Debug, Clone, PartialEq)]
pub struct ModemParams {
    /// Bits per second of the channel. Default 62 500, the class of the acoustic modem of the published system.
    pub rate_bps: f64,
    /// Seconds of one robot's turn. Default 1.
    pub slot_s: f64,
    /// Seconds at the end of a turn in which nothing is sent, so that the last packet arrives before the next turn.
    /// Default 0.34, what sound needs for the default range.
    pub guard_s: f64,
    /// Farthest two robots hear each other, metres. Default 500. Only known places can be out of range.
    pub range_m: f64,
    /// Speed of sound in water, metres a second. Default 1500.
    pub sound_speed: f64,
    /// What goes wrong. Default nothing.
    pub faults: Faults,
}

impl Default for ModemParams {
    fn default() -> Self {
        ModemParams {
            rate_bps: 62_500.0,
            slot_s: 1.0,
            guard_s: 0.34,
            range_m: 500.0,
            sound_speed: 1500.0,
            faults: Faults::default(),
        }
    }
}

impl ModemParams {
    fn check(&self, longest_packet: usize) -> Result<(), Error> {
        let seconds = longest_packet as f64 * 8.0 / self.rate_bps;
        let checks = [
            ("rate_bps", self.rate_bps, self.rate_bps > 0.0, "has to be above 0"),
            ("sound_speed", self.sound_speed, self.sound_speed > 0.0, "has to be above 0"),
            (
                "guard_s",
                self.guard_s,
                self.guard_s >= self.range_m / self.sound_speed,
                "has to be the time of sound over the range at least",
            ),
            (
                "slot_s",
                self.slot_s,
                self.slot_s >= self.guard_s + seconds,
                "is too short for the longest packet",
            ),
        ];
        match checks.into_iter().find(|(_, value, good, _)| !(*good && value.is_finite())) {
            Some((name, value, _, reason)) => Err(Error::Parameter { name, value, reason }),
            None => self.faults.check(),
        }
    }
}

/// A packet to be sent, with what the accounting needs to know about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outgoing {
    /// Name of the type of message that it is a part of, for the traffic table; `repeat` and `status` for those that
    /// are no message's first sending.
    pub kind: Cow<'static, str>,
    /// The encoded packet.
    pub bytes: Vec<u8>,
}

/// A packet that has arrived.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Delivery {
    /// Seconds from the start of the mission when its last bit arrived.
    pub time: f64,
    /// Robot that gets it.
    pub receiver: RobotId,
    /// The encoded packet.
    pub bytes: Vec<u8>,
}

/// One packet that was sent, for the record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Transmission {
    /// Seconds from the start of the mission when its last bit was sent.
    pub time: f64,
    /// Robot that sent it.
    pub sender: RobotId,
    /// Name of the type of message.
    pub kind: Cow<'static, str>,
    /// Bits on the channel.
    pub bits: u64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Queue {
    packets: VecDeque<Outgoing>,
    /// Earliest time the packet at the front can begin: the last one has been sent and this one been handed over.
    free_at: f64,
    place: Option<Point2<f64>>,
}

/// Something on its way.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Flight {
    delivery: Delivery,
    /// Place in the order of delivery; disorder moves it.
    order: f64,
}

/// The shared channel.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Modem {
    #[serde(skip)]
    params: ModemParams,
    queues: BTreeMap<RobotId, Queue>,
    flights: Vec<Flight>,
    log: Vec<Transmission>,
    /// Bits of packets that others have taken the place of before they were sent.
    replaced_bits: u64,
    dice: Dice,
}

impl Modem {
    /// A channel between `robots` that carries packets of at most `longest_packet` bytes.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a parameter out of range, such as a slot too short for the longest packet.
    pub fn new(
        params: &ModemParams,
        robots: impl IntoIterator<Item = RobotId>,
        longest_packet: usize,
    ) -> Result<Self, Error> {
        params.check(longest_packet)?;
        let queue = |robot| (robot, Queue { packets: VecDeque::new(), free_at: 0.0, place: None });
        Ok(Modem {
            params: params.clone(),
            queues: robots.into_iter().map(queue).collect(),
            flights: Vec::new(),
            log: Vec::new(),
            replaced_bits: 0,
            dice: Dice::new(params.faults.seed),
        })
    }

    /// Settings are no part of a saved state.
    pub(crate) fn set_params(&mut self, params: ModemParams) {
        self.params = params;
    }

    /// Seconds until every robot has had its turn once.
    pub fn cycle_s(&self) -> f64 {
        self.params.slot_s * self.queues.len().max(1) as f64
    }

    /// Tells where a robot is from now on, metres in a frame common to all. A robot whose place is not known is near
    /// everybody.
    pub fn place(&mut self, robot: RobotId, place: Option<Point2<f64>>) {
        if let Some(queue) = self.queues.get_mut(&robot) {
            queue.place = place;
        }
    }

    /// Takes a packet of `sender` at time `now`. A status, and a repetition of the same packet, take the place of one
    /// that still waits.
    ///
    /// # Errors
    /// [`Error::UnknownRobot`] when the channel was not made for `sender`.
    pub fn send(&mut self, now: f64, sender: RobotId, packet: Outgoing) -> Result<(), Error> {
        let queue = self.queues.get_mut(&sender).ok_or(Error::UnknownRobot { robot: sender })?;
        let replaces = |waiting: &Outgoing| match packet.kind.as_ref() {
            "status" => waiting.kind == "status",
            "repeat" => waiting.bytes == packet.bytes,
            _ => false,
        };
        if let Some(waiting) = queue.packets.iter_mut().find(|waiting| replaces(waiting)) {
            self.replaced_bits += 8 * waiting.bytes.len() as u64;
            waiting.bytes = packet.bytes;
            return Ok(());
        }
        if queue.packets.is_empty() {
            queue.free_at = queue.free_at.max(now);
        }
        queue.packets.push_back(packet);
        Ok(())
    }

    /// Everything that has arrived by time `now`, in order of arrival unless a fault disturbs it.
    pub fn receive(&mut self, now: f64) -> Vec<Delivery> {
        while let Some((sender, start)) = self.next_start().filter(|(_, start)| *start < now) {
            self.transmit(sender, start);
        }
        let (mut arrived, in_flight): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.flights).into_iter().partition(|flight| flight.delivery.time <= now);
        self.flights = in_flight;
        arrived.sort_by(|a, b| a.order.total_cmp(&b.order));
        arrived.into_iter().map(|flight| flight.delivery).collect()
    }

    /// Who sends next, and when.
    fn next_start(&self) -> Option<(RobotId, f64)> {
        let starts = self.queues.iter().enumerate().filter_map(|(turn, (&robot, queue))| {
            let front = queue.packets.front()?;
            Some((robot, self.start_in_slot(turn, queue.free_at, self.duration(front))))
        });
        starts.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
    }

    fn duration(&self, packet: &Outgoing) -> f64 {
        packet.bytes.len() as f64 * 8.0 / self.params.rate_bps
    }

    /// First time from `earliest` on at which `duration` seconds fit into the slots of the robot whose turn is `turn`.
    fn start_in_slot(&self, turn: usize, earliest: f64, duration: f64) -> f64 {
        let cycle = self.cycle_s();
        let offset = turn as f64 * self.params.slot_s;
        let round = ((earliest - offset) / cycle).floor().max(0.0);
        let (begin, end) = {
            let begin = round * cycle + offset;
            (begin, begin + self.params.slot_s - self.params.guard_s)
        };
        // a hair of tolerance, so that a packet that just fits is not put off for ever by rounding
        if earliest.max(begin) + duration <= end + 1e-9 { earliest.max(begin) } else { begin + cycle }
    }

    fn transmit(&mut self, sender: RobotId, start: f64) {
        let Some(queue) = self.queues.get_mut(&sender) else { return };
        let Some(packet) = queue.packets.pop_front() else { return };
        let bits = packet.bytes.len() as u64 * 8;
        let end = start + bits as f64 / self.params.rate_bps;
        queue.free_at = end;
        let from = queue.place;
        self.log.push(Transmission { time: end, sender, kind: packet.kind.clone(), bits });
        let faults = &self.params.faults;
        let silent = |robot: RobotId| faults.outages.iter().any(|outage| outage.silences(robot, start));
        for (&receiver, queue) in self.queues.iter().filter(|(receiver, _)| **receiver != sender) {
            // the dice fall for every receiver alike, so that one fault does not change where the others strike
            let fate = self.dice.throw(faults);
            let distance = from.zip(queue.place).map_or(0.0, |(a, b)| (a - b).norm());
            if fate.lost || distance > self.params.range_m || silent(sender) || silent(receiver) {
                continue;
            }
            let time = end + distance / self.params.sound_speed;
            let order = self.log.len() as f64 + fate.displaced;
            let delivery = Delivery { time, receiver, bytes: packet.bytes.clone() };
            if let Some(after) = fate.again_after {
                let again = Delivery { time: time + after, ..delivery.clone() };
                self.flights.push(Flight { delivery: again, order });
            }
            self.flights.push(Flight { delivery, order });
        }
    }

    /// Bits that still wait to be sent.
    pub fn waiting_bits(&self) -> u64 {
        self.queues.values().flat_map(|q| &q.packets).map(|p| p.bytes.len() as u64 * 8).sum()
    }

    /// Bits that never were sent because something newer took their place.
    pub fn replaced_bits(&self) -> u64 {
        self.replaced_bits
    }

    /// Whether nothing waits and nothing is on its way.
    pub fn is_idle(&self) -> bool {
        self.flights.is_empty() && self.queues.values().all(|queue| queue.packets.is_empty())
    }

    /// Everything sent so far, in order of time.
    pub fn log(&self) -> &[Transmission] {
        &self.log
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(length: usize) -> Outgoing {
        Outgoing { kind: "scan".into(), bytes: vec![0; length] }
    }

    fn modem(params: &ModemParams, robots: &[RobotId]) -> Modem {
        Modem::new(params, robots.iter().copied(), 200).unwrap()
    }

    /// 1600 bit/s, slots of one second of which 0.6 can be used: 120 bytes.
    fn slow() -> ModemParams {
        ModemParams { rate_bps: 1600.0, guard_s: 0.4, slot_s: 1.4, ..Default::default() }
    }

    #[test]
    fn packets_are_sent_in_the_senders_own_slots() {
        let mut modem = modem(&slow(), &[0, 1]);
        for _ in 0..3 {
            modem.send(0.1, 1, packet(100)).unwrap(); // half a second each, two fit into a slot
        }
        assert!(modem.receive(1.85).is_empty());
        let times: Vec<_> = modem.receive(10.0).iter().map(|d| d.time).collect();
        let expected = [1.9, 2.4, 4.7];
        assert!(times.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{times:?}");
        assert!(modem.is_idle());
    }

    #[test]
    fn sound_takes_its_time_and_does_not_reach_everywhere() {
        let mut modem = modem(&slow(), &[0, 1, 2, 3]);
        for (robot, x) in [(0, 0.0), (1, 300.0), (2, 501.0)] {
            modem.place(robot, Some(Point2::new(x, 0.0)));
        }
        modem.send(0.0, 0, packet(100)).unwrap();
        let heard: Vec<_> = modem.receive(2.0).iter().map(|d| (d.receiver, d.time)).collect();
        // robot 2 is too far; nobody knows where robot 3 is
        assert_eq!(heard, [(1, 0.7), (3, 0.5)]);
    }

    #[test]
    fn a_broadcast_is_counted_once_and_heard_by_all_others() {
        let mut modem = modem(&ModemParams::default(), &[3, 4, 9]);
        modem.send(0.0, 4, packet(50)).unwrap();
        let receivers: Vec<_> = modem.receive(3.0).iter().map(|d| d.receiver).collect();
        assert_eq!(receivers, [3, 9]);
        assert_eq!(modem.log().iter().map(|t| t.bits).sum::<u64>(), 400);
        assert!(matches!(modem.send(0.0, 5, packet(1)), Err(Error::UnknownRobot { robot: 5 })));
    }

    #[test]
    fn a_newer_status_takes_the_place_of_the_one_that_waits() {
        let mut modem = modem(&ModemParams::default(), &[1, 2]);
        for length in [10, 20] {
            modem.send(0.0, 1, Outgoing { kind: "status".into(), ..packet(length) }).unwrap();
            modem.send(0.0, 1, Outgoing { kind: "repeat".into(), ..packet(50) }).unwrap();
        }
        assert_eq!(modem.waiting_bits(), 8 * 70);
    }

    #[test]
    fn faults_strike_as_often_as_they_should() {
        let faults = Faults { loss: 0.3, duplication: 0.2, reordering: 0.5, ..Default::default() };
        let mut modem = modem(&ModemParams { faults, ..Default::default() }, &[1, 2]);
        for number in 0..4000_u32 {
            let bytes = number.to_le_bytes().to_vec();
            modem.send(0.0, 1, Outgoing { kind: "scan".into(), bytes }).unwrap();
        }
        let numbers: Vec<u32> = modem
            .receive(1e6)
            .iter()
            .map(|d| u32::from_le_bytes(d.bytes.clone().try_into().unwrap()))
            .collect();
        let distinct: std::collections::BTreeSet<_> = numbers.iter().collect();
        let heard = distinct.len() as f64 / 4000.0;
        let repeated = (numbers.len() - distinct.len()) as f64 / distinct.len() as f64;
        assert!((heard - 0.7).abs() < 0.03 && (repeated - 0.2).abs() < 0.03, "{heard} {repeated}");
        let backwards = numbers.windows(2).filter(|pair| pair[1] < pair[0]).count();
        assert!(backwards > 300, "{backwards}");
    }

    #[test]
    fn nobody_speaks_or_hears_in_an_outage() {
        let outage = Outage { robot: Some(2), from_s: 10.0, to_s: 20.0 };
        let faults = Faults { outages: vec![outage], ..Default::default() };
        let mut modem = modem(&ModemParams { faults, ..Default::default() }, &[1, 2, 3]);
        let mut heard = [0, 0];
        for second in 0..30 {
            modem.send(f64::from(second), 1, packet(10)).unwrap();
            modem.send(f64::from(second), 2, packet(10)).unwrap();
            for delivery in modem.receive(f64::from(second) + 1.0) {
                let cut_off = (10.0..20.4).contains(&delivery.time);
                assert!(!cut_off || delivery.receiver == 3, "{delivery:?}");
                heard[usize::from(cut_off)] += 1;
            }
        }
        assert!(heard[0] > 30 && heard[1] > 3, "{heard:?}");
        let bad = Faults { loss: 1.5, ..Default::default() };
        assert!(Modem::new(&ModemParams { faults: bad, ..Default::default() }, [1], 200).is_err());
    }
}

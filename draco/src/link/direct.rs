use serde::{Deserialize, Serialize};

use super::{Delivery, Outgoing, Transmission};
use crate::error::Error;
use crate::keyframe::RobotId;

/// A link without a modem: what robots send in one step all others hear in the next, in order of sender and then of
/// sending. Nothing is lost and nothing waits.
///
/// Robots in processes of their own that wait for each other after every step hear the same in the same order; see
/// [`network`](crate::network).
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Direct {
    robots: Vec<RobotId>,
    /// What the next step delivers.
    sent: Vec<(RobotId, Vec<u8>)>,
    log: Vec<Transmission>,
}

impl Direct {
    /// A link between `robots`.
    pub fn new(robots: impl IntoIterator<Item = RobotId>) -> Self {
        Direct { robots: robots.into_iter().collect(), ..Default::default() }
    }

    /// Takes a packet of `sender` at time `now`.
    ///
    /// # Errors
    /// [`Error::UnknownRobot`] when the link was not made for `sender`.
    pub fn send(&mut self, now: f64, sender: RobotId, packet: Outgoing) -> Result<(), Error> {
        if !self.robots.contains(&sender) {
            return Err(Error::UnknownRobot { robot: sender });
        }
        let bits = packet.bytes.len() as u64 * 8;
        self.log.push(Transmission { time: now, sender, kind: packet.kind, bits });
        self.sent.push((sender, packet.bytes));
        Ok(())
    }

    /// Everything sent since the last call.
    pub fn receive(&mut self, now: f64) -> Vec<Delivery> {
        let mut sent = std::mem::take(&mut self.sent);
        sent.sort_by_key(|(sender, _)| *sender);
        let mut deliveries = Vec::new();
        for (sender, bytes) in sent {
            let receivers = self.robots.iter().filter(|receiver| **receiver != sender);
            deliveries.extend(receivers.map(|&receiver| Delivery {
                time: now,
                receiver,
                bytes: bytes.clone(),
            }));
        }
        deliveries
    }

    /// Whether nothing is on its way.
    pub fn is_idle(&self) -> bool {
        self.sent.is_empty()
    }

    /// Everything sent so far.
    pub fn log(&self) -> &[Transmission] {
        &self.log
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_hears_what_the_last_one_sent_in_order_of_sender() {
        let mut link = Direct::new([1, 2, 5]);
        let packet = |byte| Outgoing { kind: "graph".into(), bytes: vec![byte] };
        for (sender, byte) in [(5, 0), (1, 1), (5, 2)] {
            link.send(0.0, sender, packet(byte)).unwrap();
        }
        let heard: Vec<_> = link.receive(6.0).into_iter().map(|d| (d.receiver, d.bytes[0])).collect();
        assert_eq!(heard, [(2, 1), (5, 1), (1, 0), (2, 0), (1, 2), (2, 2)]);
        assert!(link.is_idle() && link.receive(12.0).is_empty());
        assert_eq!(link.log().iter().map(|t| t.bits).sum::<u64>(), 24);
        assert!(matches!(link.send(0.0, 3, packet(1)), Err(Error::UnknownRobot { robot: 3 })));
    }
}

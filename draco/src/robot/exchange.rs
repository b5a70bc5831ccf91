//! Frames in and out.

use std::collections::{BTreeMap, BTreeSet};

use super::{Robot, WireError};
use crate::error::Error;
use crate::evaluate::Decision;
use crate::keyframe::RobotId;
use crate::link::Outgoing;
use crate::message::{BROADCAST, FactorEntry, Frame, GraphUpdate, KeyframeId, Message, ObjectEntry};

/// What has been sent, so that only news is sent again, and what waits to be sent.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    sequence: u16,
    factors: BTreeMap<(u32, u32), FactorEntry>,
    keyframes: usize,
    map_keyframes: usize,
    closures: BTreeSet<(KeyframeId, KeyframeId)>,
    /// Keyframes to ask a partner for.
    pub(super) wanted: BTreeMap<RobotId, Vec<u32>>,
    /// Keyframes that partners asked this robot for.
    asked: BTreeSet<u32>,
    /// Scans that have been sent; a broadcast reaches everyone.
    scans: BTreeSet<u32>,
}

impl Robot {
    /// Takes in a decoded frame.
    pub(super) fn take_in(&mut self, frame: Frame) -> Result<(), WireError> {
        let sender = frame.sender;
        let partner = self.partner(sender)?;
        match frame.message {
            Message::Objects(objects) => partner.objects = objects,
            Message::Cells(map) => partner.cells = Some(map),
            Message::Graph(update) => {
                partner.graph.apply(&update);
                if let Err(error) = partner.graph.solve() {
                    tracing::warn!(partner = sender, %error, "the partner's graph cannot be solved");
                }
            }
            Message::ScanRequest(keyframes) => {
                if frame.receiver == self.id {
                    let known = self.local.poses().len() as u32;
                    self.outbox.asked.extend(keyframes.into_iter().filter(|k| *k < known));
                }
            }
            Message::Scan { keyframe, points } => {
                partner.scans.insert(keyframe, points);
            }
            Message::Closures { accepted, retracted } => {
                for pair in retracted {
                    partner.closures.remove(&pair);
                }
                for entry in accepted {
                    partner.closures.insert((entry.source, entry.target), entry);
                }
            }
        }
        Ok(())
    }

    /// Everything new since the last call, as encoded frames.
    pub(super) fn frames_to_send(&mut self) -> Result<Vec<Outgoing>, Error> {
        let mut messages: Vec<(RobotId, Message)> = Vec::new();
        messages.extend(self.graph_update().map(|m| (BROADCAST, m)));
        messages.extend(self.map_messages()?.into_iter().map(|m| (BROADCAST, m)));
        for (partner, keyframes) in std::mem::take(&mut self.outbox.wanted) {
            for chunk in keyframes.chunks(self.params.exchange.scans_per_request.max(1)) {
                messages.push((partner, Message::ScanRequest(chunk.to_vec())));
            }
        }
        for keyframe in std::mem::take(&mut self.outbox.asked) {
            if self.outbox.scans.insert(keyframe) {
                let points = self.local.keyframes()[keyframe as usize].points.clone();
                messages.push((BROADCAST, Message::Scan { keyframe, points }));
            }
        }
        messages.extend(self.closure_update().map(|m| (BROADCAST, m)));
        messages.into_iter().map(|(receiver, message)| self.encode(receiver, message)).collect()
    }

    fn encode(&mut self, receiver: RobotId, message: Message) -> Result<Outgoing, Error> {
        let kind = message.kind();
        let sequence = self.outbox.sequence;
        self.outbox.sequence = sequence.wrapping_add(1);
        let bytes = Frame { sender: self.id, receiver, sequence, message }.encode()?;
        Ok(Outgoing { receiver, kind, bytes })
    }

    /// Factors that are new, have moved or are gone.
    fn graph_update(&mut self) -> Option<Message> {
        let share = self.params.exchange.resend_sigmas;
        let current: BTreeMap<_, _> = self.own_factors().into_iter().map(|f| ((f.from, f.to), f)).collect();
        let sent = &mut self.outbox.factors;
        let removed: Vec<_> = sent.keys().filter(|pair| !current.contains_key(pair)).copied().collect();
        for pair in &removed {
            sent.remove(pair);
        }
        let mut factors = Vec::new();
        for (pair, factor) in current {
            if sent.get(&pair).is_none_or(|old| has_moved(old, &factor, share)) {
                sent.insert(pair, factor.clone());
                factors.push(factor);
            }
        }
        let keyframes = self.local.poses().len();
        if factors.is_empty() && removed.is_empty() && keyframes == self.outbox.keyframes {
            return None;
        }
        self.outbox.keyframes = keyframes;
        Some(Message::Graph(GraphUpdate { keyframes: keyframes as u32, factors, removed }))
    }

    /// Cells and objects, when the map has grown enough since the last time.
    fn map_messages(&mut self) -> Result<Vec<Message>, Error> {
        let keyframes = self.local.poses().len();
        if keyframes < self.outbox.map_keyframes + self.params.exchange.map_interval {
            return Ok(Vec::new());
        }
        self.outbox.map_keyframes = keyframes;
        let cells = Message::Cells(self.cell_map());
        let objects = self.object_map()?;
        let entry = |o: &crate::objects::Object| ObjectEntry {
            id: o.id,
            centroid: o.centroid,
            length: o.length,
            breadth: o.breadth,
        };
        Ok(vec![cells, Message::Objects(objects.iter().map(entry).collect())])
    }

    /// Own closures newly accepted or withdrawn, those of a withdrawn alignment among them.
    fn closure_update(&mut self) -> Option<Message> {
        let believed: BTreeMap<_, _> =
            self.proposals.iter().filter(|(_, proposal)| proposal.decision == Decision::Accepted).collect();
        let sent = &mut self.outbox.closures;
        let retracted: Vec<_> = sent.iter().filter(|pair| !believed.contains_key(pair)).copied().collect();
        for pair in &retracted {
            sent.remove(pair);
        }
        let new = believed.into_iter().filter(|(pair, _)| sent.insert(**pair));
        let accepted: Vec<_> = new.map(|(_, proposal)| proposal.entry.clone()).collect();
        let news = !(accepted.is_empty() && retracted.is_empty());
        news.then_some(Message::Closures { accepted, retracted })
    }
}

/// Whether a factor's measurement has moved by more than `share` sigmas, or its sigmas by more than that share.
fn has_moved(old: &FactorEntry, new: &FactorEntry, share: f64) -> bool {
    let step = old.measured.inv_mul(&new.measured);
    let offset = [step.translation.x, step.translation.y, step.rotation.angle()];
    (0..3).any(|i| {
        let sigma = new.covariance[(i, i)].sqrt();
        let ratio = (old.covariance[(i, i)].sqrt() / sigma).ln().abs();
        offset[i].abs() > share * sigma || ratio > share
    })
}

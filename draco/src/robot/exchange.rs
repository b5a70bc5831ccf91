//! Messages in and out.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::maps::SentMaps;
use super::{Robot, WireError};
use crate::error::Error;
use crate::keyframe::RobotId;
use crate::message::{BROADCAST, FactorEntry, Frame, GraphUpdate, KeyframeId, MapPlace, Message};
use crate::transport::Refusal;

/// What has been sent, so that only news is sent again, and what waits to be sent.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Outbox {
    factors: BTreeMap<(u32, u32), FactorEntry>,
    keyframes: usize,
    cell_keyframes: usize,
    object_keyframes: usize,
    maps: SentMaps,
    closures: BTreeSet<(KeyframeId, KeyframeId)>,
    places: BTreeMap<RobotId, MapPlace>,
    /// Keyframes to ask a partner for.
    pub(super) wanted: BTreeMap<RobotId, Vec<u32>>,
    /// Partners whose maps have to be asked for as a whole.
    maps_wanted: BTreeSet<RobotId>,
    /// Keyframes that partners asked this robot for.
    asked: BTreeSet<u32>,
    /// Scans that have been sent; a broadcast reaches everyone.
    scans: BTreeSet<u32>,
}

impl Robot {
    /// Takes in a decoded message.
    pub(super) fn take_in(&mut self, sender: RobotId, frame: Frame) -> Result<(), WireError> {
        let is_for_me = frame.receiver == self.id;
        let partner = self.partners.entry(sender).or_default();
        match frame.message {
            Message::Objects(update) => {
                if partner.maps.take_objects(update).is_err() {
                    self.ask_for_maps(sender);
                }
            }
            Message::Cells(update) => {
                if partner.maps.take_cells(update).is_err() {
                    self.ask_for_maps(sender);
                }
            }
            Message::Graph(update) => {
                let changed = partner.graph.apply(&update);
                partner.graph_has_news |= changed;
                self.has_news |= changed;
            }
            Message::ScanRequest(keyframes) => {
                if is_for_me {
                    let known = self.local.poses().len() as u32;
                    self.outbox.asked.extend(keyframes.into_iter().filter(|k| *k < known));
                }
            }
            Message::Scan { keyframe, points } => {
                partner.scans.insert(keyframe, points);
            }
            Message::Closures { found, withdrawn } => {
                for pair in withdrawn {
                    self.has_news |= partner.closures.remove(&pair).is_some();
                }
                for entry in found {
                    partner.closures.insert((entry.source, entry.target), entry);
                    self.has_news = true;
                }
            }
            Message::Alignment { partner: other, place } => {
                self.has_news |= match place {
                    Some(place) => partner.places.insert(other, place.clone()) != Some(place),
                    None => partner.places.remove(&other).is_some(),
                };
            }
            Message::MapRequest => {
                if is_for_me {
                    self.outbox.maps.forget();
                    (self.outbox.cell_keyframes, self.outbox.object_keyframes) = (0, 0);
                }
            }
        }
        Ok(())
    }

    /// The partner's updates do not fit together, which no link can cause: its state or this one's is damaged.
    fn ask_for_maps(&mut self, id: RobotId) {
        self.transport.refuse(Refusal::Unusable);
        let maps = &mut self.partners.entry(id).or_default().maps;
        if !std::mem::replace(&mut maps.asked, true) {
            self.outbox.maps_wanted.insert(id);
        }
    }

    /// Hands everything new since the last call to the transport.
    pub(super) fn tell_news(&mut self) -> Result<(), Error> {
        let mut messages: Vec<(RobotId, Message)> = Vec::new();
        messages.extend(self.graph_update()?.map(|m| (BROADCAST, m)));
        messages.extend(self.map_messages()?.into_iter().map(|m| (BROADCAST, m)));
        let maps_wanted = std::mem::take(&mut self.outbox.maps_wanted);
        messages.extend(maps_wanted.into_iter().map(|partner| (partner, Message::MapRequest)));
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
        messages.extend(self.alignment_updates()?.into_iter().map(|m| (BROADCAST, m)));
        messages.extend(self.closure_update().map(|m| (BROADCAST, m)));
        for (receiver, message) in messages {
            let kind = message.kind();
            let bytes = Frame { receiver, message }.encode()?;
            self.transport.send(kind, &bytes, &self.params.transport)?;
        }
        Ok(())
    }

    /// Factors that are new, have moved or are gone.
    fn graph_update(&mut self) -> Result<Option<Message>, Error> {
        let share = self.params.exchange.resend_sigmas;
        let current: BTreeMap<_, _> = self.own_factors()?.into_iter().map(|f| ((f.from, f.to), f)).collect();
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
            return Ok(None);
        }
        self.outbox.keyframes = keyframes;
        Ok(Some(Message::Graph(GraphUpdate { keyframes: keyframes as u32, factors, removed })))
    }

    /// Cells and objects, each when the map has grown enough since the last time.
    fn map_messages(&mut self) -> Result<Vec<Message>, Error> {
        let exchange = self.params.exchange.clone();
        let keyframes = self.local.poses().len();
        let mut messages = Vec::new();
        if keyframes >= self.outbox.cell_keyframes + exchange.map_interval {
            self.outbox.cell_keyframes = keyframes;
            let cells = self.cell_map();
            messages.push(Message::Cells(self.outbox.maps.cell_update(&cells)));
        }
        if keyframes >= self.outbox.object_keyframes + exchange.object_interval {
            self.outbox.object_keyframes = keyframes;
            let mut objects = self.object_map()?;
            self.tracks.update(&mut objects);
            messages.extend(
                self.outbox.maps.object_update(&objects, exchange.object_resend_m).map(Message::Objects),
            );
        }
        Ok(messages)
    }

    /// Places of partners' maps that are newly believed, have moved or are no longer believed.
    fn alignment_updates(&mut self) -> Result<Vec<Message>, Error> {
        let current = self.own_places()?;
        let sent = std::mem::replace(&mut self.outbox.places, current.clone());
        let gone = sent.keys().filter(|id| !current.contains_key(id)).map(|&id| (id, None));
        let new = current.iter().filter(|(id, place)| sent.get(id) != Some(place));
        let news = gone.chain(new.map(|(&id, place)| (id, Some(place.clone()))));
        Ok(news.map(|(partner, place)| Message::Alignment { partner, place }).collect())
    }

    /// Own closures newly found under a believed alignment, and those whose alignment has been given up.
    fn closure_update(&mut self) -> Option<Message> {
        let valid: BTreeMap<_, _> =
            self.proposals.iter().filter(|((source, _), _)| self.is_aligned(source.robot)).collect();
        let sent = &mut self.outbox.closures;
        let withdrawn: Vec<_> = sent.iter().filter(|pair| !valid.contains_key(pair)).copied().collect();
        for pair in &withdrawn {
            sent.remove(pair);
        }
        let new = valid.into_iter().filter(|(pair, _)| sent.insert(**pair));
        let found: Vec<_> = new.map(|(_, proposal)| proposal.entry.clone()).collect();
        let news = !(found.is_empty() && withdrawn.is_empty());
        news.then_some(Message::Closures { found, withdrawn })
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

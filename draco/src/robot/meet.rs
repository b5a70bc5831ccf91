//! From a hypothesis of where a partner's map lies to closures that confirm or refute it: candidates, registration.

use std::collections::BTreeSet;

use nalgebra::{Isometry2, Point2};

use super::partner::{Alignment, Partner};
use super::{Proposal, Robot};
use crate::closure;
use crate::error::Error;
use crate::evaluate::{Decision, rigid_alignment};
use crate::keyframe::RobotId;
use crate::local_slam::merge;
use crate::message::{CellMap, ClosureEntry, KeyframeId};
use crate::objects::{self, Object};
use crate::transport::Refusal;

impl Robot {
    /// The persistent cells of the own map.
    pub(super) fn cell_map(&self) -> CellMap {
        objects::persistent_cells(self.local.keyframes(), self.local.poses(), &self.params.cells)
    }

    /// The objects of the own map.
    pub(super) fn object_map(&self) -> Result<Vec<Object>, Error> {
        objects::extract(self.local.keyframes(), self.local.poses(), &self.params.objects)
    }

    /// Rebuilds the maps of partners whose factors have changed.
    pub(super) fn rebuild_partners(&mut self) {
        for (&id, partner) in &mut self.partners {
            if std::mem::take(&mut partner.graph_has_news)
                && let Err(error) = partner.graph.solve()
            {
                tracing::debug!(robot = self.id, partner = id, %error, "the partner's graph cannot be solved");
                self.transport.refuse(Refusal::Unusable);
            }
        }
    }

    /// Alignment, candidates and registration with every partner. What cannot be computed with one partner's data does
    /// not keep the robot from the others.
    pub(super) fn meet_partners(&mut self, now: f64) {
        let mut partners = std::mem::take(&mut self.partners);
        for (&id, partner) in &mut partners {
            let result =
                self.align(id, partner, now).and_then(|()| self.register_candidates(id, partner, now));
            match result {
                Ok(()) => self.confirm(id, partner, now),
                Err(error) => self.give_up(id, &error, now),
            }
        }
        self.partners = partners;
    }

    pub(super) fn give_up(&mut self, id: RobotId, error: &Error, now: f64) {
        tracing::debug!(robot = self.id, partner = id, %error, "nothing can be computed with this partner's data");
        self.transport.refuse(Refusal::Unusable);
        self.tell(id, now, format!("unusable: {error}"));
    }

    /// Where a partner's map lies, by the team's estimate if it has one, else by the alignment.
    pub(super) fn own_from_partner(&self, id: RobotId, partner: &Partner) -> Option<Isometry2<f64>> {
        self.fitted(id, partner.graph.poses()).or_else(|| Some(partner.hypothesis()?.target_from_source))
    }

    /// The rigid motion that lays a local map over its robot's trajectory in the team's estimate.
    fn fitted(&self, id: RobotId, local: &[Isometry2<f64>]) -> Option<Isometry2<f64>> {
        let seen = self.team.trajectory(id)?;
        let pairs: Vec<_> =
            local.iter().zip(seen).map(|(a, b)| (a.translation.vector, b.translation.vector)).collect();
        rigid_alignment(&pairs)
    }

    /// Registers keyframe pairs that should overlap; asks for scans that are missing.
    fn register_candidates(&mut self, id: RobotId, partner: &mut Partner, now: f64) -> Result<(), Error> {
        let Some(own_from_partner) = self.own_from_partner(id, partner) else { return Ok(()) };
        self.search_under(id, partner, own_from_partner);
        let placed: Vec<_> = partner.graph.poses().iter().map(|pose| own_from_partner * pose).collect();
        let candidates = closure::candidates(self.local.poses(), &placed, &self.params.closure);
        let mut missing = BTreeSet::new();
        for candidate in candidates {
            let pair = (candidate.own, candidate.partner);
            if partner.tested.contains_key(&pair) || !self.is_mine(id, candidate.own, candidate.partner) {
                continue;
            }
            let around = self.params.closure.source_range(candidate.partner, placed.len() as u32);
            let lacking: Vec<u32> = around.clone().filter(|k| !partner.scans.contains_key(k)).collect();
            if !lacking.is_empty() {
                missing.extend(lacking);
                continue;
            }
            let frame = partner.graph.poses()[candidate.partner as usize];
            let source =
                merge(partner.scans_between(*around.start(), *around.end()), &frame, self.params.local.voxel);
            let target = self.own_submap(candidate.own);
            let start =
                self.local.poses()[candidate.own as usize].inv_mul(&placed[candidate.partner as usize]);
            // the partner's matches are as good as the own ones, as far as anybody here knows
            let turn = self.local.match_sigma_angle();
            let registered = closure::register(&target, &source, &start, &self.params.closure)?
                .map(|registered| registered.turned(&source, turn));
            partner.tested.insert(pair, registered.map(|r| r.passed));
            if let Some(registered) = registered.filter(|r| r.passed) {
                let entry = ClosureEntry {
                    source: KeyframeId { robot: id, index: candidate.partner },
                    target: KeyframeId { robot: self.id, index: candidate.own },
                    measured: registered.target_from_source,
                    covariance: registered.covariance,
                };
                let entry = entry.as_sent()?;
                let key = (entry.source, entry.target);
                self.has_news = true;
                let reason = "not judged yet".into();
                self.proposals
                    .insert(key, Proposal { entry, time: now, decision: Decision::Undecided, reason });
            }
        }
        let new: Vec<u32> = missing.into_iter().filter(|k| partner.requested.insert(*k)).collect();
        if !new.is_empty() {
            self.outbox.wanted.insert(id, new);
        }
        Ok(())
    }

    /// Forgets what was registered under another place of the partner's map than this one.
    fn search_under(&mut self, id: RobotId, partner: &mut Partner, place: Isometry2<f64>) {
        if partner.searched.is_some_and(|searched| !self.is_same_place(&searched, &place, partner)) {
            partner.tested.clear();
            self.proposals.retain(|(source, _), _| source.robot != id);
            self.has_news = true;
        }
        partner.searched = Some(place);
    }

    fn is_same_place(&self, a: &Isometry2<f64>, b: &Isometry2<f64>, partner: &Partner) -> bool {
        let middle = partner.maps.cells().map_or_else(Point2::origin, |cells| cells.middle());
        self.params.alignment.same(a, b, &middle)
    }

    /// Each keyframe pair is registered by one of its two robots: the same two scans matched twice are no second
    /// measurement.
    fn is_mine(&self, partner: RobotId, own_index: u32, partner_index: u32) -> bool {
        (own_index + partner_index).is_multiple_of(2) == (self.id < partner)
    }

    fn own_submap(&self, keyframe: u32) -> Vec<Point2<f64>> {
        let range = self.params.closure.target_range(keyframe, self.local.poses().len() as u32);
        let scans = range
            .map(|k| (self.local.poses()[k as usize], self.local.keyframes()[k as usize].points.as_slice()));
        merge(scans, &self.local.poses()[keyframe as usize], self.params.local.voxel)
    }

    /// Believes a hypothesis that registrations confirm, forgets one that they do not.
    fn confirm(&mut self, id: RobotId, partner: &mut Partner, now: f64) {
        let Alignment::Tentative(mode) = partner.alignment else { return };
        // where the team's estimate has the map elsewhere, registrations say nothing about this place
        if !partner
            .searched
            .is_some_and(|place| self.is_same_place(&place, &mode.target_from_source, partner))
        {
            return;
        }
        let tested = partner.tested.values().flatten().count();
        let passed = partner.tested.values().flatten().filter(|passed| **passed).count();
        match self.params.alignment.judge(passed, tested) {
            None => {}
            Some(true) => {
                self.has_news = true;
                self.tell(id, now, format!("aligned: {passed} of {tested} registrations passed"));
                partner.alignment = Alignment::Accepted(mode);
            }
            Some(false) => {
                self.has_news = true;
                self.tell(id, now, format!("refuted: only {passed} of {tested} registrations passed"));
                self.proposals.retain(|(source, _), _| source.robot != id);
                partner.drop_hypothesis();
            }
        }
    }
}

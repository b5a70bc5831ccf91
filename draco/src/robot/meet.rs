//! From two maps to closures: alignment, candidates, registration, choice, estimate.

use std::collections::{BTreeMap, BTreeSet};

use draco_consistency::{Closure2, MapTransform, PoseKey, Trajectories2};
use draco_registration::correlative::MapMode;
use nalgebra::{Isometry2, Point2};

use super::partner::{Alignment, Partner};
use super::{AlignmentEvent, Proposal, Robot};
use crate::alignment::{self, MapKind, ObjectMatcher, Opinion, OwnMap, Verdict, consensus};
use crate::closure;
use crate::consistency::{self, Evidence, Judgement, Method};
use crate::error::Error;
use crate::evaluate::{Decision, rigid_alignment};
use crate::keyframe::RobotId;
use crate::local_slam::merge;
use crate::message::{CellMap, ClosureEntry, KeyframeId, ObjectEntry};
use crate::objects::{self, Object};
use crate::robot_graph::RobotGraph;
use crate::transport::Refusal;
use crate::two_step::TeamEstimate;

impl Robot {
    /// The persistent cells of the own map.
    pub(super) fn cell_map(&self) -> CellMap {
        objects::persistent_cells(self.local.keyframes(), self.local.poses(), &self.params.cells)
    }

    fn own_map(&self) -> OwnMap {
        let free = objects::free_cells(self.local.keyframes(), self.local.poses(), &self.params.cells);
        OwnMap { cells: self.cell_map(), free }
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

    fn give_up(&mut self, id: RobotId, error: &Error, now: f64) {
        tracing::debug!(robot = self.id, partner = id, %error, "nothing can be computed with this partner's data");
        self.transport.refuse(Refusal::Unusable);
        self.tell(id, now, format!("unusable: {error}"));
    }

    /// Looks for the one clear way in which both maps fit, whenever either has grown: before there is a hypothesis,
    /// to find one that lasts, and after, because small maps can fit clearly and wrongly.
    fn align(&mut self, id: RobotId, partner: &mut Partner, now: f64) -> Result<(), Error> {
        let grown = self.local.poses().len() >= partner.last_attempt.0 + self.params.exchange.map_interval
            || partner.maps.cell_keyframes() > partner.last_attempt.1;
        let Some(theirs) = partner.maps.cells().filter(|_| grown) else { return Ok(()) };
        partner.last_attempt = (self.local.poses().len(), theirs.keyframes);
        let middle = theirs.middle();
        let verdict = match self.params.alignment.maps {
            MapKind::Cells => alignment::align(&self.own_map(), &theirs, &self.params.alignment)?,
            MapKind::Segments => self.align_objects(partner, ObjectMatcher::Consensus)?,
            MapKind::Objects => self.align_objects(partner, ObjectMatcher::AsCoded)?,
        };
        self.has_news = true;
        match verdict {
            Verdict::Clear(mode) => self.weigh(id, partner, mode, &middle, now),
            Verdict::Ambiguous { ratio } => {
                self.tell(id, now, format!("ambiguous: second best fit at {ratio:.2} of the best"));
                self.doubt(id, partner, Alignment::Unknown, now);
            }
            Verdict::None => {}
        }
        Ok(())
    }

    fn align_objects(&self, partner: &Partner, matcher: ObjectMatcher) -> Result<Verdict, Error> {
        let own: Vec<ObjectEntry> = self.object_map()?.iter().map(ObjectEntry::from).collect();
        let theirs: Vec<ObjectEntry> = partner.maps.objects().cloned().collect();
        alignment::align_objects(&own, &theirs, matcher)
    }

    /// What one clear fit does to the alignment held.
    fn weigh(&mut self, id: RobotId, partner: &mut Partner, mode: MapMode, middle: &Point2<f64>, now: f64) {
        let params = &self.params.alignment;
        let agrees = |held: &MapMode| params.same(&held.target_from_source, &mode.target_from_source, middle);
        match &mut partner.alignment {
            Alignment::Candidate { mode: held, streak } if agrees(held) => {
                *held = mode;
                *streak += 1;
                if *streak >= params.min_streak {
                    partner.alignment = Alignment::Tentative(mode);
                    self.tell(
                        id,
                        now,
                        format!("maps fit, score {:.2}; closures have to confirm it", mode.score),
                    );
                }
            }
            Alignment::Unknown | Alignment::Candidate { .. } => {
                partner.alignment = Alignment::Candidate { mode, streak: 1 };
            }
            Alignment::Tentative(held) | Alignment::Accepted(held) if agrees(held) => {
                *held = mode;
                partner.contradictions = 0;
            }
            Alignment::Tentative(_) | Alignment::Accepted(_) => {
                self.doubt(id, partner, Alignment::Candidate { mode, streak: 1 }, now);
            }
        }
    }

    /// An attempt that does not support the alignment held. After as many in a row as it took to believe it, the
    /// alignment and its closures are withdrawn and `instead` is what is known.
    fn doubt(&mut self, id: RobotId, partner: &mut Partner, instead: Alignment, now: f64) {
        match partner.alignment {
            Alignment::Unknown | Alignment::Candidate { .. } => partner.alignment = instead,
            Alignment::Tentative(_) | Alignment::Accepted(_) => {
                partner.contradictions += 1;
                if partner.contradictions >= self.params.alignment.min_streak {
                    self.tell(id, now, "withdrawn: the grown maps no longer fit in this one way".into());
                    self.proposals.retain(|(source, _), _| source.robot != id);
                    partner.drop_hypothesis();
                    partner.alignment = instead;
                }
            }
        }
    }

    fn tell(&mut self, partner: RobotId, time: f64, verdict: String) {
        self.events.push(AlignmentEvent { partner, time, verdict });
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

    /// Judges all closures of aligned pairs and estimates the team's poses from those believed. When that fails on what
    /// partners said, the last estimate stays.
    pub(super) fn choose_closures(&mut self, now: f64) -> Result<(), Error> {
        let own_graph = RobotGraph::from_map(self.own_factors()?, self.local.poses().to_vec());
        let entries = self.entries();
        if entries.is_empty() {
            self.accepted.clear();
            self.team = TeamEstimate::alone(self.id, self.local.poses());
            return Ok(());
        }
        let before = std::mem::take(&mut self.accepted);
        if let Err(error) = self.judge_and_estimate(&own_graph, &entries) {
            let other =
                |e: &ClosureEntry| [e.source.robot, e.target.robot].into_iter().find(|r| *r != self.id);
            let Some(partner) = entries.iter().find_map(other) else { return Err(error) };
            self.give_up(partner, &error, now);
            self.accepted = before;
        }
        Ok(())
    }

    fn judge_and_estimate(&mut self, own_graph: &RobotGraph, entries: &[ClosureEntry]) -> Result<(), Error> {
        let evidence = self.evidence(own_graph, entries)?;
        let judgement = consistency::select(self.params.method, &evidence)?;
        // Without the bias that a group shares: the factor on the registrations' covariances was measured against the truth
        // and holds it already.
        let accepted = judgement.selection.accepted.iter();
        self.accepted = accepted
            .map(|&i| ClosureEntry {
                covariance: entries[i].covariance * judgement.noise_scale,
                ..entries[i].clone()
            })
            .collect();
        self.team = self.team_problem(own_graph).solve(self.params.optimisation)?;
        self.record(entries, &judgement);
        if self.params.method == Method::Gcm && self.retract_contradicted() {
            self.team = self.team_problem(own_graph).solve(self.params.optimisation)?;
        }
        Ok(())
    }
}

impl Robot {
    /// The closures to judge: own proposals under believed alignments and what partners found, each keyframe pair
    /// once, ascending in source and target.
    fn entries(&self) -> Vec<ClosureEntry> {
        let mut entries: BTreeMap<(KeyframeId, KeyframeId), &ClosureEntry> = BTreeMap::new();
        for entry in self.agreed_closures() {
            let pair = (entry.source.min(entry.target), entry.source.max(entry.target));
            entries.entry(pair).or_insert(entry);
        }
        entries.into_values().cloned().collect()
    }

    /// Own proposals and partners' closures whose robot pairs lie as most of the team believes.
    fn agreed_closures(&self) -> Vec<&ClosureEntry> {
        let own = self.proposals.values().map(|p| &p.entry).filter(|e| self.is_aligned(e.source.robot));
        let mut by_opinion: BTreeMap<(RobotId, RobotId, RobotId), Vec<&ClosureEntry>> = BTreeMap::new();
        for entry in own {
            by_opinion.entry((self.id, entry.target.robot, entry.source.robot)).or_default().push(entry);
        }
        for (&holder, partner) in &self.partners {
            for entry in partner.closures.values().filter(|e| self.knows(e.source) && self.knows(e.target)) {
                by_opinion.entry((holder, entry.target.robot, entry.source.robot)).or_default().push(entry);
            }
        }
        let opinions: Vec<Opinion> = by_opinion
            .iter()
            .filter_map(|(&(holder, a, b), entries)| self.opinion(holder, a, b, entries))
            .collect();
        let kept = consensus(&opinions, &self.params.alignment);
        let agreed: BTreeSet<_> =
            opinions.iter().zip(kept).filter(|(_, kept)| *kept).map(|(o, _)| (o.holder, o.a, o.b)).collect();
        by_opinion
            .into_iter()
            .filter(|(key, _)| agreed.contains(key))
            .flat_map(|(_, entries)| entries)
            .collect()
    }

    /// Where a robot's closures between two maps place one in the other: the closure in the middle of all of them.
    fn opinion(&self, holder: RobotId, a: RobotId, b: RobotId, entries: &[&ClosureEntry]) -> Option<Opinion> {
        let mut implied: Vec<(Isometry2<f64>, Point2<f64>)> = Vec::new();
        for entry in entries {
            let (target, source) = (self.known_pose(entry.target)?, self.known_pose(entry.source)?);
            implied
                .push((target * entry.measured * source.inverse(), Point2::from(source.translation.vector)));
        }
        let spread = |at: usize| -> f64 {
            let (transform, middle) = &implied[at];
            implied.iter().map(|(other, _)| (other * middle - transform * middle).norm()).sum()
        };
        let medoid = (0..implied.len()).min_by(|&i, &j| spread(i).total_cmp(&spread(j)))?;
        let (a_from_b, middle) = implied[medoid];
        Some(Opinion { holder, a, b, a_from_b, middle })
    }

    fn known_pose(&self, keyframe: KeyframeId) -> Option<Isometry2<f64>> {
        let poses = match self.partners.get(&keyframe.robot) {
            Some(partner) => partner.graph.poses(),
            None if keyframe.robot == self.id => self.local.poses(),
            None => return None,
        };
        poses.get(keyframe.index as usize).copied()
    }

    pub(super) fn is_aligned(&self, partner: RobotId) -> bool {
        self.partners.get(&partner).is_some_and(|p| matches!(p.alignment, Alignment::Accepted(_)))
    }

    fn knows(&self, keyframe: KeyframeId) -> bool {
        self.known_pose(keyframe).is_some()
    }

    /// Everything the consistency test asks for.
    fn evidence(&self, own_graph: &RobotGraph, entries: &[ClosureEntry]) -> Result<Evidence, Error> {
        let mut touched: BTreeMap<RobotId, BTreeSet<u32>> = BTreeMap::new();
        for keyframe in entries.iter().flat_map(|e| [e.source, e.target]) {
            touched.entry(keyframe.robot).or_default().insert(keyframe.index);
        }
        let mut trajectories = Trajectories2::new();
        for (robot, indices) in touched {
            let graph = if robot == self.id { own_graph } else { &self.partners[&robot].graph };
            let indices: Vec<u32> = indices.into_iter().collect();
            trajectories.insert(robot, graph.trajectory(&indices)?);
        }
        let key = |k: KeyframeId| PoseKey::new(k.robot, k.index as usize);
        let closure = |e: &ClosureEntry| Closure2 {
            source: key(e.source),
            target: key(e.target),
            target_from_source: e.measured,
            covariance: e.covariance,
        };
        let transform = |source: RobotId, mode: &MapMode| MapTransform {
            source,
            target: self.id,
            target_from_source: mode.target_from_source,
            covariance: mode.covariance,
        };
        let judged = |id: RobotId| entries.iter().any(|e| e.source.robot == id && e.target.robot == self.id);
        let priors = self.partners.iter().filter_map(|(&id, p)| match &p.alignment {
            Alignment::Accepted(mode) => judged(id).then(|| transform(id, mode)),
            Alignment::Unknown | Alignment::Candidate { .. } | Alignment::Tentative(_) => None,
        });
        Ok(Evidence {
            reference: self.id,
            trajectories,
            closures: entries.iter().map(closure).collect(),
            map_transforms: priors.collect(),
        })
    }

    /// Writes the verdicts to the robot's own proposals.
    fn record(&mut self, entries: &[ClosureEntry], judgement: &Judgement) {
        let selection = &judgement.selection;
        let accepted = selection.accepted.iter().map(|&i| (i, Decision::Accepted, "consistent".to_string()));
        let rejected =
            selection.rejected.iter().map(|r| (r.closure, Decision::Rejected, r.reason.to_string()));
        let undecided =
            selection.undecided.iter().map(|r| (r.closure, Decision::Undecided, r.reason.to_string()));
        for proposal in self.proposals.values_mut() {
            proposal.decision = Decision::Undecided;
            proposal.reason = "the team does not agree on where the maps lie".into();
        }
        for (index, decision, reason) in accepted.chain(rejected).chain(undecided) {
            if let Some(proposal) = self.proposals.get_mut(&(entries[index].source, entries[index].target)) {
                proposal.decision = decision;
                proposal.reason = reason;
            }
        }
    }
}

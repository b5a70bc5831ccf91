//! From closures to the team's poses: which to believe, by the evidence of all robots, and the estimate from those.

use std::collections::{BTreeMap, BTreeSet};

use draco_consistency::{Closure2, MapTransform2, PoseKey, Trajectories2};
use nalgebra::Isometry2;

use super::Robot;
use super::partner::Alignment;
use super::witnesses::{RobotPair, considered};
use crate::alignment::{Opinion, consensus};
use crate::consistency::{self, Evidence, Judgement, Method};
use crate::error::Error;
use crate::evaluate::Decision;
use crate::keyframe::RobotId;
use crate::message::{ClosureEntry, KeyframeId, MapPlace, WireError};
use crate::placement::{Implied, medoid};
use crate::robot_graph::RobotGraph;
use crate::two_step::TeamEstimate;

impl Robot {
    /// Judges all closures of aligned pairs and estimates the team's poses from those believed. When that fails on what
    /// partners said, the last estimate stays.
    pub(super) fn choose_closures(&mut self, now: f64) -> Result<(), Error> {
        let own_graph = self.own_graph()?;
        let mut entries = self.entries();
        if self.params.method == Method::Gcm {
            self.leave_out_contradicted(&mut entries)?;
        }
        self.leave_out_unconsidered(&mut entries);
        if entries.is_empty() {
            self.accepted.clear();
            self.doubtful.clear();
            self.team = TeamEstimate::alone(self.id, self.local.poses());
            return Ok(());
        }
        let before = (std::mem::take(&mut self.accepted), std::mem::take(&mut self.doubtful));
        if let Err(error) = self.judge_and_estimate(&own_graph, &entries) {
            let other =
                |e: &ClosureEntry| [e.source.robot, e.target.robot].into_iter().find(|r| *r != self.id);
            let Some(partner) = entries.iter().find_map(other) else { return Err(error) };
            self.give_up(partner, &error, now);
            (self.accepted, self.doubtful) = before;
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

    /// Leaves out the closures of the pairs of others that are not [`considered`].
    fn leave_out_unconsidered(&self, entries: &mut Vec<ClosureEntry>) {
        let mut counts: BTreeMap<RobotPair, usize> = BTreeMap::new();
        entries.iter().for_each(|entry| *counts.entry(entry.robots()).or_default() += 1);
        let considered = considered(self.id, &counts, self.params.closure.witnesses);
        entries.retain(|entry| considered.contains(&entry.robots()));
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
        let implied = entries.iter().map(|entry| self.implied(entry)).collect::<Option<Vec<_>>>()?;
        let Implied { place: a_from_b, middle } = medoid(&implied)?;
        Some(Opinion { holder, a, b, a_from_b, middle })
    }

    /// Where a closure puts the map of its source in that of its target.
    fn implied(&self, entry: &ClosureEntry) -> Option<Implied> {
        let (target, source) = (self.known_pose(entry.target)?, self.known_pose(entry.source)?);
        Some(Implied::by(&target, &entry.measured, &source))
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
        Ok(Evidence {
            reference: self.id,
            trajectories,
            closures: entries.iter().map(closure).collect(),
            map_transforms: self.map_transforms(entries)?,
        })
    }

    /// Where this robot believes its partners' maps to lie, as it tells them.
    pub(super) fn own_places(&self) -> Result<BTreeMap<RobotId, MapPlace>, WireError> {
        let accepted = self.partners.iter().filter_map(|(&id, partner)| match &partner.alignment {
            Alignment::Accepted(mode) => Some((id, mode)),
            Alignment::Unknown | Alignment::Candidate { .. } | Alignment::Tentative(_) => None,
        });
        accepted
            .map(|(id, mode)| {
                let (sender_from_other, covariance) = (mode.target_from_source, mode.covariance);
                Ok((id, MapPlace { sender_from_other, covariance }.as_sent()?))
            })
            .collect()
    }

    /// Where the maps that closures join lie, as the robots believe from comparing maps.
    ///
    /// `gcm` judges by what any robot believes, so that all judge alike; the tests of the published system by what this robot
    /// does.
    fn map_transforms(&self, entries: &[ClosureEntry]) -> Result<Vec<MapTransform2>, WireError> {
        let own = self.own_places()?;
        // both robots of a pair compare the same two maps: that is one piece of evidence
        let of_pair = |(a, b): (RobotId, RobotId)| match self.params.method {
            Method::Gcm => self.told_place(&own, a, b).or_else(|| self.told_place(&own, b, a)),
            _ if a == self.id => self.told_place(&own, a, b),
            _ if b == self.id => self.told_place(&own, b, a),
            _ => None,
        };
        let pairs: BTreeSet<_> = entries.iter().map(ClosureEntry::robots).collect();
        Ok(pairs.into_iter().filter_map(of_pair).collect())
    }

    /// Where `holder` believes the map of `other` to lie.
    ///
    /// * `own` – this robot's places.
    fn told_place(
        &self,
        own: &BTreeMap<RobotId, MapPlace>,
        holder: RobotId,
        other: RobotId,
    ) -> Option<MapTransform2> {
        let partner = self.partners.get(&holder).map(|partner| &partner.places);
        let place = partner.or((holder == self.id).then_some(own))?.get(&other)?;
        let (target_from_source, covariance) = (place.sender_from_other, place.covariance);
        Some(MapTransform2 { source: other, target: holder, target_from_source, covariance })
    }

    /// Leaves out the closures of pairs of robots of which one believes the maps to lie elsewhere than the closure in the
    /// middle of them puts them. One of the two is an alias, and neither counts until the robot has changed its mind.
    fn leave_out_contradicted(&self, entries: &mut Vec<ClosureEntry>) -> Result<(), WireError> {
        let own = self.own_places()?;
        let mut implied: BTreeMap<(RobotId, RobotId), Vec<Implied>> = BTreeMap::new();
        for entry in entries.iter() {
            let Some(place) = self.implied(entry) else { continue };
            let place = if entry.robots().0 == entry.target.robot { place } else { place.reversed() };
            implied.entry(entry.robots()).or_default().push(place);
        }
        let contradicted = |(&(a, b), implied): (&(RobotId, RobotId), &Vec<Implied>)| {
            let closures = medoid(implied)?;
            let same = |place| self.params.alignment.same(&place, &closures.place, &closures.middle);
            let mine = self.told_place(&own, a, b).map(|t| t.target_from_source);
            let theirs = self.told_place(&own, b, a).map(|t| t.target_from_source.inverse());
            (!mine.into_iter().chain(theirs).all(same)).then_some((a, b))
        };
        let contradicted: BTreeSet<_> = implied.iter().filter_map(contradicted).collect();
        entries.retain(|entry| !contradicted.contains(&entry.robots()));
        Ok(())
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

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::message::{FactorEntry, GraphUpdate};
    use crate::robot::RobotParams;
    use crate::robot::partner::Partner;

    /// Robot 1 that has heard robots 2 and 3, whose maps both lie at its origin by 2's closures.
    fn listener(place_of_3_told_by_2: Option<f64>) -> Robot {
        let covariance = Matrix3::identity() * 0.01;
        let step =
            |from| FactorEntry { from, to: from + 1, measured: Isometry2::translation(3.0, 0.0), covariance };
        let factors: Vec<_> = (0..5).map(step).collect();
        let mut robot = Robot::new(1, RobotParams::default());
        for id in [2, 3] {
            let mut partner = Partner::default();
            let update = GraphUpdate { keyframes: 6, factors: factors.clone(), removed: vec![] };
            assert!(partner.graph.apply(&update));
            partner.graph.solve().expect("a chain");
            robot.partners.insert(id, partner);
        }
        let teller = robot.partners.get_mut(&2).expect("was put in");
        for index in 0..5 {
            let (source, target) = (KeyframeId { robot: 3, index }, KeyframeId { robot: 2, index });
            let entry = ClosureEntry { source, target, measured: Isometry2::identity(), covariance };
            teller.closures.insert((source, target), entry);
        }
        if let Some(x) = place_of_3_told_by_2 {
            let sender_from_other = Isometry2::translation(x, 0.0);
            teller.places.insert(3, MapPlace { sender_from_other, covariance });
        }
        robot
    }

    fn judged(robot: &Robot) -> (usize, Vec<f64>) {
        let mut entries = robot.entries();
        robot.leave_out_contradicted(&mut entries).expect("nothing to send");
        let transforms = robot.map_transforms(&entries).expect("nothing to send");
        (entries.len(), transforms.iter().map(|t| t.target_from_source.translation.x).collect())
    }

    #[test]
    fn a_place_told_by_a_partner_is_evidence_on_closures_of_others() {
        assert_eq!(judged(&listener(None)), (5, vec![]));
        assert_eq!(judged(&listener(Some(1.0))), (5, vec![1.0]));
    }

    #[test]
    fn closures_elsewhere_than_a_robot_believes_are_not_judged() {
        assert_eq!(judged(&listener(Some(30.0))), (0, vec![]));
    }
}

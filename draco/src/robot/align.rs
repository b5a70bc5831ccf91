//! From two maps to a hypothesis of where one lies in the other.

use draco_registration::correlative::MapMode;
use nalgebra::Point2;

use super::partner::{Alignment, Partner};
use super::{AlignmentEvent, Robot};
use crate::alignment::{self, MapKind, ObjectMatcher, OwnMap, Verdict};
use crate::error::Error;
use crate::keyframe::RobotId;
use crate::message::{CellMap, ObjectEntry};
use crate::objects;

/// One clear way in which two maps fit.
struct Fit {
    mode: MapMode,
    /// The middle of the partner's map, metres.
    middle: Point2<f64>,
    /// Whether both maps have grown since the last fit for which both had.
    both_grown: bool,
}

/// How much of the own map a version of the partner's is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Pace {
    /// Keyframes of it, from the first.
    own: usize,
    /// Whether both maps have grown since the last attempt for which both had.
    both_grown: bool,
}

impl Robot {
    /// Looks for the one clear way in which both maps fit, whenever the partner has sent a version of its map that has
    /// grown: before there is a hypothesis, to find one that lasts, and after, because small maps can fit clearly and
    /// wrongly.
    pub(super) fn align(&mut self, id: RobotId, partner: &mut Partner, now: f64) -> Result<(), Error> {
        let own = self.local.poses().len();
        // a hypothesis held is checked against all there is; of objects no older version is kept
        let is_search = partner.hypothesis().is_none() && self.params.alignment.maps == MapKind::Cells;
        let versions =
            partner.maps.take_new_cells(if is_search { self.params.alignment.min_streak } else { 1 });
        let keyframes: Vec<u32> = versions.iter().map(|cells| cells.keyframes).collect();
        let paces = if is_search {
            paces(partner.compared, own, &keyframes, self.params.exchange.map_interval)
        } else {
            whole(partner.compared, own, &keyframes, self.params.exchange.map_interval)
        };
        for (theirs, pace) in versions.iter().zip(paces) {
            if pace.both_grown {
                partner.compared = (own, theirs.keyframes);
            }
            self.attempt(id, partner, theirs, pace, now)?;
        }
        Ok(())
    }

    fn attempt(
        &mut self,
        id: RobotId,
        partner: &mut Partner,
        theirs: &CellMap,
        pace: Pace,
        now: f64,
    ) -> Result<(), Error> {
        let verdict = match self.params.alignment.maps {
            MapKind::Cells => alignment::align(&self.own_map(pace.own), theirs, &self.params.alignment)?,
            MapKind::Segments => self.align_objects(partner, ObjectMatcher::Consensus)?,
            MapKind::Objects => self.align_objects(partner, ObjectMatcher::AsCoded)?,
        };
        self.has_news = true;
        match verdict {
            Verdict::Clear(mode) => {
                let fit = Fit { mode, middle: theirs.middle(), both_grown: pace.both_grown };
                self.weigh(id, partner, &fit, now);
            }
            Verdict::Ambiguous { ratio } => {
                self.tell(id, now, format!("ambiguous: second best fit at {ratio:.2} of the best"));
                self.doubt(id, partner, Alignment::Unknown, now);
            }
            Verdict::None => {}
        }
        Ok(())
    }

    /// The own map as far as the first `keyframes` saw it.
    fn own_map(&self, keyframes: usize) -> OwnMap {
        let (seen, poses) = (&self.local.keyframes()[..keyframes], &self.local.poses()[..keyframes]);
        OwnMap {
            cells: objects::persistent_cells(seen, poses, &self.params.cells),
            free: objects::free_cells(seen, poses, &self.params.cells),
        }
    }

    fn align_objects(&self, partner: &Partner, matcher: ObjectMatcher) -> Result<Verdict, Error> {
        let own: Vec<ObjectEntry> = self.object_map()?.iter().map(ObjectEntry::from).collect();
        let theirs: Vec<ObjectEntry> = partner.maps.objects().cloned().collect();
        alignment::align_objects(&own, &theirs, matcher)
    }

    /// What one clear fit does to the alignment held.
    fn weigh(&mut self, id: RobotId, partner: &mut Partner, fit: &Fit, now: f64) {
        let params = &self.params.alignment;
        let mode = fit.mode;
        let agrees =
            |held: &MapMode| params.same(&held.target_from_source, &mode.target_from_source, &fit.middle);
        match &mut partner.alignment {
            Alignment::Candidate { mode: held, streak } if agrees(held) => {
                *held = mode;
                *streak += usize::from(fit.both_grown);
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

    pub(super) fn tell(&mut self, partner: RobotId, time: f64, verdict: String) {
        self.events.push(AlignmentEvent { partner, time, verdict });
    }
}

/// How much of the own map each new version of a partner's is compared with.
///
/// A fit is believed when it lasts while *both* maps grow: one that rests on what one map lacks lasts as long as that map
/// stays as it is, however much the other one grows. So versions that come in one burst, after an outage, are compared
/// with as much of what the own map has grown by meanwhile as each of them has of the partner's. An own map that does not
/// keep step, because its robot has come to its end, is compared as far as it had come with as many keyframes as the
/// version has.
///
/// * `compared` – keyframes of both maps at the last attempt for which both had grown.
/// * `own` – keyframes of the own map.
/// * `versions` – keyframes of the partner's map, one version after the other.
/// * `interval` – keyframes by which a map grows between two versions of it.
fn paces(compared: (usize, u32), own: usize, versions: &[u32], interval: usize) -> Vec<Pace> {
    let last = versions.last().copied().unwrap_or(0);
    let keeps_step = is_growth(compared.0, own, interval) && last > compared.1;
    let mut before = (compared.0, compared.1 as usize);
    let mut paces = Vec::new();
    for &version in versions {
        let theirs = version as usize;
        let (part, own_grown) = if keeps_step {
            let share = f64::from(version.saturating_sub(compared.1)) / f64::from(last - compared.1);
            let part = compared.0 + ((own - compared.0) as f64 * share.min(1.0)).round() as usize;
            (part, is_growth(before.0, part, interval))
        } else {
            (own.min(theirs), theirs < own)
        };
        let both_grown = own_grown && is_growth(before.1, theirs, interval);
        if both_grown {
            before = (part, theirs);
        }
        paces.push(Pace { own: part, both_grown });
    }
    paces
}

/// Each version against the whole own map.
fn whole(compared: (usize, u32), own: usize, versions: &[u32], interval: usize) -> Vec<Pace> {
    let own_grown = is_growth(compared.0, own, interval);
    let grown = |theirs: &u32| own_grown && is_growth(compared.1 as usize, *theirs as usize, interval);
    versions.iter().map(|theirs| Pace { own, both_grown: grown(theirs) }).collect()
}

/// Half an interval counts, since robots do not make their keyframes in step.
fn is_growth(from: usize, to: usize, interval: usize) -> bool {
    to >= from + interval.div_ceil(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(compared: (usize, u32), own: usize, versions: &[u32]) -> Vec<(usize, bool)> {
        paces(compared, own, versions, 5).into_iter().map(|pace| (pace.own, pace.both_grown)).collect()
    }

    #[test]
    fn a_version_is_compared_with_the_own_map_of_its_time() {
        assert_eq!(told((0, 0), 11, &[10]), [(11, true)]);
        assert_eq!(told((11, 10), 16, &[15]), [(16, true)]);
        // after an outage
        assert_eq!(told((31, 30), 61, &[40, 50, 60]), [(41, true), (51, true), (61, true)]);
    }

    #[test]
    fn growth_of_one_map_alone_does_not_count() {
        assert_eq!(told((31, 30), 32, &[35]), [(32, false)]);
        assert_eq!(told((31, 30), 61, &[30]), [(30, false)]);
        assert_eq!(told((31, 30), 33, &[40, 50]), [(33, false), (33, false)]);
        // no order to rely on in what comes over a link
        assert_eq!(told((31, 39), 32, &[60, 40]), [(32, false), (32, false)]);
        let pace = |own, both_grown| Pace { own, both_grown };
        assert_eq!(whole((31, 30), 61, &[30, 40], 5), [pace(61, false), pace(61, true)]);
        assert_eq!(whole((61, 30), 61, &[40], 5), [pace(61, false)]);
    }

    #[test]
    fn a_map_that_grows_no_more_is_compared_as_far_as_it_had_come() {
        assert_eq!(told((61, 50), 61, &[55, 60, 65, 70]), [(55, true), (60, true), (61, false), (61, false)]);
        // its last keyframes came after the last attempt
        assert_eq!(told((62, 40), 64, &[45, 50, 60]), [(45, true), (50, true), (60, true)]);
    }
}

//! What the maps of a mission cost and are good for, by the way they are sent. No mission is flown: every robot runs
//! its local SLAM, and its partners get its maps without a loss.

use rayon::prelude::*;

use crate::alignment::{AlignmentParams, ObjectMatcher, Verdict, align_objects};
use crate::error::Error;
use crate::keyframe::{MissionData, Recording};
use crate::local_slam::LocalSlam;
use crate::message::{BROADCAST, Frame, Message, ObjectEntry};
use crate::objects::{Object, ObjectTracks, extract, persistent_cells};
use crate::robot::RobotParams;
use crate::robot::maps::{ReceivedMaps, SentMaps};
use crate::simulate::{Scenario, SimulationParams, simulate};

/// Keyframes between two updates of an object map, of the ways that are compared.
pub(super) const INTERVALS: [usize; 4] = [1, 2, 3, 5];

/// Keyframes between two comparisons of object maps. Neither a divisor nor a multiple of the longer intervals, so that
/// some maps are fresh and others are not.
const MATCH_EVERY: usize = 4;

/// Bits without packet headers, summed over the robots.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct MapBits {
    /// The object map, whole, at every keyframe, as the published system does.
    pub(super) objects_whole: u64,
    /// The same as the published system counts it: 64 bits an object and 8 a map.
    pub(super) objects_published: u64,
    /// Its updates, at each of [`INTERVALS`].
    pub(super) object_updates: [u64; INTERVALS.len()],
    /// The persistent cells, whole, at every keyframe.
    pub(super) cells_whole: u64,
    /// Their updates, at the default interval.
    pub(super) cell_updates: u64,
    /// Submaps of five keyframes, two half floats a point, each once.
    pub(super) submaps: u64,
    pub(super) keyframes: u64,
    pub(super) robots: u64,
}

/// How matches of object maps came out.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Matches {
    pub(super) right: usize,
    pub(super) wrong: usize,
}

/// How often object maps were matched, and how that came out with maps of each kind.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct MatchRates {
    pub(super) attempts: usize,
    pub(super) whole: Matches,
    pub(super) updated: [Matches; INTERVALS.len()],
}

/// Costs and matches of a scenario over all `seeds`.
pub(super) fn compare(
    scenario: Scenario,
    seeds: std::ops::Range<u64>,
) -> Result<(MapBits, MatchRates), Error> {
    let missions: Vec<_> = seeds
        .into_par_iter()
        .map(|seed| {
            of_mission(&simulate(&SimulationParams { scenario, seed, ..SimulationParams::default() })?)
        })
        .collect::<Result<_, Error>>()?;
    let (mut bits, mut rates) = (MapBits::default(), MatchRates::default());
    for (more, matched) in missions {
        bits.add(&more);
        rates.add(&matched);
    }
    Ok((bits, rates))
}

impl MapBits {
    fn add(&mut self, other: &Self) {
        let sums = [
            (&mut self.objects_whole, other.objects_whole),
            (&mut self.objects_published, other.objects_published),
            (&mut self.cells_whole, other.cells_whole),
            (&mut self.cell_updates, other.cell_updates),
            (&mut self.submaps, other.submaps),
            (&mut self.keyframes, other.keyframes),
            (&mut self.robots, other.robots),
        ];
        for (sum, more) in sums.into_iter().chain(self.object_updates.iter_mut().zip(other.object_updates)) {
            *sum += more;
        }
    }
}

impl MatchRates {
    fn add(&mut self, other: &Self) {
        self.attempts += other.attempts;
        self.whole.add(&other.whole);
        self.updated.iter_mut().zip(&other.updated).for_each(|(sum, more)| sum.add(more));
    }
}

impl Matches {
    fn add(&mut self, other: &Self) {
        self.right += other.right;
        self.wrong += other.wrong;
    }

    fn count(&mut self, right: Option<bool>) {
        self.right += usize::from(right == Some(true));
        self.wrong += usize::from(right == Some(false));
    }
}

type ObjectMap = Vec<ObjectEntry>;

/// Object maps as a partner has them after each keyframe.
struct Received {
    /// Sent whole at each keyframe.
    whole: Vec<ObjectMap>,
    /// Put together from updates.
    updated: [Vec<ObjectMap>; INTERVALS.len()],
}

fn of_mission(data: &MissionData) -> Result<(MapBits, MatchRates), Error> {
    let mut bits = MapBits::default();
    let maps: Vec<Received> = data.recordings.iter().map(|r| send(r, &mut bits)).collect::<Result<_, _>>()?;
    let mut rates = MatchRates::default();
    for (own, maps_of_own) in data.recordings.iter().zip(&maps) {
        for (partner, maps_of_partner) in data.recordings.iter().zip(&maps) {
            if own.robot != partner.robot {
                match_all((own, &maps_of_own.whole), (partner, maps_of_partner), &mut rates)?;
            }
        }
    }
    Ok((bits, rates))
}

/// Compares a robot's own map, as it is, with its partner's, as it was told, from time to time.
fn match_all(
    (own, own_maps): (&Recording, &[ObjectMap]),
    (partner, partner_maps): (&Recording, &Received),
    rates: &mut MatchRates,
) -> Result<(), Error> {
    let (Some(Some(a)), Some(Some(b))) = (own.truth.first(), partner.truth.first()) else { return Ok(()) };
    let (truth, params) = (a.inv_mul(b), AlignmentParams::default());
    let count = own_maps.len().min(partner_maps.whole.len());
    for at in (MATCH_EVERY - 1..count).step_by(MATCH_EVERY) {
        let is_right = |theirs: &[ObjectEntry]| -> Result<Option<bool>, Error> {
            let sum = theirs.iter().map(|o| o.centroid.coords).sum::<nalgebra::Vector2<f64>>();
            let middle = (sum / theirs.len().max(1) as f64).into();
            Ok(match align_objects(&own_maps[at], theirs, ObjectMatcher::Consensus)? {
                Verdict::Clear(mode) => Some(params.same(&mode.target_from_source, &truth, &middle)),
                Verdict::Ambiguous { .. } | Verdict::None => None,
            })
        };
        rates.attempts += 1;
        rates.whole.count(is_right(&partner_maps.whole[at])?);
        for (matches, maps) in rates.updated.iter_mut().zip(&partner_maps.updated) {
            matches.count(is_right(&maps[at])?);
        }
    }
    Ok(())
}

/// One way to send updates of an object map: both ends of it.
#[derive(Default)]
struct Updates {
    tracks: ObjectTracks,
    sent: SentMaps,
    received: ReceivedMaps,
}

impl Updates {
    /// Sends what has changed; its bits.
    fn send(&mut self, objects: &[Object], resend_m: f64) -> Result<u64, Error> {
        let mut objects = objects.to_vec();
        self.tracks.update(&mut objects);
        let update = self.sent.object_update(&objects, resend_m);
        let Some(update) = update else { return Ok(0) };
        let bytes = encode(Message::Objects(update))?;
        // what a partner makes of the bytes
        if let Message::Objects(update) = Frame::decode(&bytes)?.message {
            let _ = self.received.take_objects(update);
        }
        Ok(8 * bytes.len() as u64)
    }
}

fn encode(message: Message) -> Result<Vec<u8>, Error> {
    Ok(Frame { receiver: BROADCAST, message }.encode()?)
}

fn size(message: Message) -> Result<u64, Error> {
    Ok(8 * encode(message)?.len() as u64)
}

fn send(recording: &Recording, bits: &mut MapBits) -> Result<Received, Error> {
    let params = RobotParams::default();
    let resend_m = params.exchange.object_resend_m;
    let mut slam = LocalSlam::new(params.local.clone());
    let mut cells_sent = SentMaps::default();
    let mut ways: [Updates; INTERVALS.len()] = Default::default();
    let mut maps = Received { whole: Vec::new(), updated: Default::default() };
    bits.robots += 1;
    for (index, keyframe) in recording.keyframes.iter().enumerate() {
        slam.add(keyframe.clone())?;
        bits.keyframes += 1;
        let cells = persistent_cells(slam.keyframes(), slam.poses(), &params.cells);
        bits.cells_whole += size(Message::Cells(SentMaps::default().cell_update(&cells)))?;
        if (index + 1) % params.exchange.map_interval == 0 {
            bits.cell_updates += size(Message::Cells(cells_sent.cell_update(&cells)))?;
        }
        let objects = extract(slam.keyframes(), slam.poses(), &params.objects)?;
        bits.objects_published += 64 * objects.len() as u64 + 8;
        if let Some(whole) = SentMaps::default().object_update(&objects, 0.0) {
            bits.objects_whole += size(Message::Objects(whole))?;
        }
        maps.whole.push(objects.iter().map(ObjectEntry::from).collect());
        for (way, interval) in INTERVALS.into_iter().enumerate() {
            if (index + 1) % interval == 0 {
                bits.object_updates[way] += ways[way].send(&objects, resend_m)?;
            }
            maps.updated[way].push(ways[way].received.objects().cloned().collect());
        }
        if index % 5 == 4 {
            bits.submaps += 32 * slam.submap(index - 4, index, index - 2).len() as u64;
        }
    }
    Ok(maps)
}

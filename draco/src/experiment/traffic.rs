use std::collections::{BTreeMap, BTreeSet};

use super::missions::{Flown, fly, plans};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::alignment::{AlignmentParams, ObjectMatcher, Verdict, align_objects};
use crate::error::Error;
use crate::keyframe::{MissionData, Recording};
use crate::local_slam::LocalSlam;
use crate::message::{BROADCAST, Frame, Message, ObjectEntry};
use crate::objects::{ObjectTracks, extract, persistent_cells};
use crate::robot::RobotParams;
use crate::robot::maps::{ReceivedMaps, SentMaps};
use crate::simulate::{Scenario, SimulationParams, simulate};

/// Bits of a ring key of the first DRACo-SLAM: sixteen bytes a keyframe.
const RING_KEY_BITS: u64 = 128;

/// Seconds over which the rate of a robot is taken.
const RATE_WINDOW_S: f64 = 30.0;

/// Keyframes between two comparisons of object maps. No divisor of the interval of updates, so that some maps are fresh and
/// others are not.
const MATCH_EVERY: usize = 3;

/// What one robot would send of its map in a mission, bits without packet headers.
#[derive(Debug, Default, Clone, Copy)]
struct MapBits {
    /// The object map, whole, at every keyframe, as the published system does.
    objects_each_step: u64,
    /// The same as the published system counts it: 64 bits an object and 8 a map.
    published_each_step: u64,
    /// Its updates at the default interval.
    object_updates: u64,
    /// The persistent cells, whole, at every keyframe.
    cells_each_step: u64,
    /// Their updates at the default interval.
    cell_updates: u64,
    /// Submaps of five keyframes, two half floats a point, each once.
    submaps: u64,
    keyframes: u64,
}

/// What crosses the link by type of message, and what it would be with other ways to send maps.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(5);
    let seeds = range.end - range.start;
    let flown = fly(&plans(&Scenario::ALL, &[()], range), settings, |(), _| {})?;
    let mut table = Table::new(["scenario", "what", "kbit a robot", "share %", "bit/s"]);
    let mut figure = Figure {
        title: format!("Bits a robot by type, mean of {seeds} seeds"),
        y: "kbit".into(),
        ..Figure::default()
    };
    let mut notes = Vec::new();
    for scenario in Scenario::ALL {
        let all: Vec<&Flown<()>> = flown.iter().filter(|f| f.plan.scenario == scenario).collect();
        let robots: usize = all.iter().map(|f| f.report.robots.len()).sum();
        let seconds: f64 = all.iter().filter_map(|f| f.report.traffic.last()).map(|t| t.time).sum();
        let mut by_kind: BTreeMap<&str, u64> = BTreeMap::new();
        for message in all.iter().flat_map(|f| &f.report.traffic) {
            *by_kind.entry(&message.kind).or_default() += message.bits;
        }
        let total: u64 = by_kind.values().sum();
        let rate = |bits: u64| bits as f64 / seconds * all.len() as f64 / robots as f64;
        let row = |what: &str, bits: u64| -> Vec<Cell> {
            let share = Cell::percent(bits as f64 / total as f64);
            let kbit = Cell::number(bits as f64 / 1000.0 / robots as f64, 1);
            vec![scenario.name().into(), what.into(), kbit, share, Cell::number(rate(bits), 0)]
        };
        let mut dots = Vec::new();
        for (&kind, &bits) in &by_kind {
            table.push(row(kind, bits));
            if !figure.categories.iter().any(|name| name == kind) {
                figure.categories.push(kind.to_owned());
            }
            let at = figure.categories.iter().position(|name| name == kind).unwrap_or(0);
            dots.push([at as f64, bits as f64 / 1000.0 / robots as f64]);
        }
        table.push(row("all", total));
        figure.dots(scenario.name(), dots);
        let busiest = all.iter().map(|f| busiest_rate(f)).fold(0.0, f64::max);
        notes.push(format!(
            "{}: at most {:.1} kbit/s of one robot over any {RATE_WINDOW_S} s; its share of three slots is 13.8 kbit/s",
            scenario.name(),
            busiest / 1000.0
        ));
        let data = simulate(&SimulationParams { scenario, ..SimulationParams::default() })?;
        let (maps, rate) = map_bits(&data)?;
        let mut row = |what: &str, bits: u64| {
            let kbit = Cell::number(bits as f64 / 1000.0 / data.recordings.len() as f64, 1);
            table.push([scenario.name().into(), what.into(), kbit]);
        };
        row("(object map whole, each step, 64 bits an object)", maps.published_each_step);
        row("(object map whole, each step)", maps.objects_each_step);
        row("(object map, updates)", maps.object_updates);
        row("(cells whole, each step)", maps.cells_each_step);
        row("(cells, updates)", maps.cell_updates);
        row("(ring keys)", maps.keyframes * RING_KEY_BITS);
        row("(submaps, f16)", maps.submaps);
        let times = |whole: u64| whole as f64 / maps.object_updates as f64;
        notes.push(format!(
            "{}: updates take {:.1} times fewer bits than whole object maps each step, {:.1} times fewer than as the \
             published system counts them, {:.1} times fewer for cells",
            scenario.name(),
            times(maps.objects_each_step),
            times(maps.published_each_step),
            maps.cells_each_step as f64 / maps.cell_updates as f64
        ));
        notes.push(format!(
            "{}: of {} matches of object maps {} are right with whole maps each step and {} with updates ({} and {} wrong, \
             the others abstain)",
            scenario.name(),
            rate.attempts,
            rate.whole,
            rate.updated,
            rate.wrong[0],
            rate.wrong[1]
        ));
    }
    Ok(Outcome { table, runs: None, figure, notes })
}

/// Largest rate of one robot over the window, bits a second.
fn busiest_rate(flown: &Flown<()>) -> f64 {
    let traffic = &flown.report.traffic;
    let robots: BTreeSet<u32> = traffic.iter().map(|t| t.robot).collect();
    let rate_at = |robot: u32, start: f64| {
        let window =
            traffic.iter().filter(|t| t.robot == robot && (start..start + RATE_WINDOW_S).contains(&t.time));
        window.map(|t| t.bits).sum::<u64>() as f64 / RATE_WINDOW_S
    };
    let end = traffic.last().map_or(0.0, |t| t.time);
    let starts = (0..=(end / 10.0) as u64).map(|k| 10.0 * k as f64);
    starts.flat_map(|start| robots.iter().map(move |&r| rate_at(r, start))).fold(0.0, f64::max)
}

/// Object maps as a partner has them at each keyframe.
#[derive(Default)]
struct ObjectMaps {
    /// Sent whole at each keyframe.
    whole: Vec<Vec<ObjectEntry>>,
    /// Put together from updates.
    updated: Vec<Vec<ObjectEntry>>,
}

/// How often object maps were matched, and how often rightly with maps of either kind.
#[derive(Default)]
struct MatchRate {
    attempts: usize,
    whole: usize,
    updated: usize,
    wrong: [usize; 2],
}

fn map_bits(data: &MissionData) -> Result<(MapBits, MatchRate), Error> {
    let mut bits = MapBits::default();
    let maps: Vec<ObjectMaps> =
        data.recordings.iter().map(|r| add_map_bits(r, &mut bits)).collect::<Result<_, _>>()?;
    let mut rate = MatchRate::default();
    for (own, maps_of_own) in data.recordings.iter().zip(&maps) {
        for (partner, maps_of_partner) in data.recordings.iter().zip(&maps) {
            if own.robot != partner.robot {
                add_match_rate((own, maps_of_own), (partner, maps_of_partner), &mut rate)?;
            }
        }
    }
    Ok((bits, rate))
}

fn add_match_rate(
    (own, own_maps): (&Recording, &ObjectMaps),
    (partner, partner_maps): (&Recording, &ObjectMaps),
    rate: &mut MatchRate,
) -> Result<(), Error> {
    let (Some(Some(a)), Some(Some(b))) = (own.truth.first(), partner.truth.first()) else { return Ok(()) };
    let (truth, params) = (a.inv_mul(b), AlignmentParams::default());
    let count = own_maps.whole.len().min(partner_maps.whole.len());
    for at in (MATCH_EVERY..count).step_by(MATCH_EVERY) {
        let whole = &own_maps.whole[at];
        let found = |theirs: &[ObjectEntry]| -> Result<Option<bool>, Error> {
            let middle = theirs.iter().map(|o| o.centroid.coords).sum::<nalgebra::Vector2<f64>>()
                / theirs.len().max(1) as f64;
            Ok(match align_objects(whole, theirs, ObjectMatcher::Consensus)? {
                Verdict::Clear(mode) => Some(params.same(&mode.target_from_source, &truth, &middle.into())),
                Verdict::Ambiguous { .. } | Verdict::None => None,
            })
        };
        let (with_whole, with_updates) = (found(&partner_maps.whole[at])?, found(&partner_maps.updated[at])?);
        rate.attempts += 1;
        rate.whole += usize::from(with_whole == Some(true));
        rate.updated += usize::from(with_updates == Some(true));
        rate.wrong[0] += usize::from(with_whole == Some(false));
        rate.wrong[1] += usize::from(with_updates == Some(false));
    }
    Ok(())
}

fn add_map_bits(recording: &Recording, bits: &mut MapBits) -> Result<ObjectMaps, Error> {
    let params = RobotParams::default();
    let encode = |message: Message| Frame { receiver: BROADCAST, message }.encode();
    let size = |message: Message| -> Result<u64, Error> { Ok(8 * encode(message)?.len() as u64) };
    let mut slam = LocalSlam::new(params.local.clone());
    let (mut tracks, mut sent, mut received) =
        (ObjectTracks::default(), SentMaps::default(), ReceivedMaps::default());
    let mut maps = ObjectMaps::default();
    for (index, keyframe) in recording.keyframes.iter().enumerate() {
        slam.add(keyframe.clone())?;
        let cells = persistent_cells(slam.keyframes(), slam.poses(), &params.cells);
        let mut objects = extract(slam.keyframes(), slam.poses(), &params.objects)?;
        bits.objects_each_step += size(Message::Objects(SentMaps::default().object_update(&objects, 0.0)))?;
        bits.published_each_step += 64 * objects.len() as u64 + 8;
        bits.cells_each_step += size(Message::Cells(SentMaps::default().cell_update(&cells)))?;
        bits.keyframes += 1;
        if (index + 1) % params.exchange.map_interval == 0 {
            tracks.update(&mut objects);
            let resend = params.exchange.object_resend_m;
            let update = encode(Message::Objects(sent.object_update(&objects, resend)))?;
            bits.object_updates += 8 * update.len() as u64;
            bits.cell_updates += size(Message::Cells(sent.cell_update(&cells)))?;
            // what a partner makes of the bytes
            if let Message::Objects(update) = Frame::decode(&update)?.message {
                let _ = received.take_objects(update);
            }
        }
        maps.whole.push(objects.iter().map(ObjectEntry::from).collect());
        maps.updated.push(received.objects().cloned().collect());
        if index % 5 == 4 {
            bits.submaps += 32 * slam.submap(index - 4, index, index - 2).len() as u64;
        }
    }
    Ok(maps)
}

use std::collections::{BTreeMap, BTreeSet};

use super::maps::{INTERVALS, compare};
use super::missions::{Flown, fly, plans};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::error::Error;
use crate::simulate::Scenario;

/// Bits of a ring key of the first DRACo-SLAM: sixteen bytes a keyframe.
const RING_KEY_BITS: u64 = 128;

/// Seconds over which the rate of a robot is taken.
const RATE_WINDOW_S: f64 = 30.0;

/// What crosses the link by type of message, and what it would be with other ways to send maps.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(5);
    let seeds = range.end - range.start;
    let flown = fly(&plans(&Scenario::ALL, &[()], range.clone()), settings, |_, _| {})?;
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
        let (maps, rates) = compare(scenario, range.clone())?;
        (settings.progress)(&format!("{}: maps compared", scenario.name()));
        let mut row = |what: &str, bits: u64| {
            let kbit = Cell::number(bits as f64 / 1000.0 / maps.robots as f64, 1);
            table.push([scenario.name().into(), what.into(), kbit]);
        };
        row("(object map whole, each step, 64 bits an object)", maps.objects_published);
        row("(object map whole, each step)", maps.objects_whole);
        for (bits, interval) in maps.object_updates.into_iter().zip(INTERVALS) {
            row(&format!("(object map, updates every {interval})"), bits);
        }
        row("(cells whole, each step)", maps.cells_whole);
        row("(cells, updates)", maps.cell_updates);
        row("(ring keys)", maps.keyframes * RING_KEY_BITS);
        row("(submaps, f16)", maps.submaps);
        notes.push(format!(
            "{}: of {} matches of object maps, whole maps each step give {} right and {} wrong, the others abstain; updates \
             of cells take {:.1} times fewer bits than whole ones",
            scenario.name(),
            rates.attempts,
            rates.whole.right,
            rates.whole.wrong,
            maps.cells_whole as f64 / maps.cell_updates as f64
        ));
        for ((bits, interval), matches) in maps.object_updates.into_iter().zip(INTERVALS).zip(rates.updated) {
            notes.push(format!(
                "{}: updates every {interval}: {} right, {} wrong, {:.1} times fewer bits than whole maps each step, {:.1} \
                 times fewer than as the published system counts them",
                scenario.name(),
                matches.right,
                matches.wrong,
                maps.objects_whole as f64 / bits as f64,
                maps.objects_published as f64 / bits as f64
            ));
        }
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

use super::missions::{Flown, fly, mean, plans, team_ate};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::error::Error;
use crate::link::{Faults, Outage};
use crate::simulate::Scenario;

/// Length of a mission over both scenarios, seconds; outages are told as shares of it.
const MISSION_S: f64 = 400.0;

fn variants() -> Vec<(&'static str, Faults)> {
    let loss = |loss| Faults { loss, ..Faults::default() };
    let outage = |from: f64, to: f64| {
        let outage = Outage { robot: None, from_s: from * MISSION_S, to_s: to * MISSION_S };
        Faults { outages: vec![outage], ..Faults::default() }
    };
    vec![
        ("none", loss(0.0)),
        ("repeated, disordered", Faults { duplication: 0.3, reordering: 0.5, ..Faults::default() }),
        ("10 % lost", loss(0.1)),
        ("30 % lost", loss(0.3)),
        ("60 % lost", loss(0.6)),
        ("outage, first half", outage(0.0, 0.5)),
        ("outage, second half", outage(0.5, 1.0)),
    ]
}

/// Missions over links with losses, disorder and outages, against the same missions over a sound link.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(10);
    let seeds = range.end - range.start;
    let variants = variants();
    let flown = fly(&plans(&Scenario::ALL, &variants, range), settings, |plan, params| {
        let (_, faults) = &plan.variant;
        params.modem.faults = Faults { seed: params.seed, ..faults.clone() };
    })?;
    let mut table = Table::new([
        "scenario",
        "fault",
        "robots m",
        "against none %",
        "worst seed %",
        "team m",
        "all merged",
        "unchanged",
        "kbit",
        "repeated %",
        "seconds after the end",
    ]);
    let names: Vec<String> = variants.iter().map(|v| v.0.to_owned()).collect();
    let mut figure = Figure {
        title: format!("Position error over a poor link, mean of {seeds} seeds"),
        y: "ATE, m".into(),
        categories: names,
        ..Figure::default()
    };
    for scenario in Scenario::ALL {
        let of = |at: usize| -> Vec<&Flown<_>> {
            flown
                .iter()
                .filter(|f| f.plan.scenario == scenario && f.plan.variant.0 == variants[at].0)
                .collect()
        };
        let ate = |f: &Flown<_>| mean(f.report.robots.iter().map(|r| r.error().map(|e| e.rmse_m)));
        let sound = of(0);
        let mut dots = Vec::new();
        for (at, (name, _)) in variants.iter().enumerate() {
            let all = of(at);
            let errors: Vec<Option<f64>> = all.iter().map(|f| ate(f)).collect();
            let ratio = |(f, s): (&&Flown<_>, &&Flown<_>)| Some(ate(f)? / ate(s)? - 1.0);
            let worst = all.iter().zip(&sound).filter_map(ratio).fold(f64::NEG_INFINITY, f64::max);
            let (here, there) = (mean(errors.iter().copied()), mean(sound.iter().map(|f| ate(f))));
            let same = |(f, s): &(&&Flown<_>, &&Flown<_>)| {
                let trajectories =
                    |f: &Flown<_>| f.report.robots.iter().map(|r| r.trajectory.clone()).collect::<Vec<_>>();
                trajectories(f) == trajectories(s) && f.report.closures == s.report.closures
            };
            let bits = |kind: Option<&str>| {
                let traffic = all.iter().flat_map(|f| &f.report.traffic);
                traffic.filter(|t| kind.is_none_or(|k| t.kind == k)).map(|t| t.bits).sum::<u64>() as f64
            };
            let after = |f: &Flown<_>| {
                let end = f.report.robots.iter().filter_map(|r| Some(r.times.last()? - r.times.first()?));
                Some(f.report.traffic.last()?.time - end.fold(0.0, f64::max))
            };
            dots.extend(here.map(|ate| [at as f64, ate]));
            table.push([
                scenario.name().into(),
                (*name).into(),
                Cell::number(here, 3),
                Cell::percent(here.zip(there).map(|(a, b)| a / b - 1.0)),
                Cell::percent(worst),
                Cell::number(mean(all.iter().map(|f| team_ate(&f.report))), 3),
                all.iter().filter(|f| f.report.merged().count() == f.report.robots.len()).count().into(),
                all.iter().zip(&sound).filter(same).count().into(),
                Cell::number(bits(None) / 1000.0 / all.len().max(1) as f64, 0),
                Cell::percent(bits(Some("repeat")) / bits(None)),
                Cell::number(mean(all.iter().map(|f| after(f))), 0),
            ]);
        }
        figure.line(scenario.name(), dots);
    }
    let notes = vec![format!(
        "{seeds} seeds of each; `unchanged` counts missions whose trajectories and closures are bit by \
                              bit those without fault"
    )];
    Ok(Outcome { table, runs: None, figure, notes })
}

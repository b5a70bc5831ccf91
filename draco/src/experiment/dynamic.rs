use rayon::prelude::*;

use super::missions::{mean, team_ate};
use super::{Cell, Figure, Outcome, Settings, Table};
use crate::error::Error;
use crate::mission::{self, MissionParams};
use crate::report::RunReport;
use crate::simulate::{Scenario, SimulationParams, simulate};

/// Vehicles crossing the site.
const MOVERS: [usize; 4] = [0, 3, 6, 12];

/// Missions among vehicles that are no robots.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let range = settings.seeds_or(5);
    let mut table =
        Table::new(["scenario", "movers", "robots m", "team m", "all merged", "precision %", "recall %"]);
    let mut figure = Figure {
        title: "Position error among moving objects".into(),
        x: "moving objects".into(),
        y: "ATE, m".into(),
        ..Figure::default()
    };
    for scenario in Scenario::ALL {
        let mut points = Vec::new();
        for movers in MOVERS {
            let reports: Vec<RunReport> = range
                .clone()
                .into_par_iter()
                .map(|seed| {
                    let data = simulate(&SimulationParams {
                        scenario,
                        seed,
                        movers,
                        ..SimulationParams::default()
                    })?;
                    mission::run(&data, &MissionParams { seed, ..MissionParams::default() }, |_| {})
                })
                .collect::<Result<_, _>>()?;
            (settings.progress)(&format!("{} with {movers} movers", scenario.name()));
            let ate = |r: &RunReport| mean(r.robots.iter().map(|robot| robot.error().map(|e| e.rmse_m)));
            let robots = mean(reports.iter().map(ate));
            points.extend(robots.map(|ate| [movers as f64, ate]));
            table.push([
                scenario.name().into(),
                movers.into(),
                Cell::number(robots, 3),
                Cell::number(mean(reports.iter().map(team_ate)), 3),
                reports.iter().filter(|r| r.merged().count() == r.robots.len()).count().into(),
                Cell::percent(mean(reports.iter().map(|r| r.summary().team.precision))),
                Cell::percent(mean(reports.iter().map(|r| r.summary().team.recall))),
            ]);
        }
        figure.line(scenario.name(), points);
    }
    Ok(Outcome { table, runs: None, figure, notes: Vec::new() })
}

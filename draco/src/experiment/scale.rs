use std::time::Instant;

use super::{Cell, Figure, Outcome, Settings, Table};
use crate::error::Error;
use crate::mission::{MissionParams, Team};
use crate::simulate::{Scenario, SimulationParams, simulate};

/// Sizes of the teams.
const TEAMS: [usize; 5] = [3, 6, 12, 25, 50];

/// Keyframes of each robot: enough for maps to be aligned.
const KEYFRAMES: usize = 24;

/// One mission for each size of team over the wreck; robots beyond the third follow the same paths from other places on
/// them.
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let mut table = Table::new([
        "robots",
        "keyframes",
        "largest team",
        "ms a step and robot",
        "ms a step, robot and neighbour",
        "kbit a robot",
        "slots: seconds behind",
        "state kB a robot",
    ]);
    let mut figure = Figure {
        title: "Cost of a step".into(),
        x: "robots".into(),
        y: "ms a step and robot".into(),
        ..Figure::default()
    };
    let mut points = Vec::new();
    for robots in TEAMS {
        let scenario = Scenario::Wreck;
        let params =
            SimulationParams { scenario, robots, keyframes: Some(KEYFRAMES), ..SimulationParams::default() };
        let data = simulate(&params)?;
        let mut team = Team::new(&data, &MissionParams::default())?;
        let start = Instant::now();
        for index in 0..KEYFRAMES {
            team.step(Some(index))?;
        }
        // the threads of all cores share the work of all robots
        let busy = start.elapsed().as_secs_f64() * rayon::current_num_threads().min(robots) as f64;
        let cost = 1000.0 * busy / (KEYFRAMES * robots) as f64;
        let bits: u64 = team.link.log().iter().map(|t| t.bits).sum();
        let behind = team.link.log().last().map_or(0.0, |t| (t.time - team.now).max(0.0));
        let waiting = team.link.waiting_bits() as f64 / 62_500.0;
        let state: usize = team.robots.iter().map(|robot| robot.save().map_or(0, |bytes| bytes.len())).sum();
        points.push([robots as f64, cost]);
        table.push([
            robots.into(),
            KEYFRAMES.into(),
            team.merged_count().into(),
            Cell::number(cost, 1),
            Cell::number(cost / (robots - 1) as f64, 2),
            Cell::number(bits as f64 / 1000.0 / robots as f64, 1),
            Cell::number(behind + waiting, 1),
            Cell::number(state as f64 / 1000.0 / robots as f64, 0),
        ]);
        (settings.progress)(&format!("{robots} robots"));
    }
    figure.line("measured", points);
    let notes = vec!["computing time on this machine; everything else is the same on any".into()];
    Ok(Outcome { table, runs: None, figure, notes })
}

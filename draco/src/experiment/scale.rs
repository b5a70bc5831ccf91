use std::collections::BTreeMap;
use std::time::Instant;

use super::{Cell, Figure, Outcome, Settings, Table};
use crate::error::Error;
use crate::mission::{MissionParams, Team};
use crate::simulate::{Scenario, SimulationParams, simulate};
use crate::two_step::Optimisation;

/// Robots and keyframes of each mission: large teams that hear each other, and smaller ones that fly until they meet.
const MISSIONS: [(usize, usize); 9] =
    [(3, 24), (6, 24), (12, 24), (25, 24), (50, 24), (3, 48), (5, 48), (8, 48), (12, 48)];

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
        "two-step ms",
        "full ms",
    ]);
    let mut figure = Figure {
        title: "Cost of a step".into(),
        x: "robots".into(),
        y: "ms a step and robot".into(),
        ..Figure::default()
    };
    let mut points: BTreeMap<usize, Vec<[f64; 2]>> = BTreeMap::new();
    for (robots, keyframes) in MISSIONS {
        let scenario = Scenario::Wreck;
        let params =
            SimulationParams { scenario, robots, keyframes: Some(keyframes), ..SimulationParams::default() };
        let data = simulate(&params)?;
        let mut team = Team::new(&data, &MissionParams::default())?;
        let start = Instant::now();
        for index in 0..keyframes {
            team.step(Some(index))?;
        }
        // the threads of all cores share the work of all robots
        let busy = start.elapsed().as_secs_f64() * rayon::current_num_threads().min(robots) as f64;
        let cost = 1000.0 * busy / (keyframes * robots) as f64;
        let bits: u64 = team.link.log().iter().map(|t| t.bits).sum();
        let behind = team.link.log().last().map_or(0.0, |t| (t.time - team.now).max(0.0));
        let waiting = team.link.waiting_bits() as f64 / 62_500.0;
        let state: usize = team.robots.iter().map(|robot| robot.save().map_or(0, |bytes| bytes.len())).sum();
        points.entry(keyframes).or_default().push([robots as f64, cost]);
        table.push([
            robots.into(),
            keyframes.into(),
            team.merged_count().into(),
            Cell::number(cost, 1),
            Cell::number(cost / (robots - 1) as f64, 2),
            Cell::number(bits as f64 / 1000.0 / robots as f64, 1),
            Cell::number(behind + waiting, 1),
            Cell::number(state as f64 / 1000.0 / robots as f64, 0),
            Cell::number(solve_ms(&team, Optimisation::TwoStep)?, 1),
            Cell::number(solve_ms(&team, Optimisation::Full)?, 1),
        ]);
        (settings.progress)(&format!("{robots} robots, {keyframes} keyframes"));
    }
    for (keyframes, points) in points {
        figure.line(format!("{keyframes} keyframes"), points);
    }
    let notes = vec!["computing time on this machine; everything else is the same on any".into()];
    Ok(Outcome { table, runs: None, figure, notes })
}

/// Milliseconds in which the robot that sees most of the team estimates it, the shortest of three; none if nobody has met.
fn solve_ms(team: &Team, optimisation: Optimisation) -> Result<Option<f64>, Error> {
    let Some(robot) = team.reference() else { return Ok(None) };
    let times = (0..3).map(|_| robot.time_of(optimisation)).collect::<Result<Vec<_>, _>>()?;
    Ok(times.into_iter().reduce(f64::min).map(|seconds| 1000.0 * seconds))
}

use std::path::{Path, PathBuf};

use super::{Cell, Figure, Outcome, Settings, Table};
use crate::dataset::read_keyframe_folder;
use crate::error::Error;
use crate::mission::{self, MissionParams};
use crate::report::RunReport;

/// Recorded missions below the data folder that can be run as they are.
const MISSIONS: [&str; 2] = ["sonar/aracati2017", "multirobot-real/intel3"];

/// Recorded missions: `--data` is one keyframe folder, or a folder that holds [`MISSIONS`].
pub(super) fn run(settings: &Settings<'_>) -> Result<Outcome, Error> {
    let Some(root) = &settings.data else {
        let path = PathBuf::from("--data");
        let source =
            std::io::Error::new(std::io::ErrorKind::InvalidInput, "names no folder of recorded data");
        return Err(Error::Io { path, source });
    };
    let folders: Vec<PathBuf> = if root.join(crate::dataset::KEYFRAMES_FILE).is_file() {
        vec![root.clone()]
    } else {
        MISSIONS.iter().map(|mission| root.join(mission)).collect()
    };
    let mut table = Table::new([
        "recording",
        "robot",
        "merged",
        "dead reckoning m",
        "alone m",
        "final m",
        "proposed",
        "accepted",
        "precision %",
        "recall %",
        "kbit",
        "kbit an accepted closure",
    ]);
    let mut figure = Figure {
        title: "Recorded missions".into(),
        y: "ATE, m".into(),
        categories: vec!["dead reckoning".into(), "alone".into(), "final".into()],
        ..Figure::default()
    };
    let mut notes = Vec::new();
    for folder in folders {
        let report = fly(&folder)?;
        (settings.progress)(&report.scenario);
        add(&report, &mut table, &mut figure);
        notes.extend(bearing(&report));
    }
    Ok(Outcome { table, runs: None, figure, notes })
}

fn fly(folder: &Path) -> Result<RunReport, Error> {
    mission::run(&read_keyframe_folder(folder)?, &MissionParams::default(), |_| {})
}

fn add(report: &RunReport, table: &mut Table, figure: &mut Figure) {
    let summary = report.summary();
    for robot in &summary.robots {
        let errors = [robot.ate_dead_reckoning_m, robot.ate_local_m, robot.ate_m];
        let points = errors.iter().enumerate().filter_map(|(at, ate)| Some([at as f64, (*ate)?]));
        figure.line(format!("{} {}", report.scenario, robot.id), points);
        let mut row: Vec<Cell> = vec![
            report.scenario.clone().into(),
            robot.id.to_string().into(),
            if robot.merged { "yes" } else { "no" }.into(),
        ];
        row.extend(errors.map(|ate| Cell::number(ate, 2)));
        row.extend([
            robot.closures.proposed.into(),
            robot.closures.accepted.into(),
            Cell::Empty,
            Cell::Empty,
        ]);
        row.push(Cell::number(robot.sent_bits.values().sum::<u64>() as f64 / 1000.0, 1));
        table.push(row);
    }
    let team = &summary.team;
    table.push([
        report.scenario.clone().into(),
        "team".into(),
        format!("{} of {}", team.merged_robots, summary.robots.len()).into(),
        Cell::Empty,
        Cell::Empty,
        Cell::number(team.ate_m, 2),
        team.closures.proposed.into(),
        team.closures.accepted.into(),
        Cell::percent(team.precision),
        Cell::percent(team.recall),
        Cell::number(team.sent_bits as f64 / 1000.0, 1),
        Cell::number(team.bits_per_accepted_closure.map(|bits| bits / 1000.0), 2),
    ]);
}

/// Whether any robot was merged into a wrong place: more than twice as far off in the team as by itself.
fn bearing(report: &RunReport) -> Option<String> {
    let truth_from_team = report.team_error()?.truth_from_estimate;
    let mut wrong = Vec::new();
    for robot in report.merged() {
        let known = robot.trajectory.iter().zip(&robot.truth);
        let squared: Vec<f64> = known
            .filter_map(|(pose, truth)| {
                let placed = (truth_from_team * pose).translation.vector;
                Some((placed - truth.as_ref()?.translation.vector).norm_squared())
            })
            .collect();
        let rmse = (squared.iter().sum::<f64>() / squared.len().max(1) as f64).sqrt();
        let alone = robot.local_error().map_or(f64::NAN, |error| error.rmse_m);
        if rmse > 2.0 * alone + 1.0 {
            wrong.push(format!("robot {} is {rmse:.1} m off in the team's frame", robot.id));
        }
    }
    (!wrong.is_empty()).then(|| format!("{}: {}", report.scenario, wrong.join(", ")))
}

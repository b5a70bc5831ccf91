//! The program `draco`: run a simulated or recorded mission and tell how it went.

#[path = "main/progress.rs"]
mod progress;
#[path = "main/robot.rs"]
mod robot;

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use draco::alignment::MapKind;
use draco::consistency::Method;
use draco::experiment::{Experiment, Settings};
use draco::keyframe::MissionData;
use draco::link::{ChannelKind, Faults};
use draco::mission::{self, MissionParams};
use draco::objects::ObjectParams;
use draco::report::RunReport;
use draco::robot::RobotParams;
use draco::simulate::{self, Scenario, SimulationParams};
use draco::two_step::Optimisation;
use draco::{dataset, report};
use indicatif::{ProgressBar, ProgressDrawTarget};
use progress::Teller;

/// Robots with imaging sonar that build one map over an acoustic modem.
#[derive(Parser)]
#[command(version, about, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run a mission: an embedded scenario, or a folder of recorded keyframes.
    Run(Run),
    /// Fly one robot of a team in a process of its own, over a network.
    Robot(robot::FlyRobot),
    /// Repeat one of the experiments behind the figures in the documentation.
    #[command(after_help = experiments())]
    Experiment(RunExperiment),
}

#[derive(Args)]
struct RunExperiment {
    /// Name of the experiment; see the list below.
    name: Experiment,

    /// Number of seeds; each experiment has its own default.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    seeds: Option<u64>,

    /// The first seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    first_seed: u64,

    /// Folder of recorded data, for the experiments that use some.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Folder for NAME.csv, NAME.json and NAME.svg; made if need be, files of these names are replaced.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// The list of experiments for the help text.
fn experiments() -> String {
    let line = |e: &Experiment| format!("  {:18} {}\n", e.name, e.question);
    "Experiments:\n".to_owned() + &Experiment::ALL.iter().map(line).collect::<String>()
}

/// What a mission is about and how its robots think.
#[derive(Args)]
struct Mission {
    /// Embedded scenario: `harbor` (default) or `wreck`.
    #[arg(conflicts_with = "data")]
    scenario: Option<String>,

    /// Folder with `keyframes.csv` and `points.csv` to run instead of a scenario.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Which closures between robots to believe: none, pcm, gcm-pooled, gcm-group or gcm.
    #[arg(long, value_name = "METHOD", default_value = "gcm")]
    consistency: Method,

    /// How the team's poses are estimated: two-step, as-coded (the published code's two steps) or full.
    #[arg(long, value_name = "WAY", default_value = "two-step")]
    optimisation: Optimisation,

    /// What of two maps is compared to find where they lie: cells, segments or objects (the published system's way).
    #[arg(long, value_name = "KIND", default_value = "cells")]
    maps: MapKind,

    /// Seed of the simulation; recorded data do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Folder for summary.json, report.html, the trajectories and the pose graph; replaced as a whole when the run
    /// has succeeded. May not exist yet, be empty, or hold an earlier result and nothing else.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
struct Run {
    #[command(flatten)]
    mission: Mission,

    /// What connects the robots: the modelled acoustic modem, or `direct`, where every step hears all of the last one.
    #[arg(long, value_name = "KIND", default_value = "modem")]
    link: ChannelKind,

    /// Share of packets that each receiver loses on the modem, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    loss: f64,

    /// File that holds the mission's state after every step. If it exists, the mission goes on from there; it is removed
    /// when the mission ends.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
}

fn main() -> ExitCode {
    let log = tracing_subscriber::fmt().with_writer(std::io::stderr).with_max_level(tracing::Level::WARN);
    // plain: what a program says is read by people and by other programs
    log.with_ansi(false).init();
    let result = match Cli::parse().command {
        Command::Run(arguments) => run(&arguments),
        Command::Robot(arguments) => robot::fly(&arguments),
        Command::Experiment(arguments) => experiment(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("draco: {}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

fn experiment(arguments: &RunExperiment) -> anyhow::Result<()> {
    if let Some(folder) = &arguments.out {
        // before hours of work, not after
        std::fs::create_dir_all(folder).with_context(|| format!("cannot write to {}", folder.display()))?;
    }
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    bar.enable_steady_tick(Duration::from_millis(200));
    let progress = |part: &str| {
        bar.set_message(part.to_owned());
        if bar.is_hidden() {
            eprintln!("{part}");
        }
    };
    let settings = Settings {
        seeds: arguments.seeds,
        first_seed: arguments.first_seed,
        data: arguments.data.clone(),
        progress: &progress,
    };
    let outcome = arguments.name.run(&settings);
    bar.finish_and_clear();
    let outcome = outcome.with_context(|| format!("experiment {}", arguments.name.name))?;
    let mut text = outcome.text();
    if let Some(folder) = &arguments.out {
        outcome.write(arguments.name.name, folder)?;
        text += &format!("Written to {}.\n", folder.display());
    }
    print(&text)
}

fn run(arguments: &Run) -> anyhow::Result<()> {
    let mission = &arguments.mission;
    mission.check_output()?;
    let data = mission.load()?;
    let faults = Faults { seed: mission.seed, loss: arguments.loss, ..Faults::default() };
    let mut params = MissionParams { seed: mission.seed, channel: arguments.link, ..Default::default() };
    params.robot = mission.robot_params();
    params.modem.faults = faults;
    let mut teller = Teller::new(mission::step_count(&data));
    let progress = |step| teller.tell(step);
    let result = match &arguments.state {
        Some(state) => mission::run_resumable(&data, &params, state, progress),
        None => mission::run(&data, &params, progress),
    };
    teller.end();
    tell(&result.with_context(|| format!("mission {}", data.name))?, mission.out.as_deref())
}

/// Prints the table of a run and writes its files.
fn tell(report: &RunReport, out: Option<&Path>) -> anyhow::Result<()> {
    let mut text = report.table();
    if let Some(folder) = out {
        report::write_run(report, folder)
            .with_context(|| format!("writing the results to {}", folder.display()))?;
        text += &format!("\nWritten to {}: open report.html for the map.\n", folder.display());
    }
    print(&text)
}

fn print(text: &str) -> anyhow::Result<()> {
    match std::io::stdout().write_all(text.as_bytes()) {
        // whoever reads the table may stop reading it
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("writing the table"),
        _ => Ok(()),
    }
}

/// An error and its causes in one line, each said once.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !line.contains(&cause) {
            line += if line.is_empty() { "" } else { ": " };
            line += &cause;
        }
    }
    line
}

impl Mission {
    fn check_output(&self) -> anyhow::Result<()> {
        self.out.as_deref().map_or(Ok(()), report::check_output_folder)?;
        Ok(())
    }

    fn load(&self) -> anyhow::Result<MissionData> {
        if let Some(folder) = &self.data {
            return Ok(dataset::read_keyframe_folder(folder)?);
        }
        let name = self.scenario.as_deref().unwrap_or("harbor");
        let scenario: Scenario = name.parse().map_err(anyhow::Error::msg)?;
        let params = SimulationParams { scenario, seed: self.seed, ..SimulationParams::default() };
        Ok(simulate::simulate(&params)?)
    }

    fn robot_params(&self) -> RobotParams {
        let mut params = RobotParams {
            method: self.consistency,
            optimisation: self.optimisation,
            ..RobotParams::default()
        };
        params.alignment.maps = self.maps;
        if self.maps == MapKind::Objects {
            params.objects = ObjectParams::published();
        }
        params
    }
}

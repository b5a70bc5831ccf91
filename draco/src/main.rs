//! The program `draco`: run a simulated or recorded mission and tell how it went.

use std::io::{ErrorKind, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::{Args, Parser, Subcommand};
use draco::consistency::Method;
use draco::keyframe::MissionData;
use draco::mission::{self, MissionParams};
use draco::simulate::{self, Scenario, SimulationParams};
use draco::two_step::Optimisation;
use draco::{dataset, report};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

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
}

#[derive(Args)]
struct Run {
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

    /// Seed of the simulation; recorded data do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Folder for summary.json, report.html, the trajectories and the pose graph; replaced as a whole when the run
    /// has succeeded. May not exist yet, be empty, or hold an earlier result and nothing else.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_max_level(tracing::Level::WARN).init();
    match Cli::parse().command {
        Command::Run(arguments) => match run(&arguments) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("draco: {}", one_line(&error));
                ExitCode::FAILURE
            }
        },
    }
}

fn run(arguments: &Run) -> anyhow::Result<()> {
    if let Some(folder) = &arguments.out {
        report::check_output_folder(folder)?;
    }
    let data = load(arguments)?;
    let mut params = MissionParams { seed: arguments.seed, ..Default::default() };
    params.robot.method = arguments.consistency;
    params.robot.optimisation = arguments.optimisation;
    let bar = progress_bar(mission::step_count(&data));
    let result = mission::run(&data, &params, |step| {
        bar.set_position(step.done);
        bar.set_message(step.message);
    });
    bar.finish_and_clear();
    let run_report = result.with_context(|| format!("mission {}", data.name))?;
    let mut text = run_report.table();
    if let Some(folder) = &arguments.out {
        report::write_run(&run_report, folder)
            .with_context(|| format!("writing the results to {}", folder.display()))?;
        text += &format!("\nWritten to {}: open report.html for the map.\n", folder.display());
    }
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

fn load(arguments: &Run) -> anyhow::Result<MissionData> {
    if let Some(folder) = &arguments.data {
        return Ok(dataset::read_keyframe_folder(folder)?);
    }
    let name = arguments.scenario.as_deref().unwrap_or("harbor");
    let Some(scenario) = Scenario::ALL.into_iter().find(|scenario| scenario.name() == name) else {
        bail!("unknown scenario '{name}': there are {}", Scenario::ALL.map(Scenario::name).join(" and "));
    };
    let params = SimulationParams { scenario, seed: arguments.seed, ..SimulationParams::default() };
    Ok(simulate::simulate(&params)?)
}

/// A bar on stderr; it shows nothing when stderr is not a terminal.
fn progress_bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
    if let Ok(style) =
        ProgressStyle::with_template("{bar:32} step {pos}/{len}, {elapsed} of {duration}  {msg}")
    {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

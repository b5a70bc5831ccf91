//! How do the rules compare on correlated outliers? Prints biased accepted / good kept / precision of each rule over
//! many seeded harbours.
//!
//! `cargo run --release -p draco-consistency --example gcm_bars -- [--trials N] [--only WORD]`
//!
//! Without arguments a short run; 200 trials for figures to quote.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use draco_consistency::simulate::{Bias, Harbor, Label, Meetings, SimulatedTeam, harbor};
use draco_consistency::{
    Closure2, Error, Gcm, GcmParams, GroupParams, MapTransform2, PcmParams, PooledParams, Selection, gcm,
    gcm_group, gcm_pooled, isotropic_covariance, pcm,
};
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

type Team = SimulatedTeam<Isometry2<f64>, 3>;

/// Counts of one rule in one cell.
#[derive(Default, Clone, Copy)]
struct Tally {
    good: usize,
    good_kept: usize,
    good_open: usize,
    biased: usize,
    biased_kept: usize,
    biased_open: usize,
    gross: usize,
    gross_kept: usize,
    time: Duration,
}

impl Tally {
    fn add(&mut self, team: &Team, selection: &Selection) {
        let open: Vec<usize> = selection.undecided.iter().map(|r| r.closure).collect();
        for (m, label) in team.labels.iter().enumerate() {
            let kept = usize::from(selection.accepts(m));
            let is_open = usize::from(open.binary_search(&m).is_ok());
            match label {
                Label::Good => {
                    self.good += 1;
                    self.good_kept += kept;
                    self.good_open += is_open;
                }
                Label::Biased => {
                    self.biased += 1;
                    self.biased_kept += kept;
                    self.biased_open += is_open;
                }
                Label::Gross | Label::Aliased => {
                    self.gross += 1;
                    self.gross_kept += kept;
                }
                Label::Slight => {}
            }
        }
    }

    fn biased_share(&self) -> f64 {
        ratio(self.biased_kept, self.biased)
    }

    fn good_share(&self) -> f64 {
        ratio(self.good_kept, self.good)
    }

    fn precision(&self) -> f64 {
        ratio(self.good_kept, self.good_kept + self.biased_kept + self.gross_kept)
    }

    fn short(&self) -> String {
        format!("{:.3}/{:.3}", self.biased_share(), self.good_share())
    }

    fn long(&self) -> String {
        format!(
            "{:.3}/{:.3}/{:.3} open {:.2}/{:.2}",
            self.biased_share(),
            self.good_share(),
            self.precision(),
            ratio(self.good_open, self.good),
            ratio(self.biased_open, self.biased),
        )
    }
}

fn ratio(a: usize, b: usize) -> f64 {
    if b == 0 { 0.0 } else { a as f64 / b as f64 }
}

/// One row of the table: a name and the harbour of each trial.
struct Cell {
    name: String,
    params: Harbor,
    ignore_prior: bool,
}

fn cell(name: impl Into<String>, params: Harbor) -> Cell {
    Cell { name: name.into(), params, ignore_prior: false }
}

/// 3 good and 6 biased closures to b, 8 good to c; with `between`, two good groups b-c.
fn fixed(sigma: f64, length: f64, between: bool) -> Harbor {
    let group = |n, biased| Some((n, biased));
    let mut meetings = vec![
        Meetings { first: 0, second: 1, groups: vec![group(3, false), group(6, true)] },
        Meetings { first: 0, second: 2, groups: vec![group(8, false)] },
    ];
    if between {
        meetings.push(Meetings { first: 1, second: 2, groups: vec![group(6, false); 2] });
    }
    Harbor {
        meetings,
        odometry: 0.1,
        prior_sigma: sigma,
        bias: Bias::Translation(length),
        gross_share: 0.0,
        ..Harbor::default()
    }
}

/// One good and two biased groups to b, two good to c.
fn majority(bias: Bias, sigma: f64, between: bool) -> Harbor {
    let group = |biased| Some((6, biased));
    let mut meetings = vec![
        Meetings { first: 0, second: 1, groups: vec![group(false), group(true), group(true)] },
        Meetings { first: 0, second: 2, groups: vec![group(false), group(false)] },
    ];
    if between {
        meetings.push(Meetings { first: 1, second: 2, groups: vec![group(false); 2] });
    }
    Harbor { meetings, prior_sigma: sigma, bias, gross_share: 0.0, ..Harbor::default() }
}

fn lone(groups: &[bool], sigma: f64) -> Harbor {
    let groups = groups.iter().map(|&biased| Some((6, biased))).collect();
    let meetings = vec![Meetings { first: 0, second: 1, groups }];
    Harbor {
        robots: 2,
        meetings,
        prior_sigma: sigma,
        bias: Bias::Translation(2.0),
        gross_share: 0.0,
        ..Harbor::default()
    }
}

fn cells() -> Vec<Cell> {
    let mut cells = Vec::new();
    let star = || Harbor::star(2, 4);
    let cyc = || Harbor::star(2, 4).with_cycles(3);
    for sigma in [0.05, 0.1, 0.3, 0.5, 1.0, 2.0] {
        cells.push(cell(format!("cyc s={sigma}"), Harbor { prior_sigma: sigma, ..cyc() }));
    }
    for sigma in [0.05, 0.3, 0.5, 1.0, 2.0] {
        cells.push(cell(format!("star s={sigma}"), Harbor { prior_sigma: sigma, ..star() }));
    }
    cells.push(Cell { name: "star, no prior".into(), params: star(), ignore_prior: true });
    for (sigma, length) in
        [(0.05, 2.0), (0.3, 2.0), (0.5, 2.0), (1.0, 2.0), (2.0, 2.0), (0.3, 1.0), (1.0, 4.0)]
    {
        cells.push(cell(format!("fixed {length} m s={sigma}"), fixed(sigma, length, false)));
    }
    for sigma in [0.5, 1.0, 2.0] {
        cells.push(cell(format!("fixed 2 m +b-c s={sigma}"), fixed(sigma, 2.0, true)));
    }
    for (name, bias) in [("2 slips", Bias::Mixed), ("2 equal slips", Bias::SharedSlip)] {
        cells.push(cell(format!("majority {name} s=0.5"), majority(bias, 0.5, false)));
        cells.push(cell(format!("majority {name} +b-c s=0.5"), majority(bias, 0.5, true)));
    }
    cells.push(cell("cyc p=0", Harbor { biased_share: 0.0, ..cyc() }));
    cells.push(cell("star p=0", Harbor { biased_share: 0.0, ..star() }));
    cells.push(cell("cyc p=0.5", Harbor { biased_share: 0.5, ..cyc() }));
    cells.push(cell("cyc all slips equal", Harbor { bias: Bias::SharedSlip, ..cyc() }));
    cells.push(cell("cyc follows prior s=1", Harbor { bias: Bias::FollowsPrior, prior_sigma: 1.0, ..cyc() }));
    for groups in [2, 6] {
        cells.push(cell(
            format!("star {groups} groups s=.5"),
            Harbor { prior_sigma: 0.5, ..Harbor::star(2, groups) },
        ));
        let cyc = Harbor::star(2, groups).with_cycles(3);
        cells.push(cell(format!("cyc {groups} groups s=.5"), Harbor { prior_sigma: 0.5, ..cyc }));
    }
    cells.push(cell("cyc odometry 50 %", Harbor { odometry: 0.5, ..cyc() }));
    cells.push(cell("cyc odometry 100 %", Harbor { odometry: 1.0, ..cyc() }));
    cells.push(cell("cyc understated 1.5x", Harbor { understated: 1.5, ..cyc() }));
    for factor in [2.0, 4.0] {
        cells.push(cell(format!("cyc drift {factor}x"), Harbor { drift_understated: factor, ..cyc() }));
    }
    cells.push(cell("cyc bent 3 deg", Harbor { bend: 0.05, ..cyc() }));
    cells.push(cell("cyc groups of 3", Harbor { group_size: (3, 3), ..cyc() }));
    cells.push(cell("cyc groups of 12", Harbor { group_size: (12, 12), ..cyc() }));
    let nothing = |name: &str, groups: &[bool]| Cell {
        name: name.into(),
        params: lone(groups, 1.0),
        ignore_prior: true,
    };
    cells.push(nothing("1 neighbour 1:1 no prior", &[false, true]));
    cells.push(nothing("1 neighbour 1 good no prior", &[false]));
    cells.push(nothing("1 neighbour 1 biased no prior", &[true]));
    cells.push(cell("1 neighbour 1:1 s=.3", lone(&[false, true], 0.3)));
    cells.push(cell("1 neighbour 1:1 s=1", lone(&[false, true], 1.0)));
    cells.push(cell("1 neighbour 1 good s=.5", lone(&[false], 0.5)));
    cells.push(cell("1 neighbour 1 biased s=.5", lone(&[true], 0.5)));
    cells
}

/// Posterior of clusters against their truth: count, sum of P, really good, by bin.
#[derive(Default, Clone, Copy)]
struct Bin {
    n: usize,
    sum: f64,
    good: usize,
}

const BIN_EDGES: [f64; 6] = [0.0, 0.25, 0.5, 0.7, 0.85, 0.95];

/// Shifts the parameters from their defaults, by name.
fn set(params: &mut GcmParams, assignment: &str) -> Option<()> {
    let (name, value) = assignment.split_once('=')?;
    let value: f64 = value.parse().ok()?;
    match name {
        "sound" => params.sound = value,
        "sound_strength" => params.sound_strength = value,
        "least_slip" => params.least_slip = value,
        "drift_most" => params.drift_most = value,
        "drift_doubt" => params.drift_doubt = value,
        "alpha" => params.alpha = value,
        "elsewhere_share" => params.elsewhere_share = value,
        "spike" => params.spike.translation = value,
        "prior_sound" => params.prior_sound = value,
        "correlation" => params.correlation = value,
        "gap" => params.gap = value,
        "extent" => params.extent = value,
        "beam" => params.beam = value as usize,
        "depth" => params.depth = value,
        "joint_limit" => params.joint_limit = value as usize,
        _ => return None,
    }
    Some(())
}

/// What a preset that accepts from `least` on accepts.
fn accepted_from(least: f64, found: &Gcm<3>) -> Selection {
    let believed = found.clusters.iter().filter(|c| c.probability >= least);
    let mut accepted: Vec<usize> = believed.flat_map(|c| c.members.iter().copied()).collect();
    accepted.sort_unstable();
    Selection { accepted, ..Selection::default() }
}

struct Options {
    trials: u64,
    only: String,
    baselines: bool,
    params: GcmParams,
}

fn run(cell: &Cell, options: &Options) -> Result<(), Error> {
    let trials = options.trials;
    let mut tallies = [Tally::default(); 7];
    let mut bins = [Bin::default(); 6];
    for seed in 0..trials {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut team: Team = harbor(&cell.params, &mut rng)?;
        let priors = team.priors.clone();
        if cell.ignore_prior {
            team.priors.clear();
        }
        if options.baselines {
            baselines(&team, &priors, &mut tallies)?;
        }
        let start = Instant::now();
        let found = gcm(&team.trajectories, &team.closures, &team.priors, &options.params)?;
        tallies[4].time += start.elapsed();
        tallies[4].add(&team, &found.selection);
        tallies[5].add(&team, &accepted_from(GcmParams::leading().accept, &found));
        tallies[6].add(&team, &accepted_from(GcmParams::strict().accept, &found));
        for cluster in &found.clusters {
            let label = team.labels[cluster.members[0]];
            if cluster.members.len() < 2 || label == Label::Slight {
                continue;
            }
            let bin = BIN_EDGES.iter().rposition(|edge| cluster.probability >= *edge).unwrap_or(0);
            bins[bin].n += 1;
            bins[bin].sum += cluster.probability;
            bins[bin].good += usize::from(label == Label::Good);
        }
    }
    let [pcm, pooled, group, votes, ours, leading, strict] = &tallies;
    println!(
        "{:<30} | {} {} {} {} | {} | {} | {} | {:.1} ms",
        cell.name,
        pcm.short(),
        pooled.short(),
        group.short(),
        votes.short(),
        ours.long(),
        leading.short(),
        strict.short(),
        ours.time.as_secs_f64() * 1e3 / trials as f64,
    );
    let calibration: Vec<String> = bins
        .iter()
        .filter(|bin| bin.n > 0)
        .map(|bin| format!("{:.2}/{:.2} ({})", bin.sum / bin.n as f64, ratio(bin.good, bin.n), bin.n))
        .collect();
    println!("{:<30} |   P/good (n): {}", "", calibration.join("  "));
    Ok(())
}

/// The rules to compare with, each with its own parameters.
fn baselines(team: &Team, priors: &[MapTransform2], tallies: &mut [Tally; 7]) -> Result<(), Error> {
    // the released program's covariance is far wider than its noise: a gate of 1.06 m, rotation never binding
    let wide = isotropic_covariance::<3, Isometry2<f64>>(0.315, 0.315);
    let released: Vec<Closure2> = team.closures.iter().map(|c| Closure2 { covariance: wide, ..*c }).collect();
    let rules: [&dyn Fn() -> Result<Selection, Error>; 4] = [
        &|| pcm(&team.trajectories, &team.closures, &PcmParams::default()),
        &|| gcm_pooled(&team.trajectories, &released, priors, &PooledParams::default()),
        &|| gcm_group(&team.trajectories, &team.closures, priors, &GroupParams::default()),
        &|| draco_consistency::gcm::one_vote(&team.trajectories, &team.closures, &GcmParams::default()),
    ];
    for (tally, rule) in tallies.iter_mut().zip(rules) {
        tally.add(team, &rule()?);
    }
    Ok(())
}

fn main() -> ExitCode {
    let mut options =
        Options { trials: 10, only: String::new(), baselines: true, params: GcmParams::default() };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let value = if argument == "--ours" { Some(String::new()) } else { arguments.next() };
        let known = match (argument.as_str(), value) {
            ("--trials", Some(value)) => value.parse().map(|n| options.trials = n).is_ok(),
            ("--only", Some(value)) => {
                options.only = value;
                true
            }
            ("--set", Some(value)) => set(&mut options.params, &value).is_some(),
            ("--ours", _) => {
                options.baselines = false;
                true
            }
            _ => false,
        };
        if !known {
            return usage();
        }
    }
    println!(
        "{:<30} | biased/good: pcm, pooled, group, one vote | ours biased/good/precision, undecided good/biased | leading | strict | time",
        format!("{} trials", options.trials)
    );
    for cell in cells().iter().filter(|c| c.name.contains(&options.only)) {
        if let Err(error) = run(cell, &options) {
            eprintln!("{}: {error}", cell.name);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn usage() -> ExitCode {
    eprintln!("usage: gcm_bars [--trials N] [--only WORD] [--set PARAMETER=VALUE] [--ours]");
    ExitCode::from(2)
}

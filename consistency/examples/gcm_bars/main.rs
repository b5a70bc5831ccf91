//! How do the rules compare on correlated outliers, and which bars are met? Prints biased accepted / good kept /
//! precision of each rule over many seeded harbours, the calibration of the posterior, and each bar.
//!
//! `gcm_bars [--trials N] [--from SEED] [--only WORD] [--set PARAMETER=VALUE] [--ours] [--times]`
//!
//! Without arguments a short run; 1000 trials for figures to quote; `--times` measures time instead. The defaults were
//! chosen on seeds from 40000 to 65599.

mod cells;
mod rules;
mod tally;
mod times;

use std::process::ExitCode;

use draco_consistency::GcmParams;

use cells::{Cell, cells};
use rules::{Rules, run};
use tally::Results;

struct Options {
    from: u64,
    trials: u64,
    only: String,
    rules: Rules,
    times: bool,
    params: GcmParams,
}

/// Shifts a parameter from its default, by name.
fn set(params: &mut GcmParams, assignment: &str) -> Option<()> {
    let (name, value) = assignment.split_once('=')?;
    let value: f64 = value.parse().ok()?;
    match name {
        "accept" => params.accept = value,
        "wrong_share" => params.wrong_share = value,
        "accept_among" => params.accept_among = value,
        "sound" => params.sound = value,
        "sound_strength" => params.sound_strength = value,
        "least_slip" => params.least_slip = value,
        "least_yaw" => params.least_yaw = value,
        "drift_most" => params.drift_most = value,
        "drift_doubt" => params.drift_doubt = value,
        "alpha" => params.alpha = value,
        "alpha_unplaced" => params.alpha_unplaced = value,
        "alpha_across" => params.alpha_across = value,
        "elsewhere_share" => params.elsewhere_share = value,
        "spike" => params.spike.translation = value,
        "spike_rotation" => params.spike.rotation = value,
        "slip" => params.slip.translation = value,
        "evidence_exponent" => params.evidence_exponent = value,
        "doubt" => params.doubt = value,
        "slip_rotation" => params.slip.rotation = value,
        "slip_share" => params.slip_share = value,
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

fn print(cell: &Cell, results: &Results, options: &Options, bars: &mut [usize; 2]) {
    let others = match options.rules {
        Rules::Ours => String::new(),
        Rules::All => {
            let all = [&results.pcm, &results.pooled, &results.group, &results.one_vote];
            all.map(|tally| format!("{:<18}", tally.text())).concat()
        }
    };
    println!(
        "{:<27} {others}{:<18}{:<18}{:.2}/{:<5.2}{:>7.1}",
        cell.name,
        results.ours.text(),
        results.leading.text(),
        results.ours.good_open.value(),
        results.ours.biased_open.value(),
        results.time.as_secs_f64() * 1e3 / options.trials.max(1) as f64,
    );
    println!("    P/sound (groups): {}", results.calibration());
    for bar in &cell.bars {
        if options.rules == Rules::Ours
            && matches!(bar, cells::Bar::AgainstPcm(..) | cells::Bar::AgainstPooled(..))
        {
            continue;
        }
        let (text, met) = results.judge(*bar);
        println!("    {} {text}", if met { "met   " } else { "MISSED" });
        bars[usize::from(met)] += 1;
    }
}

fn options() -> Option<Options> {
    let mut options = Options {
        from: 1000,
        trials: 10,
        only: String::new(),
        rules: Rules::All,
        times: false,
        params: GcmParams::default(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--ours" => options.rules = Rules::Ours,
            "--times" => options.times = true,
            "--trials" => options.trials = arguments.next()?.parse().ok()?,
            "--from" => options.from = arguments.next()?.parse().ok()?,
            "--only" => options.only = arguments.next()?,
            "--set" => set(&mut options.params, &arguments.next()?)?,
            _ => return None,
        }
    }
    Some(options)
}

fn main() -> ExitCode {
    let Some(options) = options() else {
        eprintln!(
            "usage: gcm_bars [--trials N] [--from SEED] [--only WORD] [--set PARAMETER=VALUE] [--ours] [--times]"
        );
        return ExitCode::from(2);
    };
    if options.times {
        return match times::times(&options.params) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    println!("{} trials from seed {}; biased accepted/good kept/precision", options.trials, options.from);
    let others = match options.rules {
        Rules::Ours => String::new(),
        Rules::All => ["pcm", "pooled", "group cost", "one vote"].map(|name| format!("{name:<18}")).concat(),
    };
    println!("{:<27} {others}{:<18}{:<18}{:<10}{:>7}", "", "ours", "leading", "open g/b", "ms");
    let mut bars = [0; 2];
    for cell in cells().iter().filter(|c| c.name.contains(&options.only)) {
        match run(cell, options.from..options.from + options.trials, options.rules, &options.params) {
            Ok(results) => print(cell, &results, &options, &mut bars),
            Err(error) => {
                eprintln!("{}: {error}", cell.name);
                return ExitCode::FAILURE;
            }
        }
    }
    println!("{} bars met, {} missed", bars[1], bars[0]);
    ExitCode::SUCCESS
}

//! The bars of the group posterior with few trials and margins for them; `gcm_bars` runs them all with many.

#[path = "../examples/gcm_bars/cells.rs"]
#[allow(dead_code)]
mod cells;
#[path = "../examples/gcm_bars/rules.rs"]
mod rules;
#[path = "../examples/gcm_bars/tally.rs"]
#[allow(dead_code)]
mod tally;

use cpu_time::ThreadTime;
use draco_consistency::simulate::{Harbor, harbor};
use draco_consistency::{GcmParams, gcm};
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use cells::{Bar, cells};
use rules::{Rules, run};

/// What `trials` seeds may miss a bar by: three standard errors of a share near the bar, groups of a team counted as
/// one.
fn margin(bar: f64, trials: u64) -> f64 {
    3.0 * (bar * (1.0 - bar) / trials as f64).sqrt()
}

fn with_margin(bar: Bar, trials: u64) -> Option<Bar> {
    let of = |bar: f64| margin(bar, trials);
    Some(match bar {
        Bar::Biased(bar) => Bar::Biased(bar + of(bar)),
        Bar::Good(bar) => Bar::Good(bar - of(bar)),
        Bar::Precision(bar) => Bar::Precision(bar - of(bar)),
        Bar::LeadingBiased(bar) => Bar::LeadingBiased(bar + of(bar)),
        Bar::LeadingGood(bar) => Bar::LeadingGood(bar - of(bar)),
        Bar::Undecided(bar) => Bar::Undecided(bar - of(bar)),
        // too few groups, and ratios of small shares: `gcm_bars` alone
        Bar::Calibrated(_) | Bar::AgainstPcm(..) | Bar::AgainstPooled(..) => return None,
    })
}

#[test]
fn the_bars_hold_with_few_trials() {
    const TRIALS: u64 = 24;
    let mut judged = 0;
    for cell in cells() {
        let bars: Vec<Bar> = cell.bars.iter().filter_map(|&bar| with_margin(bar, TRIALS)).collect();
        if bars.is_empty() {
            continue;
        }
        let results = run(&cell, 0..TRIALS, Rules::Ours, &GcmParams::default()).unwrap();
        for bar in bars {
            let (text, met) = results.judge(bar);
            assert!(met, "{}: {text}", cell.name);
            judged += 1;
        }
    }
    assert!(judged > 40, "{judged}");
}

#[test]
fn biased_closures_accepted_are_a_third_of_those_of_pcm() {
    for name in ["cyc s=0.3", "star s=0.3"] {
        let cell = cells().into_iter().find(|c| c.name == name).unwrap();
        let results = run(&cell, 0..30, Rules::All, &GcmParams::default()).unwrap();
        for bar in cell.bars.iter().filter(|b| matches!(b, Bar::AgainstPcm(..) | Bar::AgainstPooled(..))) {
            let (text, met) = results.judge(*bar);
            assert!(met, "{name}: {text}");
        }
    }
}

#[test]
fn probabilities_are_shares() {
    let params = GcmParams::default();
    let mut all = tally::Results::default();
    for cell in cells()
        .iter()
        .filter(|c| ["cyc s=0.3", "cyc s=1", "star s=0.5", "star s=1"].contains(&c.name.as_str()))
    {
        let results = run(cell, 0..40, Rules::Ours, &params).unwrap();
        for (sum, bin) in all.bins.iter_mut().zip(&results.bins) {
            sum.sum += bin.sum;
            sum.sound.kept += bin.sound.kept;
            sum.sound.all += bin.sound.all;
        }
    }
    let (text, met) = all.judge(Bar::Calibrated(0.07));
    assert!(met, "{text}: {}", all.calibration());
    assert!(all.bins.iter().filter(|bin| bin.sound.all >= 50).count() >= 3, "{}", all.calibration());
}

#[test]
fn time_grows_linearly_with_the_neighbours_of_a_star() {
    let seconds = |neighbors: u32| {
        let team =
            harbor::<3, Isometry2<f64>>(&Harbor::star(neighbors, 10), &mut ChaCha8Rng::seed_from_u64(1))
                .unwrap();
        let once = || {
            // the time of the processor, so that it does not tell what else the machine has to do
            let start = ThreadTime::now();
            gcm(&team.trajectories, &team.closures, &team.priors, &GcmParams::default()).unwrap();
            start.elapsed().as_secs_f64()
        };
        (0..5).map(|_| once()).fold(f64::INFINITY, f64::min)
    };
    // twelve over four neighbours: 3 if linear, 9 if square
    let ratio = seconds(12) / seconds(4);
    assert!(ratio < 6.0, "{ratio}");
}

//! Where is a beacon when two in five ranges are wrong? Keeps the largest set of which every four ranges agree, over
//! random outliers and over echoes, which agree with each other.

use cpu_time::ProcessTime;
use draco_consistency::simulate::{RangeLabel, Ranging, ranges};
use draco_consistency::{RangeParams, range_consistency};
use rand::SeedableRng;

fn main() -> Result<(), draco_consistency::Error> {
    let random = Ranging::default();
    let echoes = Ranging { random_share: 0.1, echo_share: 0.3, ..Ranging::default() };
    for (name, setting) in [("random outliers", random), ("echoes", echoes)] {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let problem = ranges(&setting, &mut rng)?;
        let start = ProcessTime::now();
        let params = RangeParams { probability: 0.9999, ..RangeParams::default() };
        let found = range_consistency(&problem.trajectory, &problem.ranges, &params)?;
        let cpu_ms = start.elapsed().as_secs_f64() * 1e3;
        let good = |m: &&usize| problem.labels[**m] == RangeLabel::Good;
        let all = problem.labels.iter().filter(|l| **l == RangeLabel::Good).count();
        let accepted = &found.selection.accepted;
        println!("{name}: {} ranges, {all} of them true", problem.ranges.len());
        println!(
            "  accepted {}, of which true {}; proved largest: {}",
            accepted.len(),
            accepted.iter().filter(good).count(),
            found.optimal
        );
        println!(
            "  tests of two {}, of four {} (of 487635 possible); {cpu_ms:.0} ms of CPU",
            found.tests[2], found.tests[4]
        );
    }
    Ok(())
}

//! Time of the group posterior on five neighbours, in batch and closure by closure.

use std::time::Instant;

use draco_consistency::simulate::{Harbor, harbor};
use draco_consistency::{Error, GcmOnline, GcmParams, gcm};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::tally::Team;

/// Prints batch time, least of five, and online steps of each team.
pub(crate) fn times(params: &GcmParams) -> Result<(), Error> {
    let sized = |size, params: Harbor| Harbor { group_size: (size, size), ..params };
    let teams = [
        ("star, 5 neighbours", sized(10, Harbor::star(5, 10))),
        ("star, 5 neighbours", sized(20, Harbor::star(5, 10))),
        ("cycles, 5 neighbours", sized(8, Harbor::star(5, 4).with_cycles(3))),
    ];
    println!(
        "{:<22}{:>9}{:>7}{:>10}   online step ms: median, 99 %, most",
        "", "closures", "votes", "batch ms"
    );
    for (name, harbour) in teams {
        let team: Team = harbor(&harbour, &mut ChaCha8Rng::seed_from_u64(1))?;
        let mut least = f64::INFINITY;
        let mut votes = 0;
        for _ in 0..5 {
            let start = Instant::now();
            votes = gcm(&team.trajectories, &team.closures, &team.priors, params)?.clusters.len();
            least = least.min(start.elapsed().as_secs_f64());
        }
        let mut online = GcmOnline::new(team.trajectories.clone(), team.priors.clone(), params.clone())?;
        let mut steps = Vec::with_capacity(team.closures.len());
        for closure in &team.closures {
            let start = Instant::now();
            online.insert(&[*closure])?;
            steps.push(start.elapsed().as_secs_f64() * 1e3);
        }
        steps.sort_by(f64::total_cmp);
        let at = |share: f64| steps[((steps.len() - 1) as f64 * share) as usize];
        println!(
            "{name:<22}{:>9}{votes:>7}{:>10.1}   {:.1}, {:.1}, {:.1}",
            team.closures.len(),
            least * 1e3,
            at(0.5),
            at(0.99),
            at(1.0),
        );
    }
    Ok(())
}

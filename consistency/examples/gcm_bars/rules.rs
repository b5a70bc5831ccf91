//! The rules that are compared, each with its own parameters.

use std::time::Instant;

use draco_consistency::simulate::harbor;
use draco_consistency::{
    Closure2, Error, Gcm, GcmParams, GroupParams, PcmParams, PooledParams, Selection, gcm, gcm_group,
    gcm_pooled, isotropic_covariance, pcm,
};
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::cells::Cell;
use crate::tally::{Results, Team};

/// Who takes part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rules {
    All,
    Ours,
}

/// Runs a cell over the seeds.
pub(crate) fn run(
    cell: &Cell,
    seeds: std::ops::Range<u64>,
    rules: Rules,
    params: &GcmParams,
) -> Result<Results, Error> {
    let mut results = Results::default();
    for seed in seeds {
        let mut team: Team = harbor(&cell.params, &mut ChaCha8Rng::seed_from_u64(seed))?;
        if rules == Rules::All {
            compare(&team, &mut results)?;
        }
        if cell.ignore_prior {
            team.priors.clear();
        }
        let start = Instant::now();
        let found = gcm(&team.trajectories, &team.closures, &team.priors, params)?;
        results.time += start.elapsed();
        results.ours.add(&team, &found.selection);
        results.leading.add(&team, &leading(&found));
        results.calibrate(&team, &found);
    }
    Ok(results)
}

/// What the preset `leading` makes of the same posterior.
fn leading(found: &Gcm<3>) -> Selection {
    let believed = found.clusters.iter().filter(|c| c.probability >= GcmParams::leading().accept);
    let mut accepted: Vec<usize> = believed.flat_map(|c| c.members.iter().copied()).collect();
    accepted.sort_unstable();
    Selection { accepted, ..Selection::default() }
}

/// The other rules; the pooled and the group rule cannot do without priors.
fn compare(team: &Team, results: &mut Results) -> Result<(), Error> {
    // the released program's covariance is far wider than its noise: a gate of 1.06 m, rotation never binding
    let wide = isotropic_covariance::<3, Isometry2<f64>>(0.315, 0.315);
    let released: Vec<Closure2> = team.closures.iter().map(|c| Closure2 { covariance: wide, ..*c }).collect();
    let (trajectories, closures, priors) = (&team.trajectories, &team.closures, &team.priors);
    results.pcm.add(team, &pcm(trajectories, closures, &PcmParams::default())?);
    results.pooled.add(team, &gcm_pooled(trajectories, &released, priors, &PooledParams::default())?);
    results.group.add(team, &gcm_group(trajectories, closures, priors, &GroupParams::default())?);
    let votes = draco_consistency::gcm::one_vote(trajectories, closures, &GcmParams::default())?;
    results.one_vote.add(team, &votes);
    Ok(())
}

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::SVector;

use super::beam::{Beam, search};
use super::consensus::Consensus;
use super::findings::Findings;
use super::frames::Frames;
use super::params::GcmParams;
use super::votes::{Evidence, Votes};
use crate::{Error, Pose};

/// What a block's findings follow from, for given trajectories, priors and parameters.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Signature {
    reference: u32,
    robots: BTreeSet<u32>,
    /// Bits of the noise scale.
    noise: u64,
    /// Members of each cluster, and whether it is the main one of its group.
    clusters: Vec<(Vec<usize>, bool)>,
}

/// The blocks solved so far: a block that no closure touched since is not solved again.
#[derive(Debug, Clone, Default)]
pub(crate) struct Blocks {
    solved: BTreeMap<Signature, (Findings, bool)>,
}

impl Blocks {
    /// Adds the findings on the clusters `chosen` (ascending) of the block of `robots`.
    pub(crate) fn solve<const N: usize, G: Pose<N>>(
        &mut self,
        evidence: &Evidence<'_, G, N>,
        reference: u32,
        robots: &BTreeSet<u32>,
        chosen: &[usize],
        findings: &mut Findings,
    ) -> Result<(), Error> {
        if chosen.is_empty() {
            return Ok(());
        }
        let clusters = chosen.iter().map(|&c| &evidence.clusters[c]);
        let signature = Signature {
            reference,
            robots: robots.clone(),
            noise: evidence.noise_scale.to_bits(),
            clusters: clusters.map(|c| (c.members.clone(), c.is_main)).collect(),
        };
        if let Some((solved, used)) = self.solved.get_mut(&signature) {
            *used = true;
            findings.absorb(chosen, solved);
            return Ok(());
        }
        let solved = solve(evidence, reference, robots, chosen)?;
        findings.absorb(chosen, &solved);
        self.solved.insert(signature, (solved, true));
        Ok(())
    }

    /// Forgets the blocks that were not asked for since the last call.
    pub(crate) fn forget_unused(&mut self) {
        self.solved.retain(|_, (_, used)| std::mem::take(used));
    }
}

/// One beam search, repeated once when its best hypothesis moves a map far from the linearisation, and again under
/// rising scales of the drift.
fn solve<const N: usize, G: Pose<N>>(
    evidence: &Evidence<'_, G, N>,
    reference: u32,
    robots: &BTreeSet<u32>,
    chosen: &[usize],
) -> Result<Findings, Error> {
    const METRES_MOVED: f64 = 0.5;
    const RADIANS_MOVED: f64 = 0.05;
    let params = evidence.params;
    let is_member = |robot: u32| robots.contains(&robot);
    let mut members: Vec<usize> =
        chosen.iter().flat_map(|&c| evidence.clusters[c].members.iter().copied()).collect();
    members.sort_unstable();
    let closures: Vec<_> = members.iter().map(|&m| evidence.closures[m]).collect();
    let transforms: Vec<G> = members.iter().map(|&m| evidence.transforms[m]).collect();
    let priors: Vec<_> =
        evidence.priors.iter().filter(|p| is_member(p.source) && is_member(p.target)).copied().collect();
    let frames = Frames::new(reference, evidence.trajectories, &closures, &transforms, &priors);
    let mut votes = Votes::new(evidence, &frames, chosen, is_member);
    // a narrow beam tells whether the linearisation holds
    let mut consensus = Consensus::new();
    let scout = search::<N, G>(&votes, &mut consensus, params, params.beam.div_ceil(4))?;
    if let Some(best) = scout.best() {
        let correction = estimate(&votes, &best.solution(&votes, &consensus), robots);
        let (moved, metres, radians) = frames.moved(&correction);
        if metres > METRES_MOVED || radians > RADIANS_MOVED {
            votes = Votes::new(evidence, &moved, chosen, is_member);
            consensus = Consensus::new();
        }
    }
    let beam = search::<N, G>(&votes, &mut consensus, params, params.beam)?;
    let scales = DriftScales::climb::<G>(&mut votes, (beam, consensus), params)?;
    let mut findings = Findings::new(chosen.len());
    scales.report::<G>(&mut votes, chosen, &mut findings);
    Ok(findings)
}

/// The beams under rising scales of the drift's covariance.
struct DriftScales<const N: usize> {
    runs: Vec<Run<N>>,
}

/// The beam under one scale.
struct Run<const N: usize> {
    scale: f64,
    beam: Beam<N>,
    consensus: Consensus<N>,
    /// Log evidence plus log prior of the scale.
    evidence: f64,
}

impl<const N: usize> DriftScales<N> {
    /// From the scale 1 of `told` up, the σ doubled each time, until the evidence has fallen for good.
    fn climb<G: Pose<N>>(
        votes: &mut Votes<N>,
        (told, consensus): (Beam<N>, Consensus<N>),
        params: &GcmParams,
    ) -> Result<Self, Error> {
        const LOST: f64 = 6.0;
        // enough to tell the evidence; the best scale is then searched in full
        let width = params.beam.div_ceil(4);
        let evidence = told.log_evidence();
        let mut best = 0;
        let mut runs = vec![Run { scale: 1.0, beam: told, consensus, evidence }];
        let mut sigma = 2.0f64;
        while sigma <= params.drift_most {
            let scale = sigma * sigma;
            votes.set_drift_scale(scale);
            let mut consensus = Consensus::new();
            let beam = search::<N, G>(votes, &mut consensus, params, width)?;
            let evidence = beam.log_evidence() - params.drift_doubt * sigma.log2();
            runs.push(Run { scale, beam, consensus, evidence });
            if evidence > runs[best].evidence {
                best = runs.len() - 1;
            } else if evidence < runs[best].evidence - LOST {
                break;
            }
            sigma *= 2.0;
        }
        if best > 0 {
            let Run { scale, beam, consensus, .. } = &mut runs[best];
            votes.set_drift_scale(*scale);
            *beam = search::<N, G>(votes, consensus, params, params.beam)?;
        }
        Ok(Self { runs })
    }

    fn report<G: Pose<N>>(&self, votes: &mut Votes<N>, chosen: &[usize], findings: &mut Findings) {
        let best = self.runs.iter().map(|run| run.evidence).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = self.runs.iter().map(|run| (run.evidence - best).exp()).sum();
        for Run { scale, beam, consensus, evidence } in &self.runs {
            findings.add(votes, chosen, beam, (evidence - best).exp() / total);
            if *evidence == best {
                votes.set_drift_scale(*scale);
                findings.dropped = findings.dropped.max(beam.dropped);
                findings.drift_scale = findings.drift_scale.max(*scale);
                if let Some(hypothesis) = beam.best() {
                    let solution = hypothesis.solution(votes, consensus);
                    findings.add_slips::<N, G>(votes, chosen, hypothesis, &solution);
                }
            }
        }
    }
}

/// Posterior mean of each robot's map correction δ, from `K_H⁻¹ ρ`.
fn estimate<const N: usize>(
    votes: &Votes<N>,
    solution: &[SVector<f64, N>],
    robots: &BTreeSet<u32>,
) -> BTreeMap<u32, SVector<f64, N>> {
    let of = |robot: u32| {
        let sum = votes
            .list
            .iter()
            .zip(solution)
            .fold(SVector::zeros(), |sum: SVector<f64, N>, (vote, x)| sum + x * votes.sign(vote, robot));
        votes.base * sum
    };
    robots.iter().filter(|r| **r != votes.reference).map(|&robot| (robot, of(robot))).collect()
}

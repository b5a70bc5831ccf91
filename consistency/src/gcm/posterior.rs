use std::collections::BTreeSet;

use nalgebra::SMatrix;

use super::block::Blocks;
use super::clusters::Cluster;
use super::findings::Findings;
use super::grouping::gap;
use super::params::GcmParams;
use super::problem::{Problem, components};
use super::verdict::{Case, Verdict, sort, verdicts};
use super::votes::Evidence;
use crate::{Closure, Error, MapTransform, Pose, Selection, Trajectories, isotropic_covariance};

/// What [`gcm`] concludes.
#[derive(Debug, Clone, PartialEq)]
pub struct Gcm<const N: usize> {
    /// Accepted, rejected and undecided closures.
    pub selection: Selection,
    /// The votes, ordered by robot pair and group.
    pub clusters: Vec<GroupPosterior>,
    /// The cluster of each closure.
    pub cluster_of: Vec<usize>,
    /// Covariance to give each closure in the pose graph, in its own direction and order: its noise as scaled by
    /// `noise_scale` plus the common bias times the number of closures that share it, so that those of one place weigh
    /// like one vote.
    pub covariances: Vec<SMatrix<f64, N, N>>,
    /// Factor by which the noise inside groups exceeds its covariances, from 1 to 9; already applied.
    pub noise_scale: f64,
    /// Most probable factor by which the drift between groups exceeds its covariance, beyond `noise_scale`; of several
    /// blocks the largest. Already applied.
    pub drift_scale: f64,
    /// Score of the best hypothesis that the beam ever dropped, in nats relative to the best of its step; minus
    /// infinity when the posterior is exact. Near zero means that the beam is too narrow.
    pub dropped: f64,
}

/// The posterior of one cluster: closures of one group that agree, one vote.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupPosterior {
    /// Its two robots: source, target in the canonical direction.
    pub robots: (u32, u32),
    /// Smallest closure of its group; names the group.
    pub group: usize,
    /// Its closures, ascending.
    pub members: Vec<usize>,
    /// Whether it is the largest cluster of its group.
    pub is_main: bool,
    /// Posterior probability that it is sound.
    pub probability: f64,
    /// What follows from it.
    pub verdict: Verdict,
}

/// Group consistency: the posterior probability that each group of closures is sound, all neighbours and three-robot
/// cycles in one joint Gaussian, and what to do about it. See the [module docs](mod@crate::gcm).
///
/// * `priors` – where maps are believed to lie; none at all is a legal case.
///
/// # Errors
/// Unknown poses, bad poses, covariances or priors, parameters outside their range; [`Error::VoteCovariance`] when
/// the drift covariances are no covariance together.
///
/// Cost for `B` hypotheses and blocks of `G` clusters, of which hypotheses take `m` for slipped and differ in `d` others:
/// `O((N G)³ + B G (N (m + d))²)`.
pub fn gcm<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &GcmParams,
) -> Result<Gcm<N>, Error> {
    gcm_with_history(trajectories, closures, priors, params, &BTreeSet::new(), &mut Blocks::default())
}

/// [`gcm`] with hysteresis: clusters with a member in `held` stay accepted down to `params.withdraw`. Blocks whose
/// evidence is that of the last call are not solved again.
pub(crate) fn gcm_with_history<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &GcmParams,
    held: &BTreeSet<usize>,
    blocks: &mut Blocks,
) -> Result<Gcm<N>, Error> {
    params.check()?;
    let problem = Problem::new(trajectories, closures, priors, params)?;
    let evidence = problem.evidence(trajectories, params);
    let Problem { clusters, noise_scale, .. } = &problem;
    let noise_scale = *noise_scale;
    let mut findings = Findings::new(clusters.len());
    for (&reference, robots) in &problem.teams.robots_by_reference {
        solve_team(&evidence, reference, robots, blocks, &mut findings)?;
    }
    blocks.forget_unused();
    findings.weigh_evidence(clusters, params);
    let mut cluster_of = vec![0; closures.len()];
    for (index, cluster) in clusters.iter().enumerate() {
        cluster.members.iter().for_each(|&m| cluster_of[m] = index);
    }
    let team_of = |robot: u32| problem.teams.reference_of(robot);
    let case = Case { clusters, findings: &findings, params, held, has_priors: !priors.is_empty() };
    let verdicts = verdicts(&case, team_of);
    let selection = sort(&case, &verdicts);
    let covariances = hand_over(closures, &problem, &cluster_of, params);
    let posteriors = clusters.iter().zip(&findings.sound).zip(verdicts);
    Ok(Gcm {
        selection,
        clusters: posteriors
            .map(|((cluster, &probability), verdict)| GroupPosterior {
                robots: cluster.robots,
                group: cluster.group,
                members: cluster.members.clone(),
                is_main: cluster.is_main,
                probability,
                verdict,
            })
            .collect(),
        cluster_of,
        covariances,
        noise_scale,
        drift_scale: findings.drift_scale,
        dropped: findings.dropped,
    })
}

/// Solves one connected team: all neighbours at once when it is small, else each block that falls apart without the
/// reference.
fn solve_team<const N: usize, G: Pose<N>>(
    evidence: &Evidence<'_, G, N>,
    reference: u32,
    robots: &BTreeSet<u32>,
    blocks: &mut Blocks,
    findings: &mut Findings,
) -> Result<(), Error> {
    let own: Vec<usize> =
        (0..evidence.clusters.len()).filter(|&c| robots.contains(&evidence.clusters[c].robots.0)).collect();
    if own.len() < evidence.params.joint_limit {
        return blocks.solve(evidence, reference, robots, &own, findings);
    }
    let priors = evidence.priors.iter().filter(|p| robots.contains(&p.source));
    let links: BTreeSet<(u32, u32)> = own
        .iter()
        .map(|&c| evidence.clusters[c].robots)
        .chain(priors.map(|p| (p.source, p.target)))
        .collect();
    for mut block in components(robots, &links, Some(reference)) {
        block.insert(reference);
        let inside = |c: &Cluster| {
            block.contains(&c.robots.0) && block.contains(&c.robots.1) && c.robots != (reference, reference)
        };
        let chosen: Vec<usize> = own.iter().copied().filter(|&c| inside(&evidence.clusters[c])).collect();
        blocks.solve(evidence, reference, &block, &chosen, findings)?;
    }
    let within: Vec<usize> =
        own.into_iter().filter(|&c| evidence.clusters[c].robots == (reference, reference)).collect();
    blocks.solve(evidence, reference, &BTreeSet::from([reference]), &within, findings)
}

/// `c S_m + n_m S_b` with `n_m = Σ exp(-(gap/ℓ)²)` over the closures of its cluster: so many share its bias, and
/// together they weigh like one vote. The ends of a long group are of different places.
fn hand_over<const N: usize, G: Pose<N>>(
    closures: &[Closure<G, N>],
    problem: &Problem<G, N>,
    cluster_of: &[usize],
    params: &GcmParams,
) -> Vec<SMatrix<f64, N, N>> {
    let spike = isotropic_covariance::<N, G>(params.spike.translation, params.spike.rotation);
    let shared = |m: usize, n: usize| {
        (-(gap(&problem.stations[m], &problem.stations[n]) / params.correlation).powi(2)).exp()
    };
    let sharers =
        |m: usize| -> f64 { problem.clusters[cluster_of[m]].members.iter().map(|&n| shared(m, n)).sum() };
    // the spike acts about the scene, where both bodies are, so the frame of either serves
    let of =
        |(m, closure): (usize, &Closure<G, N>)| closure.covariance * problem.noise_scale + spike * sharers(m);
    closures.iter().enumerate().map(of).collect()
}

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{SMatrix, SVector};

use super::beam::{Beam, Hypothesis, State, search};
use super::clusters::{Cluster, clusters};
use super::frames::{Frames, implied};
use super::grouping::stations;
use super::params::GcmParams;
use super::verdict::{Verdict, judge};
use super::votes::{Evidence, Kind, Votes};
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
    /// `noise_scale` plus its share of the group's common bias, so that a whole group weighs like one vote.
    pub covariances: Vec<SMatrix<f64, N, N>>,
    /// Factor by which the noise inside groups exceeds its covariances, from 1 to 9; already applied.
    pub noise_scale: f64,
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
/// Cost for `B` hypotheses and blocks of `G` clusters: `O(B G (N G)²)`, less what hypotheses share.
pub fn gcm<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &GcmParams,
) -> Result<Gcm<N>, Error> {
    gcm_with_history(trajectories, closures, priors, params, &BTreeSet::new())
}

/// [`gcm`] with hysteresis: clusters with a member in `held` stay accepted down to `params.withdraw`.
pub(crate) fn gcm_with_history<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &GcmParams,
    held: &BTreeSet<usize>,
) -> Result<Gcm<N>, Error> {
    params.check()?;
    for (index, closure) in closures.iter().enumerate() {
        closure.check(index)?;
        trajectories.of(index, closure.source)?;
        trajectories.of(index, closure.target)?;
    }
    for (index, prior) in priors.iter().enumerate() {
        prior.check(index)?;
    }
    let teams = Teams::new(closures, priors, params.reference);
    let canonical: Vec<_> = closures.iter().map(|c| c.with_source_robot(teams.source_of(c))).collect();
    // in one direction too, so that telling a prior the other way round changes no bit
    let priors: Vec<_> = priors
        .iter()
        .map(|p| {
            let (first, second) = (p.source.min(p.target), p.source.max(p.target));
            let target = if teams.reference_of.get(&second) == Some(&second) { second } else { first };
            if p.target == target { *p } else { p.reversed() }
        })
        .collect();
    let transforms: Vec<G> = canonical.iter().map(|c| implied(trajectories, c)).collect();
    let stations = stations(trajectories, &canonical, params.unit);
    let (clusters, noise_scale) = clusters(trajectories, &canonical, &stations, params)?;
    let evidence = Evidence {
        trajectories,
        closures: &canonical,
        transforms: &transforms,
        stations: &stations,
        priors: &priors,
        clusters: &clusters,
        noise_scale,
        params,
    };
    let mut findings = Findings::new(clusters.len());
    for (&reference, robots) in &teams.robots_by_reference {
        solve_team(&evidence, reference, robots, &mut findings)?;
    }
    let mut cluster_of = vec![0; closures.len()];
    for (index, cluster) in clusters.iter().enumerate() {
        cluster.members.iter().for_each(|&m| cluster_of[m] = index);
    }
    let (selection, verdicts) = judge(&clusters, &findings, params, held, !priors.is_empty());
    let covariances = hand_over::<N, G>(closures, &clusters, &cluster_of, noise_scale, params);
    let posteriors = clusters.into_iter().zip(&findings.sound).zip(verdicts);
    Ok(Gcm {
        selection,
        clusters: posteriors
            .map(|((cluster, &probability), verdict)| GroupPosterior {
                robots: cluster.robots,
                group: cluster.group,
                members: cluster.members,
                is_main: cluster.is_main,
                probability,
                verdict,
            })
            .collect(),
        cluster_of,
        covariances,
        noise_scale,
        dropped: findings.dropped,
    })
}

/// The connected teams of robots, each with its reference.
struct Teams {
    robots_by_reference: BTreeMap<u32, BTreeSet<u32>>,
    reference_of: BTreeMap<u32, u32>,
}

impl Teams {
    fn new<const N: usize, G: Pose<N>>(
        closures: &[Closure<G, N>],
        priors: &[MapTransform<G, N>],
        preferred: Option<u32>,
    ) -> Self {
        let pairs: BTreeSet<(u32, u32)> = closures
            .iter()
            .map(Closure::robots)
            .chain(priors.iter().map(|p| (p.source.min(p.target), p.source.max(p.target))))
            .collect();
        let all: BTreeSet<u32> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
        let mut robots_by_reference = BTreeMap::new();
        let mut reference_of = BTreeMap::new();
        for robots in components(&all, &pairs, None) {
            let smallest = robots.first().copied();
            if let Some(reference) = preferred.filter(|p| robots.contains(p)).or(smallest) {
                reference_of.extend(robots.iter().map(|&robot| (robot, reference)));
                robots_by_reference.insert(reference, robots);
            }
        }
        Self { robots_by_reference, reference_of }
    }

    /// The robot that holds the source in the canonical direction: the reference, else the smaller id.
    fn source_of<G: Pose<N>, const N: usize>(&self, closure: &Closure<G, N>) -> u32 {
        let (first, second) = closure.robots();
        if self.reference_of.get(&second) == Some(&second) { second } else { first }
    }
}

/// Connected components of `robots` under `pairs`, without the robot `removed`; by smallest member.
fn components(
    robots: &BTreeSet<u32>,
    pairs: &BTreeSet<(u32, u32)>,
    removed: Option<u32>,
) -> Vec<BTreeSet<u32>> {
    let mut label: BTreeMap<u32, u32> =
        robots.iter().filter(|r| Some(**r) != removed).map(|&r| (r, r)).collect();
    for (a, b) in pairs {
        if let (Some(&la), Some(&lb)) = (label.get(a), label.get(b)) {
            let (keep, drop) = (la.min(lb), la.max(lb));
            label.values_mut().filter(|l| **l == drop).for_each(|l| *l = keep);
        }
    }
    let mut found: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for (robot, l) in label {
        found.entry(l).or_default().insert(robot);
    }
    found.into_values().collect()
}

/// What the beams found of each cluster.
pub(crate) struct Findings {
    /// Posterior of the state `good`.
    pub(crate) sound: Vec<f64>,
    /// Of a slip, a yaw slip, a gross error.
    pub(crate) faults: Vec<[f64; 3]>,
    /// Estimated shift and the clusters that share it, under the best hypothesis.
    pub(crate) slips: BTreeMap<usize, (Vec<f64>, Vec<usize>)>,
    pub(crate) dropped: f64,
}

impl Findings {
    fn new(clusters: usize) -> Self {
        Self {
            sound: vec![0.0; clusters],
            faults: vec![[0.0; 3]; clusters],
            slips: BTreeMap::new(),
            dropped: f64::NEG_INFINITY,
        }
    }

    /// Adds the posterior of one block.
    fn add<const N: usize, G: Pose<N>>(&mut self, votes: &Votes<N>, beam: &Beam<N>) {
        self.dropped = self.dropped.max(beam.dropped);
        let Some(best) = best_of(beam) else { return };
        let weights: Vec<f64> = beam.hypotheses.iter().map(|h| (h.score - best.score).exp()).collect();
        let total: f64 = weights.iter().sum();
        for (t, vote) in votes.list.iter().enumerate() {
            let Kind::Cluster { cluster, .. } = vote.kind else { continue };
            for (hypothesis, weight) in beam.hypotheses.iter().zip(&weights) {
                let share = weight / total;
                match hypothesis.states[t] {
                    State::Good => self.sound[cluster] += share,
                    State::Slip(_) => self.faults[cluster][0] += share,
                    State::YawSlip => self.faults[cluster][1] += share,
                    State::Gross | State::Elsewhere | State::BadPrior => self.faults[cluster][2] += share,
                }
            }
        }
        self.add_slips::<N, G>(votes, best);
    }

    fn add_slips<const N: usize, G: Pose<N>>(&mut self, votes: &Votes<N>, best: &Hypothesis<N>) {
        let solution = best.solution();
        let mut slips: BTreeMap<State, (SVector<f64, N>, Vec<usize>)> = BTreeMap::new();
        for ((vote, state), x) in votes.list.iter().zip(&best.states).zip(&solution) {
            if let (Kind::Cluster { cluster, .. }, State::Slip(_)) = (&vote.kind, state) {
                let slip = slips.entry(*state).or_insert((SVector::zeros(), Vec::new()));
                slip.0 += votes.slip * x;
                slip.1.push(*cluster);
            }
        }
        for (shift, members) in slips.into_values() {
            let offset: Vec<f64> = shift.rows(0, G::TRANSLATION).iter().copied().collect();
            for &member in &members {
                self.slips.insert(member, (offset.clone(), members.clone()));
            }
        }
    }
}

fn best_of<const N: usize>(beam: &Beam<N>) -> Option<&Hypothesis<N>> {
    beam.hypotheses.iter().reduce(|best, h| if h.score > best.score { h } else { best })
}

/// Solves one connected team: all neighbours at once when it is small, else each block that falls apart without the
/// reference.
fn solve_team<const N: usize, G: Pose<N>>(
    evidence: &Evidence<'_, G, N>,
    reference: u32,
    robots: &BTreeSet<u32>,
    findings: &mut Findings,
) -> Result<(), Error> {
    let (closures, transforms): (Vec<_>, Vec<G>) = evidence
        .closures
        .iter()
        .zip(evidence.transforms)
        .filter(|(c, _)| robots.contains(&c.source.robot))
        .map(|(c, t)| (*c, *t))
        .unzip();
    let priors: Vec<_> = evidence.priors.iter().filter(|p| robots.contains(&p.source)).copied().collect();
    let frames = Frames::new(reference, evidence.trajectories, &closures, &transforms, &priors);
    let own: Vec<usize> =
        (0..evidence.clusters.len()).filter(|&c| robots.contains(&evidence.clusters[c].robots.0)).collect();
    if own.len() < evidence.params.joint_limit {
        return solve_block(evidence, frames, robots, &own, findings);
    }
    let links: BTreeSet<(u32, u32)> = own
        .iter()
        .map(|&c| evidence.clusters[c].robots)
        .chain(priors.iter().map(|p| (p.source, p.target)))
        .collect();
    for mut block in components(robots, &links, Some(reference)) {
        block.insert(reference);
        let inside = |c: &Cluster| {
            block.contains(&c.robots.0) && block.contains(&c.robots.1) && c.robots != (reference, reference)
        };
        let chosen: Vec<usize> = own.iter().copied().filter(|&c| inside(&evidence.clusters[c])).collect();
        solve_block(evidence, frames.clone(), &block, &chosen, findings)?;
    }
    let within: Vec<usize> =
        own.into_iter().filter(|&c| evidence.clusters[c].robots == (reference, reference)).collect();
    solve_block(evidence, frames, &BTreeSet::from([reference]), &within, findings)
}

/// One beam search, repeated once when its best hypothesis moves a map far from the linearisation.
fn solve_block<const N: usize, G: Pose<N>>(
    evidence: &Evidence<'_, G, N>,
    frames: Frames<G, N>,
    robots: &BTreeSet<u32>,
    chosen: &[usize],
    findings: &mut Findings,
) -> Result<(), Error> {
    const METRES_MOVED: f64 = 0.5;
    const RADIANS_MOVED: f64 = 0.05;
    if chosen.is_empty() {
        return Ok(());
    }
    let is_member = |robot: u32| robots.contains(&robot);
    let mut votes = Votes::new(evidence, &frames, chosen, is_member);
    let mut beam = search(&votes, evidence.params)?;
    if let Some(best) = best_of(&beam) {
        let (moved, metres, radians) = frames.moved(&estimate(&votes, best, robots));
        if metres > METRES_MOVED || radians > RADIANS_MOVED {
            votes = Votes::new(evidence, &moved, chosen, is_member);
            beam = search(&votes, evidence.params)?;
        }
    }
    findings.add::<N, G>(&votes, &beam);
    Ok(())
}

/// Posterior mean of each robot's map correction δ.
fn estimate<const N: usize>(
    votes: &Votes<N>,
    best: &Hypothesis<N>,
    robots: &BTreeSet<u32>,
) -> BTreeMap<u32, SVector<f64, N>> {
    let solution = best.solution();
    let of = |robot: u32| {
        let sum = votes
            .list
            .iter()
            .zip(&solution)
            .fold(SVector::zeros(), |sum: SVector<f64, N>, (vote, x)| sum + x * votes.sign(vote, robot));
        votes.base * sum
    };
    robots.iter().filter(|r| **r != votes.reference).map(|&robot| (robot, of(robot))).collect()
}

/// `c S_m + n_g S_b`: n of them together weigh like `c S / n + S_b`.
fn hand_over<const N: usize, G: Pose<N>>(
    closures: &[Closure<G, N>],
    clusters: &[Cluster],
    cluster_of: &[usize],
    noise_scale: f64,
    params: &GcmParams,
) -> Vec<SMatrix<f64, N, N>> {
    let spike = isotropic_covariance::<N, G>(params.spike.translation, params.spike.rotation);
    closures
        .iter()
        .zip(cluster_of)
        .map(|(closure, &c)| {
            // the spike acts about the scene, where both bodies are, so the frame of either serves
            closure.covariance * noise_scale + spike * clusters[c].members.len() as f64
        })
        .collect()
}

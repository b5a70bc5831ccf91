use std::cmp::Reverse;
use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};

use super::clusters::Cluster;
use super::frames::Frames;
use super::grouping::{Station, gap};
use super::params::GcmParams;
use super::slips::SlipPrior;
use crate::pose::transported;
use crate::{Closure, Error, MapTransform, Pose, Trajectories, isotropic_covariance};

/// One vote of the joint Gaussian: a cluster of closures or a map prior.
#[derive(Debug, Clone)]
pub(crate) struct Vote<const N: usize> {
    pub(crate) kind: Kind<N>,
    /// Source (`r`, sign -1) and target robot (`q`, sign +1).
    pub(crate) robots: (u32, u32),
    /// Whether a prior tells where the maps of the two lie to each other.
    pub(crate) placed: bool,
    pub(crate) rho: SVector<f64, N>,
    /// Registration noise of the mean, or the prior's covariance.
    noise: SMatrix<f64, N, N>,
    /// How often each pose of the source and of the target occurs, as shares.
    ends: [Vec<(usize, f64)>; 2],
}

#[derive(Debug, Clone)]
pub(crate) enum Kind<const N: usize> {
    Prior {
        bad: SMatrix<f64, N, N>,
    },
    Cluster {
        /// Place in the list of clusters.
        cluster: usize,
        /// Its smallest closure.
        first: usize,
        single: bool,
        spike: SMatrix<f64, N, N>,
        yaw: SMatrix<f64, N, N>,
        gross: SMatrix<f64, N, N>,
        elsewhere: SMatrix<f64, N, N>,
        /// The earlier vote of the same run and κ.
        neighbor: Option<(usize, f64)>,
    },
}

/// The votes in beam order with the covariance of `rho` but for the states' own parts.
pub(crate) struct Votes<const N: usize> {
    pub(crate) list: Vec<Vote<N>>,
    /// Lower triangle of blocks, row by row: everything but the drift, the drift as told, and both together.
    fixed: Vec<SMatrix<f64, N, N>>,
    drift: Vec<SMatrix<f64, N, N>>,
    blocks: Vec<SMatrix<f64, N, N>>,
    pub(crate) slip: SlipPrior<N>,
    pub(crate) base: SMatrix<f64, N, N>,
    pub(crate) reference: u32,
}

/// What the votes are made from.
pub(crate) struct Evidence<'a, G, const N: usize> {
    pub(crate) trajectories: &'a Trajectories<G, N>,
    /// Canonical direction.
    pub(crate) closures: &'a [Closure<G, N>],
    /// The map transform each closure implies.
    pub(crate) transforms: &'a [G],
    pub(crate) stations: &'a [Station],
    pub(crate) priors: &'a [MapTransform<G, N>],
    pub(crate) clusters: &'a [Cluster],
    pub(crate) noise_scale: f64,
    pub(crate) params: &'a GcmParams,
}

impl<const N: usize> Vote<N> {
    /// The error that its covariance given the earlier votes has no factor.
    pub(crate) fn singular(&self) -> Error {
        let closure = match &self.kind {
            Kind::Cluster { first, .. } => Some(*first),
            Kind::Prior { .. } => None,
        };
        Error::VoteCovariance { source_robot: self.robots.0, target_robot: self.robots.1, closure }
    }
}

impl<const N: usize> Votes<N> {
    /// The votes of the clusters `chosen` and of the priors between robots that `is_member` knows, with the drift as
    /// told.
    pub(crate) fn new<G: Pose<N>>(
        evidence: &Evidence<'_, G, N>,
        frames: &Frames<G, N>,
        chosen: &[usize],
        is_member: impl Fn(u32) -> bool,
    ) -> Self {
        let params = evidence.params;
        let mut list: Vec<Vote<N>> = evidence
            .priors
            .iter()
            .filter(|p| is_member(p.source) && is_member(p.target))
            .map(|prior| prior_vote(prior, frames, params))
            .collect();
        list.extend(ordered(evidence, chosen).into_iter().map(|c| cluster_vote(evidence, frames, c)));
        link_neighbors(evidence, &mut list);
        let size = list.len() * (list.len() + 1) / 2;
        let mut votes = Self {
            fixed: Vec::with_capacity(size),
            drift: Vec::with_capacity(size),
            blocks: Vec::new(),
            list,
            slip: SlipPrior::new::<G>(params),
            base: isotropic_covariance::<N, G>(params.base.translation, params.base.rotation),
            reference: frames.reference,
        };
        let mut table = DriftTable { evidence, adjoints: BTreeMap::new(), frames };
        for g in 0..votes.list.len() {
            for h in 0..=g {
                let (drift, base) = votes.shared(&votes.list[g], &votes.list[h], &mut table);
                votes.fixed.push(if g == h { base + votes.list[g].noise } else { base });
                votes.drift.push(drift);
            }
        }
        votes.set_drift_scale(1.0);
        votes
    }

    /// Multiplies the drift's covariance as told by `scale`.
    pub(crate) fn set_drift_scale(&mut self, scale: f64) {
        self.blocks.clear();
        self.blocks.extend(self.fixed.iter().zip(&self.drift).map(|(fixed, drift)| fixed + drift * scale));
    }

    /// Block (g, h) of K with `h <= g`.
    pub(crate) fn block(&self, g: usize, h: usize) -> &SMatrix<f64, N, N> {
        &self.blocks[g * (g + 1) / 2 + h]
    }

    /// The same votes in another order, ties between neighbours left out.
    #[cfg(test)]
    pub(crate) fn reordered(&self, order: &[usize]) -> Self {
        let pick = |blocks: &[SMatrix<f64, N, N>]| {
            let at = |g: usize, h: usize| {
                if h <= g { blocks[g * (g + 1) / 2 + h] } else { blocks[h * (h + 1) / 2 + g].transpose() }
            };
            let rows = order.iter().enumerate();
            rows.flat_map(|(t, &g)| order[..=t].iter().map(move |&h| (g, h))).map(|(g, h)| at(g, h)).collect()
        };
        Self {
            list: order.iter().map(|&t| self.list[t].clone()).collect(),
            fixed: pick(&self.fixed),
            drift: pick(&self.drift),
            blocks: pick(&self.blocks),
            ..*self
        }
    }

    /// +1, -1 or 0: how the transform of `robot` enters the vote.
    pub(crate) fn sign(&self, vote: &Vote<N>, robot: u32) -> f64 {
        if robot == self.reference {
            return 0.0;
        }
        f64::from(u8::from(vote.robots.1 == robot)) - f64::from(u8::from(vote.robots.0 == robot))
    }

    /// Drift of shared robots and the base of shared map transforms.
    fn shared<G: Pose<N>>(
        &self,
        g: &Vote<N>,
        h: &Vote<N>,
        drift: &mut DriftTable<'_, '_, G, N>,
    ) -> (SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
        let (mut sum, mut base) = (SMatrix::zeros(), SMatrix::zeros());
        for (side_g, robot_g, sign_g) in [(0, g.robots.0, -1.0), (1, g.robots.1, 1.0)] {
            for (side_h, robot_h, sign_h) in [(0, h.robots.0, -1.0), (1, h.robots.1, 1.0)] {
                if robot_g != robot_h {
                    continue;
                }
                sum += drift.mean(robot_g, &g.ends[side_g], &h.ends[side_h]) * (sign_g * sign_h);
                if robot_g != self.reference {
                    base += self.base * (sign_g * sign_h);
                }
            }
        }
        (sum, base)
    }
}

/// Means of `Cov(z_k, z_l)` in the common frame.
struct DriftTable<'a, 'b, G, const N: usize> {
    evidence: &'a Evidence<'b, G, N>,
    frames: &'a Frames<G, N>,
    adjoints: BTreeMap<u32, SMatrix<f64, N, N>>,
}

impl<G: Pose<N>, const N: usize> DriftTable<'_, '_, G, N> {
    fn mean(&mut self, robot: u32, a: &[(usize, f64)], b: &[(usize, f64)]) -> SMatrix<f64, N, N> {
        let Some(trajectory) = self.evidence.trajectories.get(robot) else {
            return SMatrix::zeros();
        };
        let sum = trajectory.drift_mean(a, b).unwrap_or_else(SMatrix::zeros);
        if a.is_empty() || b.is_empty() {
            return sum;
        }
        let adjoint = self.adjoints.entry(robot).or_insert_with(|| self.frames.adjoint(robot));
        *adjoint * sum * adjoint.transpose() * self.evidence.noise_scale
    }
}

/// Clusters by size, the largest first, then by (robot pair, first pose): the beam meets strong votes first. Weak ones
/// that contradict each other have more explanations than the beam holds, and must not crowd the truth out.
fn ordered<G: Pose<N>, const N: usize>(evidence: &Evidence<'_, G, N>, chosen: &[usize]) -> Vec<usize> {
    let mut order = chosen.to_vec();
    order.sort_by_key(|&c| {
        let cluster = &evidence.clusters[c];
        let first = cluster.members.iter().map(|&m| keys(&evidence.closures[m])).min();
        (Reverse(cluster.members.len()), cluster.robots, first)
    });
    order
}

/// What identifies a closure whatever its place in the input.
fn keys<G, const N: usize>(closure: &Closure<G, N>) -> (usize, usize) {
    (closure.source.index, closure.target.index)
}

fn prior_vote<const N: usize, G: Pose<N>>(
    prior: &MapTransform<G, N>,
    frames: &Frames<G, N>,
    params: &GcmParams,
) -> Vote<N> {
    let placed = frames.of(prior.target).compose(&prior.target_from_source);
    Vote {
        kind: Kind::Prior {
            bad: isotropic_covariance::<N, G>(params.prior_bad.translation, params.prior_bad.rotation),
        },
        robots: (prior.target, prior.source),
        placed: true,
        rho: placed.compose(&frames.of(prior.source).inverse()).log(),
        noise: transported(&frames.adjoint(prior.source), &prior.covariance),
        ends: [Vec::new(), Vec::new()],
    }
}

fn cluster_vote<const N: usize, G: Pose<N>>(
    evidence: &Evidence<'_, G, N>,
    frames: &Frames<G, N>,
    index: usize,
) -> Vote<N> {
    let Evidence { trajectories, closures, transforms, clusters, params, .. } = evidence;
    let cluster = &clusters[index];
    let (r, q) = cluster.robots;
    let (frame_r, q_inverse) = (frames.of(r), frames.of(q).inverse());
    let count = cluster.members.len() as f64;
    let mut rho = SVector::zeros();
    let mut noise = SMatrix::zeros();
    let mut place = SVector::zeros();
    for &m in &cluster.members {
        let closure = &closures[m];
        let source = trajectories.get(r).and_then(|t| t.pose(closure.source.index)).copied();
        let observed = frame_r.compose(&source.unwrap_or_else(G::identity));
        rho += frame_r.compose(&transforms[m]).compose(&q_inverse).log() / count;
        noise +=
            transported(&observed.adjoint(), &closure.covariance) * (evidence.noise_scale / (count * count));
        place += observed.position() / count;
    }
    let about_place = G::exp(&place).adjoint();
    let local = |sigma: super::params::Sigma| {
        transported(&about_place, &isotropic_covariance::<N, G>(sigma.translation, sigma.rotation))
    };
    Vote {
        kind: Kind::Cluster {
            cluster: index,
            first: cluster.members[0],
            single: cluster.members.len() == 1,
            spike: local(params.spike),
            yaw: local(params.yaw),
            gross: local(params.gross),
            elsewhere: local(params.elsewhere),
            neighbor: None,
        },
        robots: cluster.robots,
        placed: evidence.priors.iter().any(|p| [(r, q), (q, r)].contains(&(p.source, p.target))),
        rho,
        noise,
        ends: [
            shares(cluster.members.iter().map(|&m| closures[m].source.index)),
            shares(cluster.members.iter().map(|&m| closures[m].target.index)),
        ],
    }
}

/// Each index with its share, ascending.
fn shares(indices: impl Iterator<Item = usize>) -> Vec<(usize, f64)> {
    let mut counts: BTreeMap<usize, f64> = BTreeMap::new();
    indices.for_each(|k| *counts.entry(k).or_default() += 1.0);
    let total: f64 = counts.values().sum();
    counts.into_iter().map(|(k, n)| (k, n / total)).collect()
}

/// Ties each group's main cluster to the nearest earlier one of the same robot pair: groups cut from one run are
/// not independent.
fn link_neighbors<const N: usize, G: Pose<N>>(evidence: &Evidence<'_, G, N>, list: &mut [Vote<N>]) {
    const LEAST_KAPPA: f64 = 1e-3;
    let cluster_of = |vote: &Vote<N>| match &vote.kind {
        Kind::Cluster { cluster, single: false, .. } => {
            Some(&evidence.clusters[*cluster]).filter(|c| c.is_main)
        }
        _ => None,
    };
    for at in 0..list.len() {
        let Some(own) = cluster_of(&list[at]) else { continue };
        let nearest = (0..at)
            .filter_map(|earlier| Some((earlier, cluster_of(&list[earlier])?)))
            .filter(|(_, other)| other.robots == own.robots)
            .map(|(earlier, other)| (earlier, group_gap(evidence.stations, own, other)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((earlier, distance)) = nearest else { continue };
        let kappa = (-(distance / evidence.params.correlation).powi(2)).exp();
        if let (true, Kind::Cluster { neighbor, .. }) = (kappa > LEAST_KAPPA, &mut list[at].kind) {
            *neighbor = Some((earlier, kappa));
        }
    }
}

/// Smallest gap between two closures of the two clusters.
fn group_gap(stations: &[Station], a: &Cluster, b: &Cluster) -> f64 {
    let gaps =
        a.members.iter().flat_map(|&m| b.members.iter().map(move |&n| gap(&stations[m], &stations[n])));
    gaps.fold(f64::INFINITY, f64::min)
}

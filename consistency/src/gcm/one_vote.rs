use std::collections::BTreeMap;

use super::clusters::clusters;
use super::frames::{Frames, implied};
use super::grouping::stations;
use super::params::GcmParams;
use super::votes::{Evidence, Kind, Votes};
use crate::clique::{self, Budget};
use crate::graph::Graph;
use crate::pair_test::{gate, mahalanobis_sq};
use crate::{Closure, Error, Pose, Reason, Rejection, Selection, Trajectories, isotropic_covariance};

/// Maximum-weight clique with one vote a group, for comparison: of each robot pair the clusters that agree, weighted
/// `1 + ¼ (1 - 2^(1-n))` for `n` closures.
///
/// Better than counting closures, but it has no "undecided", breaks ties by size, and two equal slips still beat one
/// truth; [`gcm`](crate::gcm()) has the prior, the cycles and the shared slips.
///
/// # Errors
/// Unknown poses, bad poses or covariances, parameters outside their range.
pub fn one_vote<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    params: &GcmParams,
) -> Result<Selection, Error> {
    params.check()?;
    let mut selection = Selection::default();
    let limit = gate::<N>(params.probability)?;
    let spike = isotropic_covariance::<N, G>(params.spike.translation, params.spike.rotation);
    for (robots, members) in crate::pcm::by_robots(trajectories, closures)? {
        let own: Vec<_> = members.iter().map(|&m| closures[m].with_source_robot(robots.0)).collect();
        let transforms: Vec<G> = own.iter().map(|c| implied(trajectories, c)).collect();
        let stations = stations(trajectories, &own, params.unit);
        let (clusters, noise_scale) = clusters(trajectories, &own, &stations, params)?;
        let frames = Frames::new(robots.0, trajectories, &own, &transforms, &[]);
        let evidence = Evidence {
            trajectories,
            closures: &own,
            transforms: &transforms,
            stations: &stations,
            priors: &[],
            clusters: &clusters,
            noise_scale,
            params,
        };
        let chosen: Vec<usize> = (0..clusters.len()).collect();
        let votes = Votes::new(&evidence, &frames, &chosen, |_| true);
        let mut graph = Graph::new(votes.list.len())?;
        for g in 0..votes.list.len() {
            for h in 0..g {
                let cross = votes.block(g, h);
                let covariance =
                    votes.block(g, g) + votes.block(h, h) - cross - cross.transpose() + spike * 2.0;
                if mahalanobis_sq(&covariance, &(votes.list[g].rho - votes.list[h].rho)) <= limit {
                    graph.add_edge(g, h)?;
                }
            }
        }
        let cluster_at: BTreeMap<usize, usize> = (votes.list.iter().enumerate())
            .filter_map(|(at, vote)| match vote.kind {
                Kind::Cluster { cluster, .. } => Some((at, cluster)),
                Kind::Prior { .. } => None,
            })
            .collect();
        let weight = |c: &usize| 1.0 + 0.25 * (1.0 - 2f64.powi(1 - clusters[*c].members.len() as i32));
        let weights: Vec<f64> = cluster_at.values().map(weight).collect();
        let best = clique::maximum_weight(&graph.with_weights(&weights)?, &Budget::default());
        for (at, c) in cluster_at {
            let closures = clusters[c].members.iter().map(|&m| members[m]);
            if best.vertices.contains(&at) {
                selection.accepted.extend(closures);
            } else {
                let reason = Reason::TooFewVotes { size: 1, minimum: best.vertices.len() };
                selection
                    .rejected
                    .extend(closures.map(|closure| Rejection { closure, reason: reason.clone() }));
            }
        }
    }
    selection.sort();
    Ok(selection)
}

use std::collections::{BTreeMap, BTreeSet};

use super::clusters::Cluster;
use super::findings::Findings;
use super::params::GcmParams;
use crate::{Reason, Rejection, Selection};

/// What follows from a posterior probability.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// Insert its closures.
    Accepted,
    /// Leave them out.
    Rejected,
    /// The evidence does not decide; leave them out and keep them for later.
    Undecided,
}

/// The verdict of each cluster and the closures sorted by it. Clusters with a member in `held` have hysteresis.
pub(crate) fn judge(
    clusters: &[Cluster],
    findings: &Findings,
    params: &GcmParams,
    held: &BTreeSet<usize>,
    has_priors: bool,
) -> (Selection, Vec<Verdict>) {
    let verdicts: Vec<Verdict> = clusters
        .iter()
        .zip(&findings.sound)
        .map(|(cluster, &probability)| {
            let is_held = cluster.members.iter().any(|m| held.contains(m));
            let least = if is_held { params.withdraw } else { params.accept };
            if probability >= least {
                Verdict::Accepted
            } else if probability <= params.reject {
                Verdict::Rejected
            } else {
                Verdict::Undecided
            }
        })
        .collect();
    let context = Context::new(clusters, &verdicts, findings, has_priors);
    let mut selection = Selection::default();
    for (index, (cluster, verdict)) in clusters.iter().zip(&verdicts).enumerate() {
        let list = match verdict {
            Verdict::Accepted => {
                selection.accepted.extend(&cluster.members);
                continue;
            }
            Verdict::Rejected => &mut selection.rejected,
            Verdict::Undecided => &mut selection.undecided,
        };
        let reason = context.reason(index, *verdict);
        list.extend(cluster.members.iter().map(|&closure| Rejection { closure, reason: reason.clone() }));
    }
    selection.sort();
    (selection, verdicts)
}

/// What the reasons are told from.
struct Context<'a> {
    clusters: &'a [Cluster],
    findings: &'a Findings,
    /// Robot pairs with an accepted cluster.
    accepted_pairs: BTreeSet<(u32, u32)>,
    /// Clusters of at least two closures of each robot pair.
    votes: BTreeMap<(u32, u32), usize>,
    has_priors: bool,
}

impl<'a> Context<'a> {
    fn new(clusters: &'a [Cluster], verdicts: &[Verdict], findings: &'a Findings, has_priors: bool) -> Self {
        let sorted = |(a, b): (u32, u32)| (a.min(b), a.max(b));
        let accepted = clusters.iter().zip(verdicts).filter(|(_, v)| **v == Verdict::Accepted);
        let mut votes = BTreeMap::new();
        for cluster in clusters.iter().filter(|c| c.members.len() > 1) {
            *votes.entry(cluster.robots).or_default() += 1;
        }
        Self {
            clusters,
            findings,
            accepted_pairs: accepted.map(|(c, _)| sorted(c.robots)).collect(),
            votes,
            has_priors,
        }
    }

    fn reason(&self, index: usize, verdict: Verdict) -> Reason {
        let cluster = &self.clusters[index];
        let group = cluster.group;
        if verdict == Verdict::Undecided {
            let size = self.votes.get(&cluster.robots).copied().unwrap_or(0);
            return if size < 2 && !self.has_priors {
                Reason::TooFewVotes { size, minimum: 2 }
            } else {
                Reason::Ambiguous { group, probability: self.findings.sound[index] }
            };
        }
        if !cluster.is_main {
            return Reason::OutsideItsGroup { group };
        }
        let [slip, yaw, gross] = self.findings.faults[index];
        if slip >= yaw && slip >= gross {
            let (offset, members) = self.findings.slips.get(&index).cloned().unwrap_or_default();
            let offset = [0, 1, 2].map(|axis| offset.get(axis).copied().unwrap_or(0.0));
            if let Some(cycle) = self.cycle(cluster.robots) {
                return Reason::ContradictedByCycle { group, cycle, offset };
            }
            let others = members.into_iter().filter(|&m| m != index);
            let shared_with = others.map(|m| self.clusters[m].group).collect();
            Reason::Slip { group, offset, shared_with }
        } else if yaw >= gross {
            Reason::YawSlip { group }
        } else {
            Reason::Gross { group }
        }
    }

    /// The smallest third robot through which accepted clusters close a cycle with this pair.
    fn cycle(&self, (a, b): (u32, u32)) -> Option<[u32; 3]> {
        let joined = |x: u32, y: u32| self.accepted_pairs.contains(&(x.min(y), x.max(y)));
        let robots: BTreeSet<u32> = self.accepted_pairs.iter().flat_map(|&(x, y)| [x, y]).collect();
        robots.into_iter().find(|&c| c != a && c != b && joined(a, c) && joined(b, c)).map(|c| [a, b, c])
    }
}

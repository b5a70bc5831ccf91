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

/// What is to be judged: clusters, what was found of them, and what was accepted before.
pub(crate) struct Case<'a> {
    pub(crate) clusters: &'a [Cluster],
    pub(crate) findings: &'a Findings,
    pub(crate) params: &'a GcmParams,
    /// Closures whose clusters have hysteresis.
    pub(crate) held: &'a BTreeSet<usize>,
    pub(crate) has_priors: bool,
}

/// The verdict of each cluster; `team_of` names the connected team of a robot.
pub(crate) fn verdicts(case: &Case<'_>, team_of: impl Fn(u32) -> Option<u32>) -> Vec<Verdict> {
    let Case { clusters, findings, params, held, .. } = *case;
    let mut verdicts: Vec<Verdict> = clusters
        .iter()
        .zip(&findings.sound)
        .map(|(cluster, &probability)| {
            let is_held = cluster.members.iter().any(|m| held.contains(m));
            by_itself(probability, is_held, params)
        })
        .collect();
    let mut teams: BTreeMap<Option<u32>, Vec<usize>> = BTreeMap::new();
    for (index, cluster) in clusters.iter().enumerate() {
        teams.entry(team_of(cluster.robots.0)).or_default().push(index);
    }
    for team in teams.values() {
        accept_in_company(team, &findings.sound, params, &mut verdicts);
    }
    verdicts
}

/// The closures sorted by the verdict of their cluster, with reasons.
pub(crate) fn sort(case: &Case<'_>, verdicts: &[Verdict]) -> Selection {
    let context = Context::new(case, verdicts);
    let mut selection = Selection::default();
    for (index, (cluster, verdict)) in case.clusters.iter().zip(verdicts).enumerate() {
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
    selection
}

/// The verdict of a cluster whatever the others are.
fn by_itself(probability: f64, is_held: bool, params: &GcmParams) -> Verdict {
    let least = if is_held { params.withdraw } else { params.accept };
    if probability >= least {
        Verdict::Accepted
    } else if probability <= params.reject {
        Verdict::Rejected
    } else {
        Verdict::Undecided
    }
}

/// Accepts further clusters of a team, the surest first, down to `params.accept_among`, as long as the expected share
/// of wrong ones among all accepted, the mean of `1 - P`, stays within `params.wrong_share`. Equally sure ones go
/// together.
fn accept_in_company(team: &[usize], sound: &[f64], params: &GcmParams, verdicts: &mut [Verdict]) {
    // what differs by rounding alone, as two votes of equal weight do
    const EQUAL: f64 = 1e-6;
    let (accepted, mut others): (Vec<usize>, Vec<usize>) =
        team.iter().partition(|&&c| verdicts[c] == Verdict::Accepted);
    others.retain(|&c| sound[c] >= params.accept_among);
    others.sort_by(|&a, &b| sound[b].total_cmp(&sound[a]).then(a.cmp(&b)));
    let mut count = accepted.len() as f64;
    let mut wrong: f64 = accepted.iter().map(|&c| 1.0 - sound[c]).sum();
    for equals in others.chunk_by(|&a, &b| sound[a] - sound[b] < EQUAL) {
        count += equals.len() as f64;
        wrong += equals.iter().map(|&c| 1.0 - sound[c]).sum::<f64>();
        if wrong > params.wrong_share * count {
            break;
        }
        equals.iter().for_each(|&c| verdicts[c] = Verdict::Accepted);
    }
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
    fn new(case: &Case<'a>, verdicts: &[Verdict]) -> Self {
        let Case { clusters, findings, has_priors, .. } = *case;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Clusters of one closure each; robots `2 t` and `2 t + 1` are team `t`.
    fn verdicts_of(told: &[(u32, f64)], params: &GcmParams, held: &[usize]) -> Vec<Verdict> {
        let clusters: Vec<Cluster> = told
            .iter()
            .enumerate()
            .map(|(index, &(team, _))| Cluster {
                robots: (2 * team, 2 * team + 1),
                group: index,
                members: vec![index],
                is_main: true,
            })
            .collect();
        let mut findings = Findings::new(told.len());
        findings.sound = told.iter().map(|&(_, p)| p).collect();
        let held = held.iter().copied().collect();
        let case = Case { clusters: &clusters, findings: &findings, params, held: &held, has_priors: true };
        verdicts(&case, |robot| Some(robot / 2))
    }

    fn accepted(told: &[(u32, f64)], held: &[usize]) -> Vec<usize> {
        let params = GcmParams { accept: 0.85, accept_among: 0.75, wrong_share: 0.05, ..Default::default() };
        let verdicts = verdicts_of(told, &params, held);
        (0..told.len()).filter(|&c| verdicts[c] == Verdict::Accepted).collect()
    }

    #[test]
    fn a_doubtful_group_is_accepted_among_sure_ones_only() {
        // expected wrong: (3 x 0.001 + 0.2) / 4 = 0.051, with a fourth sure one 0.041
        assert_eq!(accepted(&[(0, 0.999), (0, 0.8), (0, 0.999), (0, 0.999)], &[]), [0, 2, 3]);
        assert_eq!(
            accepted(&[(0, 0.999), (0, 0.8), (0, 0.999), (0, 0.999), (0, 0.999)], &[]),
            [0, 1, 2, 3, 4]
        );
    }

    #[test]
    fn the_surest_come_first_and_none_below_the_floor() {
        let sure = [(0, 1.0); 6];
        let with = |more: &[(u32, f64)]| accepted(&[&sure[..], more].concat(), &[])[6..].to_vec();
        assert_eq!(with(&[(0, 0.77), (0, 0.82)]), [7]);
        assert_eq!(with(&[(0, 0.84), (0, 0.81)]), [6, 7]);
        assert_eq!(with(&[(0, 0.74)]), []);
    }

    #[test]
    fn groups_sure_by_themselves_need_no_company() {
        assert_eq!(accepted(&[(0, 0.86), (0, 0.86), (0, 0.84)], &[]), [0, 1]);
    }

    #[test]
    fn equally_sure_groups_share_their_verdict() {
        // one of the two would fit: (0.17 / 5 = 0.034, 0.34 / 6 = 0.057)
        let told = [(0, 1.0), (0, 1.0), (0, 1.0), (0, 1.0), (0, 0.83), (0, 0.83 + 1e-9)];
        assert_eq!(accepted(&told, &[]), [0, 1, 2, 3]);
    }

    #[test]
    fn another_team_is_no_company() {
        assert_eq!(accepted(&[(0, 1.0), (0, 1.0), (0, 1.0), (0, 1.0), (1, 0.84)], &[]), [0, 1, 2, 3]);
    }

    #[test]
    fn what_was_accepted_before_stays_and_counts_as_company() {
        // the one held at 0.65 leaves no room: (0.35 + 0.2) / 6 = 0.092
        let told = [(0, 1.0), (0, 1.0), (0, 1.0), (0, 1.0), (0, 0.65), (0, 0.8)];
        assert_eq!(accepted(&told, &[]), [0, 1, 2, 3, 5]);
        assert_eq!(accepted(&told, &[4]), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn without_a_share_of_wrong_ones_each_stands_alone() {
        let params = GcmParams { accept: 0.85, accept_among: 0.75, wrong_share: 0.0, ..Default::default() };
        let told = [(0, 1.0), (0, 1.0), (0, 1.0), (0, 1.0), (0, 0.84), (0, 0.2)];
        let verdicts = verdicts_of(&told, &params, &[]);
        assert_eq!(verdicts[4..], [Verdict::Undecided, Verdict::Rejected]);
    }
}

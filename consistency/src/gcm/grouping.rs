use std::collections::BTreeMap;

use super::params::{GapUnit, GcmParams};
use crate::{Closure, Pose, Trajectories};

/// Where a closure lies on both robots' paths, in the unit of the gaps.
pub(crate) type Station = [f64; 2];

/// The station of each closure (canonical direction).
pub(crate) fn stations<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    unit: GapUnit,
) -> Vec<Station> {
    let mut lengths: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    if unit == GapUnit::Metres {
        for robot in trajectories.robots() {
            let poses = trajectories.get(robot).map_or(&[][..], |t| t.poses());
            let mut sum = 0.0;
            let mut path = vec![0.0];
            path.extend(poses.windows(2).map(|w| {
                sum += (w[1].position() - w[0].position()).norm();
                sum
            }));
            lengths.insert(robot, path);
        }
    }
    let station = |key: crate::PoseKey| match lengths.get(&key.robot) {
        Some(path) => path[key.index],
        None => key.index as f64,
    };
    closures.iter().map(|c| [station(c.source), station(c.target)]).collect()
}

/// The larger of the two robots' gaps.
pub(crate) fn gap(a: &Station, b: &Station) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

/// The groups of one robot pair: single linkage over `members` in ascending gap, a merge refused when the group
/// would reach the largest extent. Each group is ascending; groups are ordered by their smallest member.
///
/// Coarse is the safe side: cutting a true group lets one slip cast several votes, while a mixture in one group is
/// taken apart again by the pair tests inside it.
pub(crate) fn groups(members: &[usize], stations: &[Station], params: &GcmParams) -> Vec<Vec<usize>> {
    // sorted along the first robot, so that a link's partner is found within the gap
    let mut order: Vec<usize> = members.to_vec();
    order.sort_by(|&m, &n| stations[m][0].total_cmp(&stations[n][0]).then(m.cmp(&n)));
    let mut links = Vec::new();
    for (at, &m) in order.iter().enumerate() {
        for &n in &order[at + 1..] {
            if stations[n][0] - stations[m][0] > params.gap {
                break;
            }
            let distance = gap(&stations[m], &stations[n]);
            if distance <= params.gap {
                links.push((distance, m.min(n), m.max(n)));
            }
        }
    }
    links.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));

    let mut group_of: BTreeMap<usize, usize> = members.iter().map(|&m| (m, m)).collect();
    let mut groups: BTreeMap<usize, Span> = members.iter().map(|&m| (m, Span::of(m, stations[m]))).collect();
    for (_, m, n) in links {
        let (a, b) = (group_of[&m], group_of[&n]);
        let (a, b) = (a.min(b), a.max(b));
        if a == b {
            continue;
        }
        let merged = groups[&a].union(&groups[&b]);
        if merged.extent() < params.extent {
            merged.members.iter().for_each(|&member| {
                group_of.insert(member, a);
            });
            groups.remove(&b);
            groups.insert(a, merged);
        }
    }
    groups
        .into_values()
        .map(|span| {
            let mut members = span.members;
            members.sort_unstable();
            members
        })
        .collect()
}

struct Span {
    members: Vec<usize>,
    least: Station,
    most: Station,
}

impl Span {
    fn of(member: usize, at: Station) -> Self {
        Self { members: vec![member], least: at, most: at }
    }

    fn union(&self, other: &Self) -> Self {
        let least = [self.least[0].min(other.least[0]), self.least[1].min(other.least[1])];
        let most = [self.most[0].max(other.most[0]), self.most[1].max(other.most[1])];
        let members = self.members.iter().chain(&other.members).copied().collect();
        Self { members, least, most }
    }

    fn extent(&self) -> f64 {
        (self.most[0] - self.least[0]).max(self.most[1] - self.least[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_runs_are_cut_and_far_closures_stay_apart() {
        let stations: Vec<Station> =
            (0..30).map(|k| [f64::from(k), f64::from(k)]).chain([[50.0, 0.0]]).collect();
        let members: Vec<usize> = (0..31).collect();
        let found = groups(&members, &stations, &GcmParams::default());
        assert!(found.iter().all(|g| stations[g[g.len() - 1]][0] - stations[g[0]][0] < 12.0));
        assert_eq!(found.last(), Some(&vec![30]));
        assert_eq!(found.iter().map(Vec::len).sum::<usize>(), 31);
    }
}

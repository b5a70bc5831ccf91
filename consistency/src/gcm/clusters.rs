use std::collections::BTreeMap;

use draco_lie::chi2;

use super::grouping::{Station, gap, groups};
use super::params::GcmParams;
use crate::clique::{self, Budget};
use crate::graph::Graph;
use crate::pair_test::gate;
use crate::{Closure, Error, PairTest, Pose, Trajectories};

/// Closures of one group that tell of the same map transform: one vote.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cluster {
    /// Source and target robot.
    pub(crate) robots: (u32, u32),
    /// Smallest closure of the whole group.
    pub(crate) group: usize,
    /// Ascending.
    pub(crate) members: Vec<usize>,
    /// Whether it is the largest of its group.
    pub(crate) is_main: bool,
}

/// The clusters of all robot pairs, by (robot pair, group, size), and the factor by which the noise was understated.
pub(crate) fn clusters<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    stations: &[Station],
    params: &GcmParams,
) -> Result<(Vec<Cluster>, f64), Error> {
    let mut pairs: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (index, closure) in closures.iter().enumerate() {
        pairs.entry((closure.source.robot, closure.target.robot)).or_default().push(index);
    }
    let mut all = Vec::new();
    for (robots, members) in &pairs {
        for group in groups(members, stations, params) {
            let pairwise = Pairwise::new(trajectories, closures, &group)?;
            all.push((*robots, group, pairwise));
        }
    }
    let (scale, splits) = normalized::<N>(&all, stations, params)?;
    let mut found = Vec::new();
    for ((robots, group, _), split) in all.iter().zip(splits) {
        for (rank, local) in split.into_iter().enumerate() {
            let members = local.iter().map(|&m| group[m]).collect();
            found.push(Cluster { robots: *robots, group: group[0], members, is_main: rank == 0 });
        }
    }
    Ok((found, scale))
}

type Group = ((u32, u32), Vec<usize>, Pairwise);
type Split = Vec<Vec<usize>>;

/// The factor by which the noise was understated, within [1, 9], and each group split at the gate it gives.
///
/// A cluster's inner scatter is free of its bias, so the median χ² of its close pairs over its expectation tells how
/// far the covariances understate the noise. Groups that hold truth and slips side by side inflate the median, so
/// it starts from all close pairs and comes down: split, measure inside the clusters, split again.
fn normalized<const N: usize>(
    all: &[Group],
    stations: &[Station],
    params: &GcmParams,
) -> Result<(f64, Vec<Split>), Error> {
    const FEWEST_PAIRS: usize = 10;
    const ROUNDS: usize = 8;
    const SETTLED: f64 = 0.98;
    let gate = gate::<N>(params.probability)?;
    let expected = chi2::quantile(0.5, N).map_err(|_| Error::Probability { value: 0.5 })?;
    // neighbours in place and time share their bias, members at the two ends of a long group need not
    let close = |a: usize, b: usize| gap(&stations[a], &stations[b]) <= 0.5 * params.gap;
    let mut scale = 9.0f64;
    let mut splits: Vec<Split> = all.iter().map(|(_, group, _)| vec![(0..group.len()).collect()]).collect();
    for _ in 0..ROUNDS {
        let mut distances = Vec::new();
        for ((_, group, pairwise), split) in all.iter().zip(&splits) {
            for members in split {
                for (at, &m) in members.iter().enumerate() {
                    let others = members[at + 1..].iter().filter(|&&n| close(group[m], group[n]));
                    distances.extend(others.map(|&n| pairwise.get(m, n)).filter(|d| d.is_finite()));
                }
            }
        }
        let last = scale;
        scale = if distances.len() < FEWEST_PAIRS {
            1.0
        } else {
            (lower_median(&mut distances) / expected).clamp(1.0, scale)
        };
        splits =
            all.iter().map(|(_, _, pairwise)| split(pairwise, gate * scale)).collect::<Result<_, _>>()?;
        if scale > SETTLED * last || scale == 1.0 {
            break;
        }
    }
    Ok((scale, splits))
}

/// χ² of all pairs of one group.
struct Pairwise {
    n: usize,
    chi2: Vec<f64>,
}

impl Pairwise {
    fn new<const N: usize, G: Pose<N>>(
        trajectories: &Trajectories<G, N>,
        closures: &[Closure<G, N>],
        group: &[usize],
    ) -> Result<Self, Error> {
        let subset: Vec<_> = group.iter().map(|&m| closures[m]).collect();
        let test = PairTest::new(trajectories, &subset, 0.5)?;
        let n = group.len();
        let mut chi2 = vec![0.0; n * n];
        for m in 0..n {
            for other in m + 1..n {
                let value = test.chi2(m, other);
                chi2[m * n + other] = value;
                chi2[other * n + m] = value;
            }
        }
        Ok(Self { n, chi2 })
    }

    fn get(&self, m: usize, other: usize) -> f64 {
        self.chi2[m * self.n + other]
    }
}

fn lower_median(values: &mut [f64]) -> f64 {
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Largest consistent set, what else is near its members in the median, then the same on the rest.
fn split(pairwise: &Pairwise, limit: f64) -> Result<Vec<Vec<usize>>, Error> {
    let mut rest: Vec<usize> = (0..pairwise.n).collect();
    let mut found = Vec::new();
    while !rest.is_empty() {
        let n = rest.len();
        let agree = |m: usize, other: usize| pairwise.get(rest[m], rest[other]) <= limit;
        let pairs = (0..n).flat_map(|m| (m + 1..n).map(move |other| (m, other)));
        let graph = Graph::from_edges(n, pairs.filter(|&(m, other)| agree(m, other)))?;
        let chosen = clique::maximum(&graph, &Budget::default()).vertices;
        let mut members: Vec<usize> = chosen.iter().map(|&m| rest[m]).collect();
        let core = members.clone();
        rest.retain(|m| !core.contains(m));
        if core.len() > 1 {
            rest.retain(|&m| {
                let mut to_core: Vec<f64> = core.iter().map(|&c| pairwise.get(m, c)).collect();
                let readmitted = lower_median(&mut to_core) < limit;
                if readmitted {
                    members.push(m);
                }
                !readmitted
            });
        }
        if core.is_empty() {
            break;
        }
        members.sort_unstable();
        found.push(members);
    }
    Ok(found)
}

use std::collections::BTreeMap;

use draco_lie::chi2;

use super::grouping::{Station, groups};
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
    let mut distances = Vec::new();
    for (robots, members) in &pairs {
        for group in groups(members, stations, params) {
            let pairwise = Pairwise::new(trajectories, closures, &group)?;
            distances.extend(pairwise.upper().filter(|d| d.is_finite()));
            all.push((*robots, group, pairwise));
        }
    }
    let scale = noise_scale::<N>(&mut distances)?;
    let limit = gate::<N>(params.probability)? * scale;
    let mut found = Vec::new();
    for (robots, group, pairwise) in &all {
        for (rank, local) in split(pairwise, limit)?.into_iter().enumerate() {
            let members = local.iter().map(|&m| group[m]).collect();
            found.push(Cluster { robots: *robots, group: group[0], members, is_main: rank == 0 });
        }
    }
    Ok((found, scale))
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

    fn upper(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.n).flat_map(move |m| (m + 1..self.n).map(move |other| self.get(m, other)))
    }
}

/// Median χ² over its expectation, within [1, 9]: a group's inner scatter is free of its bias, so it tells how far
/// the covariances understate the noise.
fn noise_scale<const N: usize>(distances: &mut [f64]) -> Result<f64, Error> {
    const FEWEST_PAIRS: usize = 10;
    if distances.len() < FEWEST_PAIRS {
        return Ok(1.0);
    }
    let median = chi2::quantile(0.5, N).map_err(|_| Error::Probability { value: 0.5 })?;
    Ok((lower_median(distances) / median).clamp(1.0, 9.0))
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

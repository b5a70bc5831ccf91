use std::collections::BTreeMap;

use crate::clique::{self, Budget};
use crate::graph::{Adjacency, Graph};
use crate::{Closure, Error, FailedPair, PairTest, Pose, Reason, Rejection, Selection, Trajectories};

/// Parameters of [`pcm`].
#[derive(Debug, Clone, PartialEq)]
pub struct PcmParams {
    /// Share of true pairs that pass the pair test; default 0.99. The χ² limit follows from it and from the
    /// degrees of freedom (11.345 in the plane, 16.812 in space).
    pub probability: f64,
    /// Factor on all covariances; default 1, they are taken at their word.
    /// [`covariance_scale`](crate::covariance_scale) measures it.
    pub scale: f64,
    /// Least size of a set that is believed; default 3, since two closures agree by chance far more often.
    pub minimum: usize,
    /// Limit of the clique search of one robot pair; default none.
    pub budget: Budget,
}

impl Default for PcmParams {
    fn default() -> Self {
        Self { probability: 0.99, scale: 1.0, minimum: 3, budget: Budget::default() }
    }
}

/// Pairwise consistency maximisation: of each robot pair the largest set of closures in which every two agree.
///
/// Vertices are closures, an edge is a passed [`PairTest`], the answer is a maximum clique found exactly. Closures
/// are split by robot pair (closures within one robot form a set of their own), and each set is solved by itself.
///
/// Use it when outliers are independent. When many closures of one place are wrong *together* they support each
/// other and the larger group wins; [`gcm`](crate::gcm()) is made for that.
///
/// # Errors
/// Unknown poses, poses that are not finite, covariances that are not positive definite, a bad probability.
///
/// Cost: `n²/2` pair tests a robot pair, then the clique search.
///
/// **Source**: Mangelson, Dominic, Eustice, Vasudevan, *Pairwise consistent measurement set maximization*, ICRA
/// 2018. Here the pair test also has the covariance of the odometry between the closures.
pub fn pcm<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    params: &PcmParams,
) -> Result<Selection, Error> {
    let mut selection = Selection::default();
    for members in by_robots(trajectories, closures)?.values() {
        let subset: Vec<_> = members.iter().map(|&m| closures[m]).collect();
        let test = PairTest::new(trajectories, &subset, params.probability)?.with_scale(params.scale)?;
        let chosen = largest_consistent(&test, &params.budget)?;
        judge(&test, members, &chosen, params.minimum, &mut selection);
    }
    selection.sort();
    Ok(selection)
}

/// Indices of the closures of each robot pair, after a check of every closure.
pub(crate) fn by_robots<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
) -> Result<BTreeMap<(u32, u32), Vec<usize>>, Error> {
    let mut pairs: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, closure) in closures.iter().enumerate() {
        closure.check(index)?;
        trajectories.of(index, closure.source)?;
        trajectories.of(index, closure.target)?;
        pairs.entry(closure.robots()).or_default().push(index);
    }
    Ok(pairs)
}

/// A maximum clique of the pair tests, ascending.
pub(crate) fn largest_consistent<const N: usize, G: Pose<N>>(
    test: &PairTest<'_, G, N>,
    budget: &Budget,
) -> Result<Vec<usize>, Error> {
    let mut graph = Graph::new(test.len())?;
    for m in 0..test.len() {
        for n in m + 1..test.len() {
            if test.agree(m, n) {
                graph.add_edge(m, n)?;
            }
        }
    }
    let mut vertices = clique::maximum(&graph, budget).vertices;
    debug_assert!(graph.is_clique(&vertices));
    vertices.sort_unstable();
    Ok(vertices)
}

/// Sorts one robot pair's closures into accepted and rejected. `chosen` counts within `members`.
pub(crate) fn judge<const N: usize, G: Pose<N>>(
    test: &PairTest<'_, G, N>,
    members: &[usize],
    chosen: &[usize],
    minimum: usize,
    selection: &mut Selection,
) {
    let believed = chosen.len() >= minimum;
    for (local, &closure) in members.iter().enumerate() {
        let is_chosen = chosen.binary_search(&local).is_ok();
        if believed && is_chosen {
            selection.accepted.push(closure);
            continue;
        }
        let failed = if is_chosen { Vec::new() } else { failed_pairs(test, members, chosen, local) };
        // outside a maximum clique at least one pair fails; outside a clique cut short by the budget maybe none
        let reason = if believed && !failed.is_empty() {
            Reason::Inconsistent { failed }
        } else {
            Reason::TooFewVotes { size: chosen.len(), minimum }
        };
        selection.rejected.push(Rejection { closure, reason });
    }
}

fn failed_pairs<const N: usize, G: Pose<N>>(
    test: &PairTest<'_, G, N>,
    members: &[usize],
    chosen: &[usize],
    local: usize,
) -> Vec<FailedPair> {
    let limit = test.limit();
    let pairs = chosen.iter().map(|&other| (other, test.chi2(local, other)));
    pairs
        .filter(|(_, chi2)| *chi2 > limit)
        .map(|(other, chi2)| FailedPair { with: members[other], chi2, limit })
        .collect()
}

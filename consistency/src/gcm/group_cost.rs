use super::pooled::{StarClosure, star_closures};
use crate::clique::{self, Budget};
use crate::graph::Graph;
use crate::pair_test::mahalanobis_sq;
use crate::pcm::{by_robots, judge};
use crate::{Closure, Error, MapTransform, PairTest, Pose, Reason, Rejection, Selection, Trajectories};

/// How the distances from one closure to its group's members become one cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aggregate {
    /// The median.
    Median,
    /// The mean of Huber losses with this bend, as a distance again.
    Huber(f64),
}

/// What the consistent set of a robot pair maximises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// Its number of closures.
    Count,
    /// The sum of `1 / (1 + cost)` of its closures.
    Weighted,
}

/// Parameters of [`gcm_group`].
#[derive(Debug, Clone, PartialEq)]
pub struct GroupParams {
    /// The robot in whose map all are compared.
    pub reference: u32,
    /// Closures within this distance in the reference robot's map are of one place; default 20 m.
    pub place: f64,
    /// Closures within this many poses of the reference robot are of one time; default 6.
    pub time: usize,
    /// How distances become a cost; default the median.
    pub aggregate: Aggregate,
    /// Largest cost (a Mahalanobis distance) of a closure that is kept; default 2.5.
    pub limit: f64,
    /// What the set of each robot pair maximises; default its count.
    pub objective: Objective,
    /// Pair test of the closures that are kept; default 0.99.
    pub probability: f64,
    /// Least size of a robot pair's set; default 3.
    pub minimum: usize,
    /// Limit of the clique search of one robot pair; default none.
    pub budget: Budget,
}

impl Default for GroupParams {
    fn default() -> Self {
        Self {
            reference: 0,
            place: 20.0,
            time: 6,
            aggregate: Aggregate::Median,
            limit: 2.5,
            objective: Objective::Count,
            probability: 0.99,
            minimum: 3,
            budget: Budget::default(),
        }
    }
}

/// The published group cost: closures of one place and time are compared **across neighbours** through the
/// map-to-map transforms, those that cost too much are dropped, the rest goes through pairwise consistency.
///
/// The cost of closure `m` is an aggregate (median, Huber) of the Mahalanobis distances of
/// `log(Z_m⁻¹ (T X)⁻¹ … )`, the loop through every other closure of its group, with the covariance of both
/// measurements. A group that is biased as a whole sees only itself and stays cheap, so use [`gcm`](crate::gcm())
/// where that can happen; this one is the comparison.
///
/// Closures that do not touch `params.reference` or whose neighbour has no prior are rejected.
///
/// # Errors
/// Unknown poses, bad poses, covariances or priors, a bad probability.
///
/// **Source**: Huang et al., DRACo-SLAM2, 2025, group-wise consistency, as far as its text fixes it.
pub fn gcm_group<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &GroupParams,
) -> Result<Selection, Error> {
    let mut selection = Selection::default();
    let pool = star_closures(trajectories, closures, priors, params.reference, &mut selection)?;
    let mut kept = Vec::new();
    let mut costs = vec![0.0; closures.len()];
    for (m, own) in pool.iter().enumerate() {
        let key = reference_index(&closures[own.closure], params.reference);
        let distances = pool.iter().enumerate().filter(|(n, other)| {
            let gap = key.abs_diff(reference_index(&closures[other.closure], params.reference));
            *n != m && gap <= params.time && near(own, other, params.place)
        });
        let cost = params.aggregate.of(distances.map(|(_, other)| own.distance(other)).collect());
        costs[own.closure] = cost;
        if cost <= params.limit {
            kept.push(own.closure);
        } else {
            let reason = Reason::GroupCost { cost, limit: params.limit };
            selection.rejected.push(Rejection { closure: own.closure, reason });
        }
    }
    let kept_closures: Vec<_> = kept.iter().map(|&m| closures[m]).collect();
    for members in by_robots(trajectories, &kept_closures)?.values() {
        let subset: Vec<_> = members.iter().map(|&m| kept_closures[m]).collect();
        let original: Vec<usize> = members.iter().map(|&m| kept[m]).collect();
        let test = PairTest::new(trajectories, &subset, params.probability)?;
        let chosen = best_set(&test, &original, &costs, params)?;
        judge(&test, &original, &chosen, params.minimum, &mut selection);
    }
    selection.sort();
    Ok(selection)
}

fn best_set<const N: usize, G: Pose<N>>(
    test: &PairTest<'_, G, N>,
    closures: &[usize],
    costs: &[f64],
    params: &GroupParams,
) -> Result<Vec<usize>, Error> {
    let n = test.len();
    let pairs = (0..n).flat_map(|m| (m + 1..n).map(move |other| (m, other)));
    let graph = Graph::from_edges(n, pairs.filter(|&(m, other)| test.agree(m, other)))?;
    let mut chosen = match params.objective {
        Objective::Count => clique::maximum(&graph, &params.budget).vertices,
        Objective::Weighted => {
            let weights: Vec<f64> = closures.iter().map(|&m| 1.0 / (1.0 + costs[m])).collect();
            clique::maximum_weight(&graph.with_weights(&weights)?, &params.budget).vertices
        }
    };
    chosen.sort_unstable();
    Ok(chosen)
}

impl Aggregate {
    /// The cost of these Mahalanobis distances; none at all cost nothing.
    fn of(self, mut distances: Vec<f64>) -> f64 {
        if distances.is_empty() {
            return 0.0;
        }
        match self {
            Self::Median => {
                distances.sort_by(f64::total_cmp);
                distances[distances.len() / 2]
            }
            Self::Huber(bend) => {
                let loss = |d: f64| if d <= bend { d * d } else { bend * (2.0 * d - bend) };
                (distances.iter().map(|&d| loss(d)).sum::<f64>() / distances.len() as f64).sqrt()
            }
        }
    }
}

impl<G: Pose<N>, const N: usize> StarClosure<G, N> {
    /// Mahalanobis distance of the loop through both closures, covariance of both.
    fn distance(&self, other: &Self) -> f64 {
        let odometry = other.source_pose.between(&self.source_pose);
        let error = self.placed_source.inverse().compose(&other.placed_source).compose(&odometry);
        let moved = crate::pose::transported(&odometry.inverse().adjoint(), &other.covariance);
        mahalanobis_sq(&(self.covariance + moved), &error.log()).sqrt()
    }
}

fn near<const N: usize, G: Pose<N>>(a: &StarClosure<G, N>, b: &StarClosure<G, N>, place: f64) -> bool {
    (a.source_pose.position() - b.source_pose.position()).norm() <= place
}

/// The pose index on the reference robot's side.
fn reference_index<const N: usize, G: Pose<N>>(closure: &Closure<G, N>, reference: u32) -> usize {
    if closure.source.robot == reference { closure.source.index } else { closure.target.index }
}

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};

use crate::clique::{self, Budget};
use crate::graph::Graph;
use crate::pair_test::{gate, mahalanobis_sq};
use crate::{Closure, Error, FailedPair, MapTransform, Pose, Reason, Rejection, Selection, Trajectories};

/// Parameters of [`gcm_pooled`].
#[derive(Debug, Clone, PartialEq)]
pub struct PooledParams {
    /// The robot in whose map all are compared.
    pub reference: u32,
    /// Share of the χ² gate; default 0.99 (χ² 11.345 in the plane).
    pub probability: f64,
    /// Least size of the accepted set; default 5.
    pub minimum: usize,
    /// Limit of the clique search; default none.
    pub budget: Budget,
}

impl Default for PooledParams {
    fn default() -> Self {
        Self { reference: 0, probability: 0.99, minimum: 5, budget: Budget::default() }
    }
}

/// The released rule of DRACo-SLAM2, for comparison: one clique over the closures of **all** neighbours, every
/// neighbour's pose put into the reference map by its prior.
///
/// ```text
/// e = s( Z_ik⁻¹ (T_ab X_bi)⁻¹ (T_ac X_cj) Z_jl (X_al⁻¹ X_ak) )        eᵀ S_ik⁻¹ e < limit
/// ```
///
/// with plain coordinates `s` and the covariance of the **first** closure alone, as it was coded. With correct
/// priors it asks that the corrections of all neighbours agree; the priors' own error is not in the gate, so it is
/// right only where the priors are good to well under the gate. Use [`gcm`](crate::gcm()) instead; this one is here so
/// that both can be compared.
///
/// Closures that do not touch `params.reference` are rejected with [`Reason::NotOfReference`], those of a neighbour
/// without prior with [`Reason::NoMapTransform`].
///
/// # Errors
/// Unknown poses, bad poses, covariances or priors, a bad probability.
///
/// **Source**: the program of Huang et al., DRACo-SLAM2, 2025 (consistency type 2). The queue that cuts unchecked
/// closures to five in arbitrary order is left out: nothing is forgotten here.
pub fn gcm_pooled<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    params: &PooledParams,
) -> Result<Selection, Error> {
    let limit = gate::<N>(params.probability)?;
    let mut selection = Selection::default();
    let pool = star_closures(trajectories, closures, priors, params.reference, &mut selection)?;
    let mut graph = Graph::new(pool.len())?;
    for (m, first) in pool.iter().enumerate() {
        for (n, second) in pool.iter().enumerate().skip(m + 1) {
            if first.chi2(second) < limit {
                graph.add_edge(m, n)?;
            }
        }
    }
    let mut chosen = clique::maximum(&graph, &params.budget).vertices;
    chosen.sort_unstable();
    let believed = chosen.len() >= params.minimum;
    for (m, own) in pool.iter().enumerate() {
        let is_chosen = chosen.binary_search(&m).is_ok();
        if believed && is_chosen {
            selection.accepted.push(own.closure);
            continue;
        }
        let failed: Vec<FailedPair> = chosen
            .iter()
            .map(|&n| (n, pool[m.min(n)].chi2(&pool[m.max(n)])))
            .filter(|&(n, chi2)| n != m && chi2 >= limit)
            .map(|(n, chi2)| FailedPair { with: pool[n].closure, chi2, limit })
            .collect();
        let reason = if believed && !failed.is_empty() {
            Reason::Inconsistent { failed }
        } else {
            Reason::TooFewVotes { size: chosen.len(), minimum: params.minimum }
        };
        selection.rejected.push(Rejection { closure: own.closure, reason });
    }
    selection.sort();
    Ok(selection)
}

/// A closure between the reference robot (the source) and a neighbour whose map has a prior place.
pub(crate) struct StarClosure<G, const N: usize> {
    pub(crate) closure: usize,
    pub(crate) source_pose: G,
    /// `(T_ab X_bi) Z`: where the closure puts the source pose in the reference map.
    pub(crate) placed_source: G,
    pub(crate) covariance: SMatrix<f64, N, N>,
}

impl<G: Pose<N>, const N: usize> StarClosure<G, N> {
    fn chi2(&self, second: &Self) -> f64 {
        let odometry = second.source_pose.between(&self.source_pose);
        let error = self.placed_source.inverse().compose(&second.placed_source).compose(&odometry);
        mahalanobis_sq(&self.covariance, &plain_coordinates(&error))
    }
}

/// Translation and rotation vector side by side, not the logarithm.
fn plain_coordinates<const N: usize, G: Pose<N>>(pose: &G) -> SVector<f64, N> {
    let (position, log) = (pose.position(), pose.log());
    SVector::from_fn(|row, _| if row < G::TRANSLATION { position[row] } else { log[row] })
}

/// The closures that touch `reference`, turned so that it holds the source; the others go to `selection`.
pub(crate) fn star_closures<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    priors: &[MapTransform<G, N>],
    reference: u32,
    selection: &mut Selection,
) -> Result<Vec<StarClosure<G, N>>, Error> {
    let places = places_in(reference, priors)?;
    let mut pool = Vec::new();
    for (index, closure) in closures.iter().enumerate() {
        closure.check(index)?;
        let (first, second) = closure.robots();
        let mut reject = |reason| selection.rejected.push(Rejection { closure: index, reason });
        if first == second || (first != reference && second != reference) {
            reject(Reason::NotOfReference { reference });
            continue;
        }
        let turned = closure.with_source_robot(reference);
        let Some(place) = places.get(&turned.target.robot) else {
            reject(Reason::NoMapTransform { robot: turned.target.robot });
            continue;
        };
        let source_pose = trajectories.of(index, turned.source)?.poses()[turned.source.index];
        let target_pose = trajectories.of(index, turned.target)?.poses()[turned.target.index];
        let placed_source =
            place.target_from_source.compose(&target_pose).compose(&turned.target_from_source);
        pool.push(StarClosure { closure: index, source_pose, placed_source, covariance: turned.covariance });
    }
    Ok(pool)
}

/// The prior place of each robot's map in the reference map; of two the later one counts.
pub(crate) fn places_in<const N: usize, G: Pose<N>>(
    reference: u32,
    priors: &[MapTransform<G, N>],
) -> Result<BTreeMap<u32, MapTransform<G, N>>, Error> {
    let mut places = BTreeMap::new();
    for (index, prior) in priors.iter().enumerate() {
        prior.check(index)?;
        let turned = if prior.source == reference { prior.reversed() } else { *prior };
        if turned.target == reference {
            places.insert(turned.source, turned);
        }
    }
    Ok(places)
}

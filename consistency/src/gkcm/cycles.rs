use std::collections::BTreeSet;

use nalgebra::{SMatrix, SVector};

use super::{KConsistency, select};
use crate::clique::Budget;
use crate::gcm::{Frames, implied};
use crate::pair_test::{gate, mahalanobis_sq, scaled};
use crate::pose::transported;
use crate::{Closure, Error, PairTest, Pose, Reason, Rejection, Trajectories, hyperclique};

/// Parameters of [`cycle_consistency`].
#[derive(Debug, Clone, PartialEq)]
pub struct CycleParams {
    /// Share of true pairs and of true cycles that shall pass; default 0.99.
    pub probability: f64,
    /// Factor on all covariances; default 1, they are taken at their word.
    /// [`covariance_scale`](crate::covariance_scale) measures it.
    pub scale: f64,
    /// Least size of a set that is believed; default 3.
    pub minimum: usize,
    /// Limit of the hyperclique search; default none.
    pub budget: Budget,
}

impl Default for CycleParams {
    fn default() -> Self {
        Self { probability: 0.99, scale: 1.0, minimum: 3, budget: Budget::default() }
    }
}

/// The largest set of inter-robot closures of which every three agree: pairs of the same two robots by [`PairTest`],
/// closures a-b, b-c, c-a by the cycle they close.
///
/// The cycle needs no prior: with `ρ_m = Log(F_r T_m F_q⁻¹)` in one common frame, `e = ± ρ_ab ± ρ_bc ± ρ_ca` vanishes
/// but for the noise of the three measurements and the drift of each robot between its two poses. Sets of three that
/// close nothing are consistent.
///
/// Closures within one robot are rejected, as no cycle passes through them.
///
/// # Errors
/// Unknown poses, bad poses or covariances, a bad probability.
pub fn cycle_consistency<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    params: &CycleParams,
) -> Result<KConsistency, Error> {
    let pairs = crate::pcm::by_robots(trajectories, closures)?;
    let (inter, within): (Vec<usize>, Vec<usize>) =
        (0..closures.len()).partition(|&m| closures[m].is_inter_robot());
    let own: Vec<_> = inter.iter().map(|&m| closures[m].with_source_robot(closures[m].robots().0)).collect();
    let cycles = Cycles::new(trajectories, &own, scaled(gate::<N>(params.probability)?, params.scale)?);

    let n = own.len();
    let mut agree = vec![true; n * n];
    for members in pairs.values().filter(|members| closures[members[0]].is_inter_robot()) {
        let subset: Vec<_> = members.iter().map(|&m| closures[m]).collect();
        let test = PairTest::new(trajectories, &subset, params.probability)?.with_scale(params.scale)?;
        let vertices: Vec<usize> = members.iter().map(|m| inter.partition_point(|i| i < m)).collect();
        for a in 0..vertices.len() {
            for b in a + 1..vertices.len() {
                agree[vertices[a] * n + vertices[b]] = test.agree(a, b);
            }
        }
    }
    let checked = hyperclique::from_checks(n, 3, 2, |set| match set {
        [a, b] => agree[a * n + b],
        [a, b, c] => cycles.agree([*a, *b, *c]),
        _ => true,
    })?;
    let best = hyperclique::maximum(&checked.hypergraph, &params.budget);
    let mut selection = select(best.vertices, params.minimum, &inter);
    let reason = Reason::TooFewVotes { size: 1, minimum: params.minimum };
    selection
        .rejected
        .extend(within.into_iter().map(|closure| Rejection { closure, reason: reason.clone() }));
    selection.sort();
    Ok(KConsistency { selection, optimal: best.optimal, tests: checked.tests })
}

/// The cycle test in the common frame.
struct Cycles<'a, G, const N: usize> {
    trajectories: &'a Trajectories<G, N>,
    closures: &'a [Closure<G, N>],
    frames: Frames<G, N>,
    rho: Vec<SVector<f64, N>>,
    noise: Vec<SMatrix<f64, N, N>>,
    limit: f64,
}

impl<'a, G: Pose<N>, const N: usize> Cycles<'a, G, N> {
    fn new(trajectories: &'a Trajectories<G, N>, closures: &'a [Closure<G, N>], limit: f64) -> Self {
        let transforms: Vec<G> = closures.iter().map(|c| implied(trajectories, c)).collect();
        let reference = closures.iter().map(|c| c.source.robot).min().unwrap_or(0);
        let frames = Frames::new(reference, trajectories, closures, &transforms, &[]);
        let (rho, noise) = closures
            .iter()
            .zip(&transforms)
            .map(|(closure, t)| {
                let (r, q) = (closure.source.robot, closure.target.robot);
                let frame = frames.of(r);
                let pose = trajectories.get(r).and_then(|t| t.pose(closure.source.index)).copied();
                let observed = frame.compose(&pose.unwrap_or_else(G::identity));
                let rho = frame.compose(t).compose(&frames.of(q).inverse()).log();
                (rho, transported(&observed.adjoint(), &closure.covariance))
            })
            .unzip();
        Self { trajectories, closures, frames, rho, noise, limit }
    }

    /// Whether three closures agree; only cycles of three robots are tested.
    fn agree(&self, set: [usize; 3]) -> bool {
        let [ab, bc, ca] = set.map(|m| self.closures[m].robots());
        let robots = BTreeSet::from([ab.0, ab.1, bc.0, bc.1, ca.0, ca.1]);
        if robots.len() != 3 || ab == bc || bc == ca || ca == ab {
            return true;
        }
        // of the sorted pairs (x, y), (y, z), (x, z) the last is walked backwards
        let middle = robots.iter().nth(1).copied();
        let sign = |(first, second): (u32, u32)| {
            if Some(first) == middle || Some(second) == middle { 1.0 } else { -1.0 }
        };
        let mut e = SVector::zeros();
        let mut covariance = SMatrix::zeros();
        for m in set {
            e += self.rho[m] * sign(self.closures[m].robots());
            covariance += self.noise[m];
        }
        for &robot in &robots {
            covariance += self.drift(robot, &set);
        }
        mahalanobis_sq(&covariance, &e) <= self.limit
    }

    /// Drift of one robot between the two poses through which the cycle passes it.
    fn drift(&self, robot: u32, set: &[usize; 3]) -> SMatrix<f64, N, N> {
        let keys = set.iter().flat_map(|&m| [self.closures[m].source, self.closures[m].target]);
        let poses: Vec<usize> = keys.filter(|key| key.robot == robot).map(|key| key.index).collect();
        let between = match poses[..] {
            [k, l] => self.trajectories.get(robot).and_then(|t| t.drift_between(k, l)),
            _ => None,
        };
        transported(&self.frames.adjoint(robot), &between.unwrap_or_else(SMatrix::zeros))
    }
}

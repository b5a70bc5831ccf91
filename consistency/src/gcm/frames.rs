use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};

use crate::{Closure, MapTransform, Pose, Trajectories};

/// Linearisation: where each robot's map lies in the reference map, origin moved to the centre of the overlap.
///
/// In this one frame the adjoint between any two nodes is the identity, so closures are differences of node values.
#[derive(Debug, Clone)]
pub(crate) struct Frames<G, const N: usize> {
    pub(crate) reference: u32,
    /// `C⁻¹ F_r`.
    pub(crate) centre_from_map: BTreeMap<u32, G>,
}

/// The map transform a closure implies, `T = X_rk Z⁻¹ X_qi⁻¹`: the target's map seen from the source's.
pub(crate) fn implied<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closure: &Closure<G, N>,
) -> G {
    let pose = |key: crate::PoseKey| {
        trajectories.get(key.robot).and_then(|t| t.pose(key.index)).copied().unwrap_or_else(G::identity)
    };
    pose(closure.source)
        .compose(&closure.target_from_source.inverse())
        .compose(&pose(closure.target).inverse())
}

impl<G: Pose<N>, const N: usize> Frames<G, N> {
    /// Places the maps of one connected team: the medoid of what the closures imply along the strongest chain from
    /// the reference, else the prior.
    ///
    /// `closures` are those of the team in canonical direction, `transforms` what they imply.
    pub(crate) fn new(
        reference: u32,
        trajectories: &Trajectories<G, N>,
        closures: &[Closure<G, N>],
        transforms: &[G],
        priors: &[MapTransform<G, N>],
    ) -> Self {
        let mut pairs: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for (index, closure) in closures.iter().enumerate().filter(|(_, c)| c.is_inter_robot()) {
            pairs.entry((closure.source.robot, closure.target.robot)).or_default().push(index);
        }
        let mut frames: BTreeMap<u32, G> = BTreeMap::from([(reference, G::identity())]);
        loop {
            let placed = |robot: &u32| frames.contains_key(robot);
            let strongest = pairs
                .iter()
                .filter(|((r, q), _)| placed(r) != placed(q))
                .max_by_key(|(pair, members)| (members.len(), std::cmp::Reverse(**pair)));
            if let Some((&(r, q), members)) = strongest {
                let centre = centre_of(trajectories, closures, members);
                let t = medoid(members, transforms, &centre);
                match (frames.get(&r).copied(), frames.get(&q).copied()) {
                    (Some(frame), None) => frames.insert(q, frame.compose(&t)),
                    (None, Some(frame)) => frames.insert(r, frame.compose(&t.inverse())),
                    _ => break,
                };
                continue;
            }
            let next = priors.iter().find(|p| placed(&p.source) != placed(&p.target));
            let Some(prior) = next else { break };
            match (frames.get(&prior.target).copied(), frames.get(&prior.source).copied()) {
                (Some(frame), None) => frames.insert(prior.source, frame.compose(&prior.target_from_source)),
                (None, Some(frame)) => {
                    frames.insert(prior.target, frame.compose(&prior.target_from_source.inverse()))
                }
                _ => break,
            };
        }
        let centre = overlap_centre(trajectories, closures, &frames).inverse();
        let centre_from_map = frames.iter().map(|(&robot, frame)| (robot, centre.compose(frame))).collect();
        Self { reference, centre_from_map }
    }

    pub(crate) fn of(&self, robot: u32) -> G {
        self.centre_from_map.get(&robot).copied().unwrap_or_else(G::identity)
    }

    /// Moves each robot's map by its estimate; returns the largest translation and rotation moved.
    pub(crate) fn moved(&self, deltas: &BTreeMap<u32, SVector<f64, N>>) -> (Self, f64, f64) {
        let mut next = self.clone();
        let (mut metres, mut radians) = (0.0f64, 0.0f64);
        for (robot, delta) in deltas {
            metres = metres.max(delta.rows(0, G::TRANSLATION).norm());
            radians = radians.max(delta.rows(G::TRANSLATION, N - G::TRANSLATION).norm());
            next.centre_from_map.insert(*robot, G::exp(delta).compose(&self.of(*robot)));
        }
        (next, metres, radians)
    }

    pub(crate) fn adjoint(&self, robot: u32) -> SMatrix<f64, N, N> {
        self.of(robot).adjoint()
    }
}

fn pure_translation<const N: usize, G: Pose<N>>(position: &SVector<f64, N>) -> G {
    G::exp(position)
}

/// Mean position of the members' source poses, in the source's map.
fn centre_of<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    members: &[usize],
) -> G {
    let sum = members.iter().fold(SVector::zeros(), |sum: SVector<f64, N>, &m| {
        let key = closures[m].source;
        let pose = trajectories.get(key.robot).and_then(|t| t.pose(key.index));
        sum + pose.map_or_else(SVector::zeros, Pose::position)
    });
    pure_translation(&(sum / members.len().max(1) as f64))
}

/// Mean position of all closures in the reference map.
fn overlap_centre<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    frames: &BTreeMap<u32, G>,
) -> G {
    let sum = closures.iter().fold(SVector::zeros(), |sum: SVector<f64, N>, closure| {
        let key = closure.source;
        let pose = trajectories.get(key.robot).and_then(|t| t.pose(key.index));
        match (frames.get(&key.robot), pose) {
            (Some(frame), Some(pose)) => sum + frame.compose(pose).position(),
            _ => sum,
        }
    });
    pure_translation(&(sum / closures.len().max(1) as f64))
}

/// The transform with the least sum of distances to the others: metres on each axis plus 20 m/rad about `centre`.
fn medoid<const N: usize, G: Pose<N>>(members: &[usize], transforms: &[G], centre: &G) -> G {
    const METRES_PER_RADIAN: f64 = 20.0;
    let n = members.len();
    let at_centre: Vec<G> = members.iter().map(|&m| centre.inverse().compose(&transforms[m])).collect();
    let mut sums = vec![0.0; n];
    for m in 0..n {
        for other in m + 1..n {
            let e = at_centre[m].compose(&at_centre[other].inverse()).log();
            let distance: f64 = (0..N)
                .map(|row| e[row].abs() * if row < G::TRANSLATION { 1.0 } else { METRES_PER_RADIAN })
                .sum();
            sums[m] += distance;
            sums[other] += distance;
        }
    }
    let best = (0..n).min_by(|&a, &b| sums[a].total_cmp(&sums[b]).then(a.cmp(&b)));
    best.map_or_else(G::identity, |m| transforms[members[m]])
}

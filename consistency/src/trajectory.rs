use std::collections::BTreeMap;

use nalgebra::{DMatrix, SMatrix};

use crate::pose::{reversed, transported};
use crate::{Error, Pose, PoseKey};

/// One robot's poses in its own map, with the joint uncertainty of their drift.
///
/// Drift is kept in the **map frame**: `X_true = exp(z_k) · X_k` with `Cov(z_k, z_l)` in tangent order
/// `[translation, rotation]` about the map's origin. There an odometry chain is a random walk with independent
/// increments, so `Cov(z_k, z_l) = V(min(k, l))` and the covariance between any two poses costs O(1).
#[derive(Debug, Clone)]
pub struct Trajectory<G, const N: usize> {
    poses: Vec<G>,
    drift: Drift<N>,
}

/// A [`Trajectory`] in the plane.
pub type Trajectory2 = Trajectory<nalgebra::Isometry2<f64>, 3>;
/// A [`Trajectory`] in space.
pub type Trajectory3 = Trajectory<nalgebra::Isometry3<f64>, 6>;

#[derive(Debug, Clone)]
enum Drift<const N: usize> {
    /// `V(k)`, one entry a pose.
    Chain(Vec<SMatrix<f64, N, N>>),
    /// Joint covariance of some poses; `slots` maps a pose to its block row.
    Joint { slots: Vec<Option<usize>>, covariance: DMatrix<f64> },
}

impl<G: Pose<N>, const N: usize> Trajectory<G, N> {
    /// A trajectory whose uncertainty is the chain of its odometry steps.
    ///
    /// * `map_from_pose` – the poses in the robot's own map.
    /// * `step_covariances` – one fewer: covariance of step `k` to `k + 1`, in the frame of pose `k + 1`'s body,
    ///   tangent order `[translation, rotation]`, positive semidefinite.
    ///
    /// # Errors
    /// [`Error::StepCount`], [`Error::TrajectoryPose`], [`Error::StepCovariance`].
    pub fn from_steps(map_from_pose: Vec<G>, step_covariances: &[SMatrix<f64, N, N>]) -> Result<Self, Error> {
        if map_from_pose.is_empty() || map_from_pose.len() != step_covariances.len() + 1 {
            return Err(Error::StepCount { poses: map_from_pose.len(), steps: step_covariances.len() });
        }
        check_poses(&map_from_pose)?;
        let mut sum = SMatrix::zeros();
        let mut accumulated = vec![sum];
        for (step, (covariance, pose)) in step_covariances.iter().zip(&map_from_pose[1..]).enumerate() {
            if !is_positive_semidefinite(covariance) {
                return Err(Error::StepCovariance { step });
            }
            sum += transported(&pose.adjoint(), covariance);
            accumulated.push(sum);
        }
        Ok(Self { poses: map_from_pose, drift: Drift::Chain(accumulated) })
    }

    /// A trajectory with joint marginals of the poses that closures touch, as a pose-graph solver gives them.
    ///
    /// * `map_from_pose` – the poses in the robot's own map.
    /// * `indices` – the poses the covariance speaks of, distinct.
    /// * `covariance` – `N·len` square, block order of `indices`, each block in the tangent of its own pose's
    ///   body (right perturbation, `[translation, rotation]`).
    ///
    /// # Errors
    /// [`Error::TrajectoryPose`], [`Error::JointCovariance`].
    pub fn with_joint_covariance(
        map_from_pose: Vec<G>,
        indices: &[usize],
        covariance: &DMatrix<f64>,
    ) -> Result<Self, Error> {
        check_poses(&map_from_pose)?;
        let size = N * indices.len();
        let mut slots = vec![None; map_from_pose.len()];
        let mut names_each_once = true;
        for (slot, &k) in indices.iter().enumerate() {
            names_each_once &= slots.get_mut(k).is_some_and(|of_pose| of_pose.replace(slot).is_none());
        }
        if covariance.shape() != (size, size) || !names_each_once || covariance.iter().any(|v| !v.is_finite())
        {
            return Err(Error::JointCovariance { poses: indices.len(), size: covariance.nrows() });
        }
        let adjoints: Vec<_> = indices.iter().map(|&k| map_from_pose[k].adjoint()).collect();
        let mut moved = DMatrix::zeros(size, size);
        for (i, a) in adjoints.iter().enumerate() {
            for (j, b) in adjoints.iter().enumerate() {
                let block = a * covariance.fixed_view::<N, N>(N * i, N * j) * b.transpose();
                moved.fixed_view_mut::<N, N>(N * i, N * j).copy_from(&block);
            }
        }
        Ok(Self { poses: map_from_pose, drift: Drift::Joint { slots, covariance: moved } })
    }

    /// The poses in the robot's map.
    pub fn poses(&self) -> &[G] {
        &self.poses
    }

    /// The pose with this index, if the trajectory has it.
    pub fn pose(&self, index: usize) -> Option<&G> {
        self.poses.get(index)
    }

    /// `Cov(z_k, z_l)` of the drifts in the map frame; `None` for a pose without covariance.
    pub fn drift_covariance(&self, k: usize, l: usize) -> Option<SMatrix<f64, N, N>> {
        match &self.drift {
            Drift::Chain(accumulated) => {
                accumulated.get(k.min(l)).filter(|_| k.max(l) < self.poses.len()).copied()
            }
            Drift::Joint { slots, covariance } => {
                let (row, column) = ((*slots.get(k)?)?, (*slots.get(l)?)?);
                Some(covariance.fixed_view::<N, N>(N * row, N * column).into_owned())
            }
        }
    }

    /// `Σ a_k b_l Cov(z_k, z_l)` over weighted poses, ascending; `None` for a pose without covariance.
    pub(crate) fn drift_mean(&self, a: &[(usize, f64)], b: &[(usize, f64)]) -> Option<SMatrix<f64, N, N>> {
        let mut sum = SMatrix::zeros();
        let Drift::Chain(accumulated) = &self.drift else {
            for &(k, of_a) in a {
                for &(l, of_b) in b {
                    sum += self.drift_covariance(k, l)? * (of_a * of_b);
                }
            }
            return Some(sum);
        };
        // Cov = V(min): each V(k) counts with what of the other list lies at or after k, ties once
        let total = |list: &[(usize, f64)]| list.iter().map(|(_, share)| share).sum::<f64>();
        let (mut left_a, mut left_b) = (total(a), total(b));
        let (mut a, mut b) = (a.iter().peekable(), b.iter().peekable());
        loop {
            let (next_a, next_b) = (a.peek().map(|p| p.0), b.peek().map(|p| p.0));
            let k = match (next_a, next_b) {
                (Some(k), Some(l)) => k.min(l),
                _ => return Some(sum),
            };
            let of_a = a.next_if(|p| p.0 == k).map_or(0.0, |p| p.1);
            let of_b = b.next_if(|p| p.0 == k).map_or(0.0, |p| p.1);
            sum += accumulated.get(k)? * (of_a * left_b + of_b * (left_a - of_a));
            left_a -= of_a;
            left_b -= of_b;
        }
    }

    /// Covariance of `z_k - z_l` in the map frame; `None` for a pose without covariance.
    pub fn drift_between(&self, k: usize, l: usize) -> Option<SMatrix<f64, N, N>> {
        if let Drift::Chain(accumulated) = &self.drift {
            return Some(accumulated.get(k.max(l))? - accumulated.get(k.min(l))?);
        }
        let cross = self.drift_covariance(k, l)?;
        Some(self.drift_covariance(k, k)? + self.drift_covariance(l, l)? - cross - cross.transpose())
    }

    /// Trace of the rotation's part of the drift up to a pose, radians², where that of [`Trajectory::drift_between`] is
    /// the difference of two.
    pub(crate) fn turn_up_to(&self, k: usize) -> Option<f64> {
        match &self.drift {
            Drift::Chain(accumulated) => {
                accumulated.get(k).map(|sum| (G::TRANSLATION..N).map(|row| sum[(row, row)]).sum())
            }
            Drift::Joint { .. } => None,
        }
    }

    /// Trace of the rotation's part of [`Trajectory::drift_between`], radians².
    pub(crate) fn turn_between(&self, k: usize, l: usize) -> Option<f64> {
        let drift = self.drift_between(k, l)?;
        Some((G::TRANSLATION..N).map(|row| drift[(row, row)]).sum())
    }

    /// Covariance of the relative pose `X_k⁻¹ · X_l`, in the frame of `X_l`'s body, `[translation, rotation]`.
    pub fn relative_covariance(&self, k: usize, l: usize) -> Option<SMatrix<f64, N, N>> {
        let adjoint = self.pose(l)?.inverse().adjoint();
        Some(transported(&adjoint, &self.drift_between(k, l)?))
    }

    pub(crate) fn covers(&self, index: usize) -> bool {
        index < self.poses.len()
            && match &self.drift {
                Drift::Chain(_) => true,
                Drift::Joint { slots, .. } => slots[index].is_some(),
            }
    }
}

fn check_poses<const N: usize, G: Pose<N>>(poses: &[G]) -> Result<(), Error> {
    match poses.iter().position(|pose| !pose.is_finite()) {
        Some(index) => Err(Error::TrajectoryPose { index }),
        None => Ok(()),
    }
}

fn is_positive_semidefinite<const N: usize>(m: &SMatrix<f64, N, N>) -> bool {
    let lift = SMatrix::identity() * (1e-12 * m.trace().abs() + f64::MIN_POSITIVE);
    m.iter().all(|v| v.is_finite()) && nalgebra::linalg::Cholesky::new(m + lift).is_some()
}

/// Every robot's [`Trajectory`], by robot id.
#[derive(Debug, Clone)]
pub struct Trajectories<G, const N: usize> {
    robots: BTreeMap<u32, Trajectory<G, N>>,
}

/// [`Trajectories`] in the plane.
pub type Trajectories2 = Trajectories<nalgebra::Isometry2<f64>, 3>;
/// [`Trajectories`] in space.
pub type Trajectories3 = Trajectories<nalgebra::Isometry3<f64>, 6>;

impl<G, const N: usize> Default for Trajectories<G, N> {
    fn default() -> Self {
        Self { robots: BTreeMap::new() }
    }
}

impl<G: Pose<N>, const N: usize> Trajectories<G, N> {
    /// No robot yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets a robot's trajectory, replacing an older one.
    pub fn insert(&mut self, robot: u32, trajectory: Trajectory<G, N>) {
        self.robots.insert(robot, trajectory);
    }

    /// A robot's trajectory.
    pub fn get(&self, robot: u32) -> Option<&Trajectory<G, N>> {
        self.robots.get(&robot)
    }

    /// The robots' ids, ascending.
    pub fn robots(&self) -> impl Iterator<Item = u32> + '_ {
        self.robots.keys().copied()
    }

    /// The robot's trajectory, after a check that it knows the pose and its covariance.
    pub(crate) fn of(&self, closure: usize, key: PoseKey) -> Result<&Trajectory<G, N>, Error> {
        let unknown = Error::UnknownPose { closure, robot: key.robot, index: key.index };
        self.robots.get(&key.robot).filter(|t| t.covers(key.index)).ok_or(unknown)
    }
}

/// What is believed about where one robot's map lies in another's, before any closure: object matching, a
/// common start, an earlier meeting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapTransform<G, const N: usize> {
    /// The robot whose map is placed.
    pub source: u32,
    /// The robot in whose map it is placed.
    pub target: u32,
    /// The source's map seen from the target's map.
    pub target_from_source: G,
    /// Covariance of ξ in `T = T_true · exp(ξ)`: frame of the source's map, `[translation, rotation]`.
    pub covariance: SMatrix<f64, N, N>,
}

/// A [`MapTransform`] in the plane.
pub type MapTransform2 = MapTransform<nalgebra::Isometry2<f64>, 3>;
/// A [`MapTransform`] in space.
pub type MapTransform3 = MapTransform<nalgebra::Isometry3<f64>, 6>;

impl<G: Pose<N>, const N: usize> MapTransform<G, N> {
    /// The same belief told the other way round.
    pub fn reversed(&self) -> Self {
        let (target_from_source, covariance) = reversed(&self.target_from_source, &self.covariance);
        Self { source: self.target, target: self.source, target_from_source, covariance }
    }

    pub(crate) fn check(&self, prior: usize) -> Result<(), Error> {
        let sound = self.target_from_source.is_finite()
            && self.source != self.target
            && crate::closure::is_positive_definite(&self.covariance);
        if sound { Ok(()) } else { Err(Error::MapTransform { prior }) }
    }
}

#[cfg(test)]
mod tests {
    use draco_lie::LieGroup;
    use nalgebra::{Isometry2, Isometry3};

    use super::*;
    use crate::isotropic_covariance;

    #[test]
    fn one_step_has_its_own_covariance() {
        let q = isotropic_covariance::<3, Isometry2<f64>>(0.1, 0.02);
        let poses = vec![Isometry2::planar(7.0, 3.0, 0.3), Isometry2::planar(9.0, 4.0, -1.0)];
        let trajectory = Trajectory::from_steps(poses, &[q]).unwrap();
        assert!((trajectory.relative_covariance(0, 1).unwrap() - q).norm() < 1e-12);
    }

    #[test]
    fn the_mean_over_a_chain_is_the_sum_over_all_pairs() {
        let q = isotropic_covariance::<3, Isometry2<f64>>(0.1, 0.02);
        let poses: Vec<_> =
            (0..9).map(|k| Isometry2::planar(f64::from(k), 0.1 * f64::from(k * k), 0.2)).collect();
        let trajectory = Trajectory::from_steps(poses, &[q; 8]).unwrap();
        let (a, b) = ([(1, 0.5), (4, 0.25), (7, 0.25)], [(0, 0.2), (4, 0.3), (5, 0.5)]);
        let pairs = a.iter().flat_map(|&(k, x)| b.iter().map(move |&(l, y)| (k, l, x * y)));
        let sum: nalgebra::Matrix3<f64> =
            pairs.map(|(k, l, share)| trajectory.drift_covariance(k, l).unwrap() * share).sum();
        assert!((trajectory.drift_mean(&a, &b).unwrap() - sum).norm() < 1e-12);
        assert!((trajectory.drift_mean(&b, &a).unwrap() - sum).norm() < 1e-12);
        assert_eq!(trajectory.drift_mean(&a, &[]), Some(nalgebra::Matrix3::zeros()));
    }

    #[test]
    fn chain_and_joint_covariance_agree() {
        let q = isotropic_covariance::<6, Isometry3<f64>>(0.1, 0.02);
        let poses: Vec<_> =
            (0..5).map(|k| Isometry3::planar(2.0 * f64::from(k), f64::from(k * k) * 0.2, 0.2)).collect();
        let chain = Trajectory::from_steps(poses.clone(), &[q; 4]).unwrap();
        let indices = [3, 1];
        let joint = DMatrix::from_fn(12, 12, |r, c| {
            let (k, l) = (indices[r / 6], indices[c / 6]);
            let block = poses[k].inverse().adjoint()
                * chain.drift_covariance(k, l).unwrap()
                * poses[l].inverse().adjoint().transpose();
            block[(r % 6, c % 6)]
        });
        let marginal = Trajectory::with_joint_covariance(poses, &indices, &joint).unwrap();
        let difference =
            marginal.relative_covariance(1, 3).unwrap() - chain.relative_covariance(1, 3).unwrap();
        assert!(difference.norm() < 1e-10);
        assert!(marginal.relative_covariance(0, 1).is_none());
    }
}

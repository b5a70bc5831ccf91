use std::fmt;

use nalgebra::SMatrix;

use crate::pose::reversed;
use crate::{Error, Pose};

/// Names one pose: which robot, and which pose of its trajectory (counted from 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PoseKey {
    /// The robot's id.
    pub robot: u32,
    /// The pose's place in that robot's trajectory, from 0.
    pub index: usize,
}

impl PoseKey {
    /// The key of pose `index` of `robot`.
    pub const fn new(robot: u32, index: usize) -> Self {
        Self { robot, index }
    }
}

impl fmt::Display for PoseKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.robot, self.index)
    }
}

/// A measured relative pose between two poses of two robots (or of one robot): a loop closure.
///
/// The direction is in the type: [`Closure::target_from_source`] is the pose of `source` seen from `target`,
/// `Z = X_target⁻¹ · X_source`. A measurement of the other direction is turned by [`Closure::reversed`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure<G, const N: usize> {
    /// The pose that was observed.
    pub source: PoseKey,
    /// The pose it was observed from.
    pub target: PoseKey,
    /// The measurement, `Z = X_target⁻¹ · X_source`.
    pub target_from_source: G,
    /// Covariance of ξ in `Z = Z_true · exp(ξ)`: frame of the source's body, tangent order
    /// `[translation, rotation]`, metres and radians; positive definite.
    pub covariance: SMatrix<f64, N, N>,
}

/// A [`Closure`] in the plane.
pub type Closure2 = Closure<nalgebra::Isometry2<f64>, 3>;
/// A [`Closure`] in space.
pub type Closure3 = Closure<nalgebra::Isometry3<f64>, 6>;

impl<G: Pose<N>, const N: usize> Closure<G, N> {
    /// The same measurement told the other way round: `Z⁻¹`, its covariance moved by `Ad(Z)`.
    pub fn reversed(&self) -> Self {
        let (target_from_source, covariance) = reversed(&self.target_from_source, &self.covariance);
        Self { source: self.target, target: self.source, target_from_source, covariance }
    }

    /// The closure in the direction in which `first` holds the source, `self` when it does already. Within one
    /// robot the later pose is the source.
    pub(crate) fn with_source_robot(&self, first: u32) -> Self {
        let turn = if self.is_inter_robot() {
            self.source.robot != first
        } else {
            self.source.index < self.target.index
        };
        if turn { self.reversed() } else { *self }
    }

    /// The two robots, the smaller id first.
    pub fn robots(&self) -> (u32, u32) {
        let (a, b) = (self.source.robot, self.target.robot);
        (a.min(b), a.max(b))
    }

    /// Whether two robots meet in this closure.
    pub fn is_inter_robot(&self) -> bool {
        self.source.robot != self.target.robot
    }

    /// # Errors
    /// A [`Error::ClosurePose`] or [`Error::ClosureCovariance`] that carries `index`.
    pub(crate) fn check(&self, index: usize) -> Result<(), Error> {
        if !self.target_from_source.is_finite() {
            return Err(Error::ClosurePose { closure: index });
        }
        if self.source == self.target {
            return Err(Error::ClosureToItself { closure: index });
        }
        if !is_positive_definite(&self.covariance) {
            return Err(Error::ClosureCovariance { closure: index });
        }
        Ok(())
    }
}

/// Finite, symmetric to rounding, and with a Cholesky factor.
pub(crate) fn is_positive_definite<const N: usize>(m: &SMatrix<f64, N, N>) -> bool {
    const RELATIVE_ASYMMETRY: f64 = 1e-6;
    m.iter().all(|v| v.is_finite())
        && (m - m.transpose()).amax() <= RELATIVE_ASYMMETRY * m.amax()
        && nalgebra::linalg::Cholesky::new(*m).is_some()
}

#[cfg(test)]
mod tests {
    use draco_lie::LieGroup;
    use nalgebra::{Isometry2, Vector3};

    use super::*;
    use crate::isotropic_covariance;

    #[test]
    fn reversing_twice_gives_the_closure_back() {
        let closure = Closure {
            source: PoseKey::new(0, 3),
            target: PoseKey::new(1, 4),
            target_from_source: Isometry2::planar(2.0, -1.0, -2.5),
            covariance: isotropic_covariance::<3, Isometry2<f64>>(0.2, 0.01),
        };
        let back = closure.reversed().reversed();
        assert_eq!((back.source, back.target), (closure.source, closure.target));
        assert!((back.covariance - closure.covariance).norm() < 1e-12);
        assert!(back.target_from_source.minus(&closure.target_from_source).norm() < 1e-12);
    }

    #[test]
    fn reversed_noise_is_the_noise_of_the_inverse() {
        // Z exp(ξ) inverted is Z⁻¹ exp(-Ad(Z) ξ): the covariance must move by Ad(Z).
        let z = Isometry2::planar(5.0, 1.0, 0.7);
        let xi = Vector3::new(1e-6, -2e-6, 3e-6);
        let direct = LieGroup::inverse(&z.plus(&xi)).minus(&LieGroup::inverse(&z));
        assert!((direct + z.adjoint() * xi).norm() < 1e-10);
    }
}

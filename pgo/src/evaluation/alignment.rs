use draco_lie::LieGroup;
use nalgebra::{
    Isometry2, Isometry3, Matrix3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3,
};

use crate::Error;
use crate::nearest_rotation::{nearest_rotation, singular_values};

/// How an estimate is moved onto the reference before errors are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Alignment {
    /// Not at all.
    None,
    /// By the rotation and translation with the least squared distances of positions.
    #[default]
    Rigid,
    /// By the rotation, translation and scale with the least squared distances of positions.
    Similarity,
    /// By the scale of [`Alignment::Similarity`] alone.
    Scale,
    /// So that the first poses agree.
    Origin,
}

/// Poses a trajectory may consist of.
pub trait TrajectoryPose<const N: usize>: LieGroup<N> {
    /// Whether the poses lie in the plane `z = 0` and are aligned within it.
    const PLANAR: bool;

    /// The pose in space.
    fn to_isometry3(&self) -> Isometry3<f64>;
}

impl TrajectoryPose<3> for Isometry2<f64> {
    const PLANAR: bool = true;

    fn to_isometry3(&self) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.rotation.angle());
        Isometry3::from_parts(Translation3::new(self.translation.x, self.translation.y, 0.0), rotation)
    }
}

impl TrajectoryPose<6> for Isometry3<f64> {
    const PLANAR: bool = false;

    fn to_isometry3(&self) -> Isometry3<f64> {
        *self
    }
}

/// The transform that moves the positions of `estimate` onto those of `reference`: `p ↦ s R p + t`. In the plane
/// it turns about the vertical only.
///
/// **Source**: Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, 1991.
///
/// # Errors
/// [`Error::Lengths`], [`Error::Trajectory`]; [`Error::Alignment`] when no alignment is unique.
pub fn align<const N: usize, G: TrajectoryPose<N>>(
    estimate: &[G],
    reference: &[G],
    alignment: Alignment,
) -> Result<Similarity3<f64>, Error> {
    let (estimate, reference) = to_space(estimate, reference)?;
    align_in_space(&estimate, &reference, alignment, G::PLANAR)
}

type Path = Vec<Isometry3<f64>>;

/// Both trajectories in space, checked.
pub(super) fn to_space<const N: usize, G: TrajectoryPose<N>>(
    estimate: &[G],
    reference: &[G],
) -> Result<(Path, Path), Error> {
    if estimate.len() != reference.len() {
        return Err(Error::Lengths { estimate: estimate.len(), reference: reference.len() });
    }
    if estimate.is_empty() {
        return Err(Error::EmptyGraph);
    }
    let convert = |poses: &[G], trajectory| {
        let finite = |pose: &G| pose.log().iter().all(|x| x.is_finite());
        match poses.iter().position(|pose| !finite(pose)) {
            Some(index) => Err(Error::Trajectory { trajectory, index }),
            None => Ok(poses.iter().map(G::to_isometry3).collect()),
        }
    };
    Ok((convert(estimate, "estimate")?, convert(reference, "reference")?))
}

pub(super) fn align_in_space(
    estimate: &[Isometry3<f64>],
    reference: &[Isometry3<f64>],
    alignment: Alignment,
    planar: bool,
) -> Result<Similarity3<f64>, Error> {
    match alignment {
        Alignment::None => Ok(Similarity3::identity()),
        Alignment::Origin => match (estimate, reference) {
            ([first, ..], [to, ..]) => Ok(Similarity3::from_isometry(to * first.inverse(), 1.0)),
            _ => Err(Error::EmptyGraph),
        },
        Alignment::Rigid => umeyama(estimate, reference, planar).map(|s| s.rigid()),
        Alignment::Similarity => umeyama(estimate, reference, planar)?.scaled(),
        Alignment::Scale => {
            let scale = umeyama(estimate, reference, planar)?.scaled()?.scaling();
            Ok(Similarity3::from_scaling(scale))
        }
    }
}

struct Umeyama {
    rotation: UnitQuaternion<f64>,
    means: [Vector3<f64>; 2],
    scale: f64,
}

impl Umeyama {
    fn with_scale(&self, scale: f64) -> Similarity3<f64> {
        let translation = self.means[1] - self.rotation * self.means[0] * scale;
        Similarity3::from_parts(Translation3::from(translation), self.rotation, scale)
    }

    fn rigid(&self) -> Similarity3<f64> {
        self.with_scale(1.0)
    }

    fn scaled(&self) -> Result<Similarity3<f64>, Error> {
        // a reflected reference is best matched by a scale that is not positive
        if self.scale.is_finite() && self.scale > 0.0 {
            Ok(self.with_scale(self.scale))
        } else {
            Err(Error::Alignment)
        }
    }
}

fn umeyama(
    estimate: &[Isometry3<f64>],
    reference: &[Isometry3<f64>],
    planar: bool,
) -> Result<Umeyama, Error> {
    let mean = |poses: &[Isometry3<f64>]| -> Vector3<f64> {
        poses.iter().map(|pose| pose.translation.vector).sum::<Vector3<f64>>() / poses.len() as f64
    };
    let means = [mean(estimate), mean(reference)];
    let mut covariance = Matrix3::zeros();
    let (mut variance, mut spread) = (0.0, 0.0);
    for (from, to) in estimate.iter().zip(reference) {
        let (from, to) = (from.translation.vector - means[0], to.translation.vector - means[1]);
        covariance += to * from.transpose();
        variance += from.norm_squared();
        spread += to.norm_squared();
    }
    // singular values below this are rounding
    let least = 1e-12 * (variance * spread).sqrt();
    let (rotation, trace) =
        if planar { in_plane(&covariance, least)? } else { in_space(&covariance, least)? };
    Ok(Umeyama { rotation, means, scale: trace / variance })
}

/// The rotation about the vertical that maximises `tr(Rᵀ C)`, and that maximum.
fn in_plane(c: &Matrix3<f64>, least: f64) -> Result<(UnitQuaternion<f64>, f64), Error> {
    let (cosine, sine) = (c.m11 + c.m22, c.m21 - c.m12);
    let norm = cosine.hypot(sine);
    if norm.is_nan() || norm <= least {
        return Err(Error::Alignment);
    }
    Ok((UnitQuaternion::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine)), norm))
}

/// The rotation that maximises `tr(Rᵀ C)`, the one nearest to `C`, and that maximum.
fn in_space(c: &Matrix3<f64>, least: f64) -> Result<(UnitQuaternion<f64>, f64), Error> {
    // one direction may be lost (a planar path), two may not
    if singular_values(c)[1] <= least {
        return Err(Error::Alignment);
    }
    let rotation = nearest_rotation(c);
    let best = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok((best, rotation.dot(c)))
}

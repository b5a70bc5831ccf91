use nalgebra::{Isometry3, SVector};

use super::TrajectoryPose;
use crate::{ChordalPose, Error, Measurement, PoseGraph, chordal_objective};

/// What different libraries mean by the cost of a pose graph.
///
/// All sum over the relative poses with `z` the measurement, `a`, `b` the two poses and `Ω` the information matrix
/// as it stands; `t`, `R` are translation and rotation of `d = z⁻¹ a⁻¹ b`. They agree to second order in the plane;
/// in space [`Objective::G2o`] counts rotations a quarter as much.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Objective {
    /// `½ Σ eᵀ Ω e` with `e = log d`: what this crate and GTSAM minimise.
    #[default]
    Log,
    /// `½ Σ eᵀ Ω e` with `e = (t, θ)` in the plane and `e = (t, q)` in space, `q` the vector part of the
    /// quaternion of `R` with its scalar part not negative: g2o's `EDGE_SE2` and `EDGE_SE3:QUAT`.
    G2o,
    /// `½ Σ eᵀ Ω e` with `e = (t, log R)`: pose as a product of rotation and translation, as in SymForce and
    /// common Ceres programs. In the plane the same as [`Objective::G2o`].
    Split,
    /// `Σ κ |R_b - R_a R_z|² + τ |t_b - t_a - R_a t_z|²`, no ½: SE-Sync's, see [`crate::certify()`].
    Chordal,
}

/// The cost of the relative poses of `graph` at its present poses as `which` defines it. Priors, user-defined
/// factors and kernels are not looked at.
///
/// # Errors
/// Those of [`crate::chordal_objective`].
pub fn objective<const N: usize, G: TrajectoryPose<N> + ChordalPose<N>>(
    graph: &PoseGraph<G, N>,
    which: Objective,
) -> Result<f64, Error> {
    if which == Objective::Chordal {
        return Ok(2.0 * chordal_objective(graph)?.cost());
    }
    let mut sum = 0.0;
    for (_, factor) in graph.factors() {
        let Measurement::Between { from, to, measured } = &factor.measurement else { continue };
        let a = graph.pose(*from).ok_or(Error::UnknownKey { key: *from })?;
        let b = graph.pose(*to).ok_or(Error::UnknownKey { key: *to })?;
        let d = measured.between(&a.between(b));
        let e: SVector<f64, N> = match which {
            Objective::Log => d.log(),
            _ => residual(&d.to_isometry3(), which, G::PLANAR),
        };
        sum += e.dot(&(factor.information * e));
    }
    Ok(0.5 * sum)
}

fn residual<const N: usize>(d: &Isometry3<f64>, which: Objective, planar: bool) -> SVector<f64, N> {
    let t = d.translation.vector;
    let turn = d.rotation.scaled_axis();
    if planar {
        return SVector::from_iterator([t.x, t.y, turn.z]);
    }
    let q = d.rotation.quaternion();
    let rotation = if which == Objective::G2o { q.imag() * 1f64.copysign(q.w) } else { turn };
    SVector::from_iterator(t.iter().chain(&rotation).copied())
}

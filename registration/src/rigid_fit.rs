use nalgebra::{SMatrix, SVector};

use crate::motion::RigidMotion;

/// Rotation and translation that bring weighted source points nearest to their partners (Kabsch); `None` without
/// weight.
///
/// * `pairs` – source point, target point, weight.
#[inline]
pub(crate) fn rigid_fit<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    pairs: impl Iterator<Item = (SVector<f64, D>, SVector<f64, D>, f64)>,
) -> Option<(SMatrix<f64, D, D>, SVector<f64, D>)> {
    let (mut p_sum, mut q_sum, mut total) = (SVector::<f64, D>::zeros(), SVector::<f64, D>::zeros(), 0.0);
    let mut cross = SMatrix::<f64, D, D>::zeros();
    for (p, q, w) in pairs {
        let weighted = q * w;
        p_sum += p * w;
        q_sum += weighted;
        cross += weighted * p.transpose();
        total += w;
    }
    if total <= 0.0 {
        return None;
    }
    let (p_mean, q_mean) = (p_sum / total, q_sum / total);
    let rotation = G::best_rotation(&(cross / total - q_mean * p_mean.transpose()));
    Some((rotation, q_mean - rotation * p_mean))
}

use nalgebra::{SMatrix, SVector};

use super::Covariance;
use super::align::{Pose, Problem};
use super::params::Residual;
use crate::DEGENERATE_SIGMA;
use crate::linalg::symmetric_eigen;
use crate::motion::RigidMotion;

/// A direction is degenerate when its information is below this share of the strongest direction's.
const DEGENERATE_SHARE: f64 = 1e-3;

pub(crate) struct Uncertainty<const N: usize> {
    pub(crate) covariance: SMatrix<f64, N, N>,
    pub(crate) information: SMatrix<f64, N, N>,
    pub(crate) degenerate_directions: Vec<SVector<f64, N>>,
    pub(crate) sigma: f64,
}

pub(crate) fn estimate<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> Uncertainty<N> {
    let sum = problem.normal_equations::<N, G>(pose);
    let coordinates = match problem.params.residual {
        Residual::PointToPoint | Residual::PlaneToPlane => D,
        Residual::PointToPlane | Residual::Symmetric => 1,
    };
    let freedom = sum.weight * coordinates as f64 - N as f64;
    let variance = if freedom > 0.0 { sum.cost / freedom } else { f64::INFINITY };
    let scale = problem.scale::<N>();
    let h = SMatrix::<f64, N, N>::from_fn(|i, j| sum.h[(i, j)] / (scale[i] * scale[j]));
    let (values, vectors) = symmetric_eigen(&h);
    let to_body = body_from_centred::<D, N, G>(problem, pose);
    let (mut information, mut covariance) = (SMatrix::zeros(), SMatrix::zeros());
    let mut degenerate_directions = Vec::new();
    // exact data has no residual; a floor keeps the information finite
    let variance = variance.max(1e-18 * problem.radius * problem.radius);
    for k in 0..N {
        // a tangent vector scales with 1/scale, a gradient with scale
        let direction = to_body * vectors.column(k).component_div(&scale);
        if values[k] <= DEGENERATE_SHARE * values[N - 1] || !variance.is_finite() {
            covariance += direction * direction.transpose() * (DEGENERATE_SIGMA * DEGENERATE_SIGMA);
            degenerate_directions.push(direction.normalize());
        } else {
            covariance += direction * direction.transpose() * (variance / values[k]);
        }
    }
    // information: the same eigenvectors seen as gradients
    let from_body_transposed = inverse_transposed::<D, N, G>(problem, pose);
    for k in 0..N {
        if values[k] > DEGENERATE_SHARE * values[N - 1] && variance.is_finite() {
            let gradient = from_body_transposed * vectors.column(k).component_mul(&scale);
            information += gradient * gradient.transpose() * (values[k] / variance);
        }
    }
    if let Covariance::Spacing { scale, radius } = problem.params.covariance {
        covariance = SMatrix::identity() * (scale * mean_square_within(problem, radius));
    }
    Uncertainty { covariance, information, degenerate_directions, sigma: variance.sqrt() }
}

/// Mean squared distance of the pairs within `radius`, as the reference system's fitness.
fn mean_square_within<const D: usize>(problem: &Problem<'_, D>, radius: f64) -> f64 {
    let near = problem.matched.iter().map(|p| p.distance_sq).filter(|d| *d <= radius * radius);
    let (count, sum) = near.fold((0usize, 0.0), |(n, s), d| (n + 1, s + d));
    if count > 0 { sum / count as f64 } else { radius * radius }
}

/// Maps a small motion about the source's centre in the target's axes to the tangent at the source's frame.
fn body_from_centred<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> SMatrix<f64, N, N> {
    let shift = G::from_matrix(&SMatrix::identity(), &problem.centre);
    shift.adjoint() * G::turn_tangent(&pose.rotation.transpose())
}

fn inverse_transposed<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> SMatrix<f64, N, N> {
    let shift = G::from_matrix(&SMatrix::identity(), &problem.centre);
    (G::turn_tangent(&pose.rotation) * shift.inverse().adjoint()).transpose()
}

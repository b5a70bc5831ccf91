use nalgebra::{SMatrix, SVector};

use super::Residual;
use crate::motion::RigidMotion;

/// Flatness of the covariances of plane-to-plane ICP: variance across over variance along.
const FLATNESS: f64 = 1e-3;

/// `Σ w Jᵀ M J` and `Σ w Jᵀ M e` of the pairs, for a small motion about the source's centre, axes of the target.
#[derive(Debug, Clone)]
pub(crate) struct NormalEquations<const N: usize> {
    pub(crate) h: SMatrix<f64, N, N>,
    pub(crate) g: SVector<f64, N>,
    pub(crate) cost: f64,
    pub(crate) weight: f64,
}

impl<const N: usize> NormalEquations<N> {
    pub(crate) fn zero() -> Self {
        Self { h: SMatrix::zeros(), g: SVector::zeros(), cost: 0.0, weight: 0.0 }
    }

    #[inline(always)]
    pub(crate) fn add<const D: usize, G: RigidMotion<D, N>>(&mut self, term: &Term<D, N>, weight: f64) {
        match term {
            Term::Scalar { row, error } => {
                let scaled = row * weight;
                for j in 0..N {
                    for i in 0..=j {
                        self.h[(i, j)] += scaled[i] * row[j];
                    }
                }
                self.g += scaled * *error;
                self.cost += weight * error * error;
            }
            Term::Block { metric, lever, force, cost } => {
                let h = G::gram(lever, metric);
                for j in 0..N {
                    for i in 0..=j {
                        self.h[(i, j)] += weight * h[(i, j)];
                    }
                }
                self.g += G::wrench(lever, force) * weight;
                self.cost += weight * cost;
            }
        }
        self.weight += weight;
    }

    /// Fills the lower triangle.
    pub(crate) fn finish(&mut self) {
        for j in 0..N {
            for i in 0..j {
                self.h[(j, i)] = self.h[(i, j)];
            }
        }
    }
}

/// What one pair adds.
pub(crate) enum Term<const D: usize, const N: usize> {
    /// `(error - row · ξ)²`.
    Scalar { row: SVector<f64, N>, error: f64 },
    /// `(e - J ξ)ᵀ M (e - J ξ)` at a lever, with `force = M e` and `cost = eᵀ M e`.
    Block { metric: SMatrix<f64, D, D>, lever: SVector<f64, D>, force: SVector<f64, D>, cost: f64 },
}

impl<const D: usize, const N: usize> Term<D, N> {
    #[inline]
    pub(crate) fn cost(&self) -> f64 {
        match self {
            Term::Scalar { error, .. } => error * error,
            Term::Block { cost, .. } => *cost,
        }
    }

    /// Mean over all directions of `M`; 1 of a scalar.
    #[inline]
    pub(crate) fn mean_metric(&self) -> f64 {
        match self {
            Term::Scalar { .. } => 1.0,
            Term::Block { metric, .. } => metric.trace() / D as f64,
        }
    }

    /// `Jᵀ M e`.
    #[inline]
    pub(crate) fn score<G: RigidMotion<D, N>>(&self) -> SVector<f64, N> {
        match self {
            Term::Scalar { row, error } => row * *error,
            Term::Block { lever, force, .. } => G::wrench(lever, force),
        }
    }
}

/// The term of a pair.
///
/// * `lever` – source point from the source's centre, in the axes of the target;
/// * `e` – `q - x`;
/// * `n`, `m` – normal of the target and (turned) of the source, zero if not needed;
/// * `metric` – inverse covariance of `e`, called only if needed.
#[inline(always)]
pub(crate) fn term<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    residual: Residual,
    lever: &SVector<f64, D>,
    e: &SVector<f64, D>,
    n: &SVector<f64, D>,
    m: &SVector<f64, D>,
    metric: impl FnOnce() -> SMatrix<f64, D, D>,
) -> Term<D, N> {
    match residual {
        Residual::PointToPlane => Term::Scalar { row: G::wrench(lever, n), error: n.dot(e) },
        Residual::Symmetric => {
            let mean = if n.dot(m) < 0.0 { n - m } else { n + m };
            let axis = mean.try_normalize(0.0).unwrap_or(*n);
            Term::Scalar { row: G::wrench(lever, &axis), error: axis.dot(e) }
        }
        Residual::PointToPoint => block(SMatrix::identity(), lever, e),
        Residual::PlaneToPlane => block(plane_to_plane_weight(n, m), lever, e),
        Residual::Mahalanobis => block(metric(), lever, e),
    }
}

#[inline(always)]
fn block<const D: usize, const N: usize>(
    metric: SMatrix<f64, D, D>,
    lever: &SVector<f64, D>,
    e: &SVector<f64, D>,
) -> Term<D, N> {
    let force = metric * e;
    Term::Block { metric, lever: *lever, force, cost: e.dot(&force) }
}

/// `2 ε (C_n + C_m)⁻¹` for flat covariances `C_v = I - (1 - ε) v vᵀ` of unit normals: 1 across parallel planes, so that
/// residuals are in metres.
///
/// `C_n + C_m = 2 I - a (n nᵀ + m mᵀ)` with `a = 1 - ε` has the eigenvectors `n ± m`, whose squares are `2 (1 ± c)` with
/// `c = n·m`, with `p = 2 - a (1 + c)` and `q = 2 - a (1 - c)`, and 2 elsewhere. Its inverse is therefore
/// `I/2 + a/4 ((n + m) (n + m)ᵀ / p + (n - m) (n - m)ᵀ / q)`, where nothing vanishes.
#[inline(always)]
pub(crate) fn plane_to_plane_weight<const D: usize>(
    n: &SVector<f64, D>,
    m: &SVector<f64, D>,
) -> SMatrix<f64, D, D> {
    let a = 1.0 - FLATNESS;
    let c = n.dot(m);
    let (p, q) = (2.0 - a * (1.0 + c), 2.0 - a * (1.0 - c));
    // the factors of n nᵀ + m mᵀ and of n mᵀ + m nᵀ: 1/p + 1/q and 1/p - 1/q over the common denominator
    let common = 0.5 * FLATNESS * a / (p * q);
    let (same, mixed) = (common * (4.0 - 2.0 * a), common * (2.0 * a * c));
    let (u, v) = (n * same + m * mixed, m * same + n * mixed);
    SMatrix::from_fn(|i, j| {
        let flat = if i == j { FLATNESS } else { 0.0 };
        // both orders of the same products: symmetric to the last bit
        let (i, j) = (i.min(j), i.max(j));
        u[i] * n[j] + v[i] * m[j] + flat
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weight_is_the_inverse_of_the_sum(
            v in prop::array::uniform3(-1.0..1.0f64),
            d in prop::array::uniform3(-1.0..1.0f64),
            apart in prop_oneof![Just(0.0), Just(1e-9), Just(1e-4), Just(1.0), Just(1e6)],
            sign in prop_oneof![Just(-1.0), Just(1.0)],
        ) {
            let n = Vector3::from(v);
            prop_assume!(n.norm() > 0.1 && Vector3::from(d).norm() > 0.1);
            let n = n.normalize();
            let m = (n + Vector3::from(d) * apart).normalize() * sign;
            let flat = |v: &Vector3<f64>| Matrix3::identity() - v * v.transpose() * (1.0 - FLATNESS);
            let found = plane_to_plane_weight(&n, &m);
            let expected = (flat(&n) + flat(&m)).try_inverse().unwrap() * (2.0 * FLATNESS);
            prop_assert!((found - expected).norm() <= 1e-10, "{found} {expected}");
            prop_assert_eq!(found, found.transpose());
        }
    }
}

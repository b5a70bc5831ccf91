//! Quadratic models of the factors: what both the batch and the incremental solver sum up.

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::Kernel;

/// Gauss-Newton model of a factor on one pose.
#[derive(Debug, Clone)]
pub(crate) struct PriorModel<const N: usize> {
    pub(crate) rho: f64,
    pub(crate) weight: f64,
    pub(crate) hessian: SMatrix<f64, N, N>,
    pub(crate) gradient: SVector<f64, N>,
}

/// Gauss-Newton model of a relative pose from `a` to `b`.
#[derive(Debug, Clone)]
pub(crate) struct BetweenModel<const N: usize> {
    pub(crate) rho: f64,
    pub(crate) weight: f64,
    pub(crate) aa: SMatrix<f64, N, N>,
    pub(crate) ab: SMatrix<f64, N, N>,
    pub(crate) bb: SMatrix<f64, N, N>,
    pub(crate) gradient_a: SVector<f64, N>,
    pub(crate) gradient_b: SVector<f64, N>,
}

/// `eᵀ Ω e`.
#[inline(always)]
pub(crate) fn quadratic<const N: usize>(information: &SMatrix<f64, N, N>, e: &SVector<f64, N>) -> f64 {
    e.dot(&(information * e))
}

/// Models `log(z⁻¹ x)`; the kernel enters by its weight (iteratively reweighted least squares).
#[inline(always)]
pub(crate) fn prior_model<const N: usize, G: LieGroup<N>>(
    measured: &G,
    information: &SMatrix<f64, N, N>,
    kernel: Kernel,
    x: &G,
) -> PriorModel<N> {
    let e = measured.between(x).log();
    let weighed = kernel.weigh(quadratic(information, &e));
    let j = G::right_jacobian_inverse(&e);
    let jw = j.transpose() * information * weighed.weight;
    PriorModel { rho: weighed.rho, weight: weighed.weight, hessian: jw * j, gradient: jw * e }
}

/// Models `e = log(z⁻¹ a⁻¹ b)`. The Jacobian by `b` is `J = J_r⁻¹(e)` and by `a` it is `-J Ad(b⁻¹ a)`, so with
/// `A = Ad(b⁻¹ a)` all blocks follow from `H = Jᵀ Ω J`: `-Aᵀ H` and `Aᵀ H A`.
#[inline(always)]
pub(crate) fn between_model<const N: usize, G: LieGroup<N>>(
    measured: &G,
    information: &SMatrix<f64, N, N>,
    kernel: Kernel,
    a: &G,
    b: &G,
) -> BetweenModel<N> {
    let b_from_a = b.between(a);
    let e = measured.between(&b_from_a.inverse()).log();
    let weighed = kernel.weigh(quadratic(information, &e));
    let j = G::right_jacobian_inverse(&e);
    let jw = j.tr_mul(information) * weighed.weight;
    let (bb, gradient_b) = (jw * j, jw * e);
    let adjoint = b_from_a.adjoint();
    let ah = adjoint.tr_mul(&bb);
    BetweenModel {
        rho: weighed.rho,
        weight: weighed.weight,
        aa: ah * adjoint,
        ab: -ah,
        bb,
        gradient_a: -adjoint.tr_mul(&gradient_b),
        gradient_b,
    }
}

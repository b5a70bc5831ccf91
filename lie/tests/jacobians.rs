//! Maps and Jacobians against the matrix power series, which shares no code with them, for random tangents.
mod testing;

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector, UnitQuaternion};
use proptest::prelude::*;
use testing::{poses, tangents};

/// What the power series itself loses at |ξ| = 7, where its terms reach 10².
const SERIES_TOLERANCE: f64 = 5e-13;

fn series<const N: usize>(ad: &SMatrix<f64, N, N>, shift: f64) -> SMatrix<f64, N, N> {
    let mut term = SMatrix::<f64, N, N>::identity();
    let mut sum = term;
    for k in 1..60 {
        term = term * ad / (k as f64 + shift);
        sum += term;
    }
    sum
}

fn check<const N: usize, G: LieGroup<N>>(xi: SVector<f64, N>) -> Result<(), TestCaseError> {
    let scale = 1.0 + xi.norm();
    let ad = G::small_adjoint(&xi);
    let oracle = series(&ad, 1.0);
    prop_assert!((G::left_jacobian(&xi) - oracle).amax() <= SERIES_TOLERANCE * scale);
    let right = series(&-ad, 1.0);
    prop_assert!((G::right_jacobian(&xi) - right).amax() <= SERIES_TOLERANCE * scale);
    let inverse = G::left_jacobian_inverse(&xi);
    prop_assert!(
        (oracle * inverse - SMatrix::identity()).amax() <= SERIES_TOLERANCE * scale * inverse.amax()
    );
    let pose = G::exp(&xi);
    prop_assert!((pose.adjoint() - series(&ad, 0.0)).amax() <= SERIES_TOLERANCE * scale);
    prop_assert!(pose.check().is_ok());
    // the logarithm may differ from ξ by a turn, the pose may not
    prop_assert!(G::exp(&pose.log()).minus(&pose).norm() <= 4e-15 * scale);
    Ok(())
}

fn check_product<const N: usize, G: LieGroup<N>>(a: G, b: G) -> Result<(), TestCaseError> {
    let scale = 1.0 + a.log().norm() + b.log().norm();
    let back = a.compose(&a.between(&b));
    prop_assert!(back.minus(&b).norm() <= 1e-14 * scale);
    prop_assert!(b.plus(&a.minus(&b)).minus(&a).norm() <= 1e-14 * scale);
    let both = a.compose(&b).adjoint() - a.adjoint() * b.adjoint();
    prop_assert!(both.amax() <= 1e-14 * scale);
    Ok(())
}

proptest! {
    #[test]
    fn plane_matches_the_power_series(xi in tangents::<3>(1)) {
        check::<3, Isometry2<f64>>(xi)?;
    }
    #[test]
    fn rotations_match_the_power_series(xi in tangents::<3>(3)) {
        check::<3, UnitQuaternion<f64>>(xi)?;
    }
    #[test]
    fn space_matches_the_power_series(xi in tangents::<6>(3)) {
        check::<6, Isometry3<f64>>(xi)?;
    }
    #[test]
    fn products_undo_in_the_plane(a in poses::<3, Isometry2<f64>>(1), b in poses::<3, Isometry2<f64>>(1)) {
        check_product::<3, _>(a, b)?;
    }
    #[test]
    fn products_undo_in_space(a in poses::<6, Isometry3<f64>>(3), b in poses::<6, Isometry3<f64>>(3)) {
        check_product::<6, _>(a, b)?;
    }
}

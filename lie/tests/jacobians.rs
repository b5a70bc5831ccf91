//! Maps and Jacobians against the matrix power series, which shares no code with them.
use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector};

fn series<const N: usize>(ad: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let mut term = SMatrix::<f64, N, N>::identity();
    let mut sum = term;
    for k in 1..80 {
        term = term * ad / (k as f64 + 1.0);
        sum += term;
    }
    sum
}

fn check<const N: usize, G: LieGroup<N>>(xi: SVector<f64, N>) {
    let j = G::left_jacobian(&xi);
    let oracle = series(&G::small_adjoint(&xi));
    assert!((j - oracle).norm() < 1e-10 * (1.0 + oracle.norm()), "left Jacobian at {xi}: {j} {oracle}");
    let product = j * G::left_jacobian_inverse(&xi);
    assert!((product - SMatrix::identity()).norm() < 1e-10 * (1.0 + xi.norm()), "inverse at {xi}");
    let back = G::exp(&xi).log();
    assert!((G::exp(&back).between(&G::exp(&xi))).log().norm() < 1e-10 * (1.0 + xi.norm()));
}

#[test]
fn left_jacobians_match_the_power_series() {
    for theta in [0.0, 1e-9, -1e-5, 9e-5, 1.1e-4, 1e-3, -0.02, 0.29, 0.31, 0.49, -0.51, 1.0, -2.0, 3.0] {
        check::<3, Isometry2<f64>>(SVector::from([1.3, -0.7, theta]));
        check::<6, Isometry3<f64>>(SVector::from([1.3, -0.7, 2.1, 0.6 * theta, -0.48 * theta, 0.64 * theta]));
    }
}

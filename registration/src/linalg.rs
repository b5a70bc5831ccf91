use nalgebra::{SMatrix, SVector};

/// Eigenvalues in ascending order and the unit eigenvectors as columns, by cyclic Jacobi rotations.
///
/// nalgebra's own needs bounds on `N` that a generic caller cannot state.
pub(crate) fn symmetric_eigen<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let mut m = (matrix + matrix.transpose()) * 0.5;
    let mut vectors = SMatrix::<f64, N, N>::identity();
    for _sweep in 0..30 {
        let off: f64 = (0..N).flat_map(|p| (p + 1..N).map(move |q| (p, q))).map(|pq| m[pq] * m[pq]).sum();
        if off <= 1e-30 * m.norm_squared() {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                if m[(p, q)] != 0.0 {
                    rotate(&mut m, &mut vectors, p, q);
                }
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|&a, &b| m[(a, a)].total_cmp(&m[(b, b)]).then(a.cmp(&b)));
    (SVector::from_fn(|i, _| m[(order[i], order[i])]), SMatrix::from_fn(|i, j| vectors[(i, order[j])]))
}

fn rotate<const N: usize>(m: &mut SMatrix<f64, N, N>, vectors: &mut SMatrix<f64, N, N>, p: usize, q: usize) {
    let theta = (m[(q, q)] - m[(p, p)]) / (2.0 * m[(p, q)]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..N {
        let (a, b) = (m[(k, p)], m[(k, q)]);
        (m[(k, p)], m[(k, q)]) = (c * a - s * b, s * a + c * b);
    }
    for k in 0..N {
        let (a, b) = (m[(p, k)], m[(q, k)]);
        (m[(p, k)], m[(q, k)]) = (c * a - s * b, s * a + c * b);
        let (a, b) = (vectors[(k, p)], vectors[(k, q)]);
        (vectors[(k, p)], vectors[(k, q)]) = (c * a - s * b, s * a + c * b);
    }
}

/// Solves `h x = g` for symmetric non-negative `h`, with `x` zero along directions whose eigenvalue is below
/// `relative` of the largest.
pub(crate) fn pseudo_solve<const N: usize>(
    h: &SMatrix<f64, N, N>,
    g: &SVector<f64, N>,
    relative: f64,
) -> SVector<f64, N> {
    let (values, vectors) = symmetric_eigen(h);
    let floor = relative * values[N - 1];
    let mut x = SVector::zeros();
    for k in 0..N {
        if values[k] > floor && values[k] > 0.0 {
            let v = vectors.column(k);
            x += v * (v.dot(g) / values[k]);
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `A v = λ v` for every pair, orthonormal vectors, ascending values: together they leave no eigenvalue out.
    fn residual_is_rounding<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Result<(), TestCaseError> {
        let (values, vectors) = symmetric_eigen(matrix);
        let size = matrix.norm().max(f64::MIN_POSITIVE);
        let rebuilt = vectors * SMatrix::from_diagonal(&values) * vectors.transpose();
        prop_assert!((rebuilt - matrix).norm() <= 1e-13 * size, "{matrix} {values}");
        prop_assert!((vectors.transpose() * vectors - SMatrix::identity()).norm() <= 1e-13);
        prop_assert!((1..N).all(|k| values[k - 1] <= values[k]));
        Ok(())
    }

    /// Random, with blocks of zeros, equal rows, repeated eigenvalues and entries of very unequal size.
    fn symmetric<const N: usize>() -> impl Strategy<Value = SMatrix<f64, N, N>> {
        let entry = prop_oneof![
            3 => -1.0..1.0f64, 2 => Just(0.0), 1 => Just(1.0), 1 => Just(-1.0), 1 => -1e-9..1e-9f64, 1 => -1e6..1e6f64
        ];
        prop::collection::vec(entry, N * N).prop_map(|v| {
            let m = SMatrix::<f64, N, N>::from_column_slice(&v);
            m + m.transpose()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn eigenvalues_of_two(m in symmetric::<2>()) { residual_is_rounding(&m)?; }
        #[test]
        fn eigenvalues_of_three(m in symmetric::<3>()) { residual_is_rounding(&m)?; }
        #[test]
        fn eigenvalues_of_four(m in symmetric::<4>()) { residual_is_rounding(&m)?; }
        #[test]
        fn eigenvalues_of_six(m in symmetric::<6>()) { residual_is_rounding(&m)?; }
    }
}

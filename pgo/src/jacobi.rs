/// Sweeps, at most; the method converges quadratically, in fewer than ten.
const SWEEPS: usize = 60;

/// Diagonalises a positive semidefinite matrix of `n` rows, of which the eigenvalues stay on the diagonal, in no order.
/// The eigenvectors are the columns of `vectors`, that of the largest eigenvalue first. Column-major, both.
///
/// Jacobi's cyclic method: eigenvectors are orthogonal to rounding whatever the spectrum.
///
/// **Source**: Golub, Van Loan, *Matrix Computations*, section 8.5.
#[inline(always)]
pub(crate) fn eigenvectors(a: &mut [f64], vectors: &mut [f64], n: usize) {
    vectors.fill(0.0);
    (0..n).for_each(|k| vectors[k * n + k] = 1.0);
    for _ in 0..SWEEPS {
        let mut turned = false;
        for p in 0..n {
            for q in p + 1..n {
                let (pp, qq, pq) = (a[p * n + p], a[q * n + q], a[q * n + p]);
                if pq.abs() <= 0.5 * f64::EPSILON * (pp * qq).abs().sqrt() || pq == 0.0 {
                    continue;
                }
                turned = true;
                // the smaller root of t² + 2 θ t - 1 = 0 makes the off-diagonal entry zero
                let theta = (qq - pp) / (2.0 * pq);
                let t = f64::copysign(1.0, theta) / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[p * n + k], a[q * n + k]);
                    (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
                }
                for column in a.chunks_exact_mut(n) {
                    let (x, y) = (column[p], column[q]);
                    (column[p], column[q]) = (c * x - s * y, s * x + c * y);
                }
                (a[q * n + p], a[p * n + q]) = (0.0, 0.0);
                for k in 0..n {
                    let (x, y) = (vectors[p * n + k], vectors[q * n + k]);
                    (vectors[p * n + k], vectors[q * n + k]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
        if !turned {
            break;
        }
    }
    // n is small: the largest of the rest to the front
    for k in 0..n {
        let most = (k..n).fold(k, |most, i| if a[i * n + i] > a[most * n + most] { i } else { most });
        if most != k {
            a.swap(k * n + k, most * n + most);
            (0..n).for_each(|row| vectors.swap(k * n + row, most * n + row));
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn eigenvectors_are_orthogonal_and_diagonalise() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for n in 1..8 {
            for rank in 1..=n {
                let half = DMatrix::<f64>::from_fn(n, rank, |_, _| rng.random_range(-1.0..1.0));
                let matrix = &half * half.transpose();
                let (mut a, mut v) = (matrix.clone(), DMatrix::zeros(n, n));
                eigenvectors(a.as_mut_slice(), v.as_mut_slice(), n);
                assert!((v.tr_mul(&v) - DMatrix::identity(n, n)).amax() < 1e-14);
                let d = v.tr_mul(&matrix) * &v;
                for i in 0..n {
                    for j in 0..n {
                        assert!(i == j || d[(i, j)].abs() < 2e-14, "{d}");
                    }
                    assert!(i == 0 || d[(i - 1, i - 1)] >= d[(i, i)] - 1e-14, "{d}");
                }
            }
        }
    }
}

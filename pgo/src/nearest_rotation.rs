use nalgebra::{SMatrix, SVector};

/// The rotation nearest to a matrix in the Frobenius norm; one of them where there are several.
///
/// What is not far from a rotation goes by [`polar`]. Else, with `V` the right singular vectors of `M`, the columns of
/// `M V` are made orthonormal; the last, for the smallest singular value, is the one that may have to be turned over for
/// the result to be proper.
pub(crate) fn nearest_rotation<const D: usize>(m: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    if let Some(rotation) = polar(m) {
        return rotation;
    }
    let (mut left, right) = orthogonal_columns(m);
    let least = f64::EPSILON * m.norm();
    for k in 0..D {
        let mut column = left.column(k).into_owned();
        clear(&mut column, &left, k);
        let norm = column.norm();
        if norm > least && k + 1 < D {
            column /= norm;
            clear(&mut column, &left, k);
            column.normalize_mut();
        } else {
            column = completion(&left, k);
        }
        left.set_column(k, &column);
    }
    if determinant(&left) * determinant(&right) < 0.0 {
        left.column_mut(D - 1).neg_mut();
    }
    left * right.transpose()
}

/// Determinant, at norm `√D`, from which on [`polar`] serves: singular values are then within a factor of 30.
const ROTATION_LIKE: f64 = 0.1;

/// The orthogonal polar factor of a matrix that is not far from a multiple of a rotation, by Newton's method, which
/// converges quadratically.
///
/// **Source**: Higham, *Computing the polar decomposition, with applications*, 1986.
fn polar<const D: usize>(m: &SMatrix<f64, D, D>) -> Option<SMatrix<f64, D, D>> {
    let mut x = m * ((D as f64).sqrt() / m.norm());
    let determinant = determinant(&x);
    if determinant.is_nan() || determinant < ROTATION_LIKE {
        return None;
    }
    for _ in 0..20 {
        let next = (x + x.try_inverse()?.transpose()) * 0.5;
        let change = (next - x).amax();
        x = next;
        // what is left is about the square of that
        if change < 1e-9 {
            return Some(x);
        }
    }
    None
}

/// The singular values of a matrix, the largest first.
pub(crate) fn singular_values<const D: usize>(m: &SMatrix<f64, D, D>) -> [f64; D] {
    let (columns, _) = orthogonal_columns(m);
    std::array::from_fn(|k| columns.column(k).norm())
}

/// Sweeps, at most; the method converges quadratically, in fewer than ten.
const SWEEPS: usize = 60;

/// `M V` with `V` orthogonal so that the columns of `M V` are orthogonal, the longest first, and `V`.
///
/// Hestenes' one-sided Jacobi method: unlike the eigenvectors of `Mᵀ M` it tells directions also where their singular
/// values are far below the largest.
///
/// **Source**: Golub, Van Loan, *Matrix Computations*, section 8.6.
fn orthogonal_columns<const D: usize>(m: &SMatrix<f64, D, D>) -> (SMatrix<f64, D, D>, SMatrix<f64, D, D>) {
    let (mut product, mut right) = (*m, SMatrix::<f64, D, D>::identity());
    for _ in 0..SWEEPS {
        let mut turned = false;
        for p in 0..D {
            for q in p + 1..D {
                let (a, b) = (product.column(p), product.column(q));
                let (pp, qq, pq) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
                if pq.is_nan() || pq.abs() <= f64::EPSILON * pp.sqrt() * qq.sqrt() {
                    continue;
                }
                turned = true;
                // the smaller root of t² + 2 θ t - 1 = 0 makes the columns orthogonal
                let theta = (qq - pp) / (2.0 * pq);
                let t = f64::copysign(1.0, theta) / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                turn(&mut product, p, q, c, t * c);
                turn(&mut right, p, q, c, t * c);
            }
        }
        if !turned {
            break;
        }
    }
    for k in 0..D {
        let length = |i: &usize| product.column(*i).norm_squared();
        let longest = (k..D).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(k);
        product.swap_columns(k, longest);
        right.swap_columns(k, longest);
    }
    (product, right)
}

/// Turns columns `p` and `q` in the plane that they span.
fn turn<const D: usize>(m: &mut SMatrix<f64, D, D>, p: usize, q: usize, c: f64, s: f64) {
    for r in 0..D {
        let (x, y) = (m[(r, p)], m[(r, q)]);
        (m[(r, p)], m[(r, q)]) = (c * x - s * y, s * x + c * y);
    }
}

/// Takes the part along the first `k` columns out of a vector.
fn clear<const D: usize>(v: &mut SVector<f64, D>, columns: &SMatrix<f64, D, D>, k: usize) {
    for before in columns.column_iter().take(k) {
        let along = before.dot(v);
        v.axpy(-along, &before, 1.0);
    }
}

/// A unit vector orthogonal to the first `k` columns, from the axis of which they leave most.
fn completion<const D: usize>(columns: &SMatrix<f64, D, D>, k: usize) -> SVector<f64, D> {
    let taken = |axis: usize| columns.row(axis).columns(0, k).norm_squared();
    let axis = (0..D).min_by(|a, b| taken(*a).total_cmp(&taken(*b))).unwrap_or(0);
    let mut column = SVector::zeros();
    column[axis] = 1.0;
    for _ in 0..2 {
        clear(&mut column, columns, k);
        column.normalize_mut();
    }
    column
}

/// The determinant, by elimination with pivots.
pub(crate) fn determinant<const D: usize>(m: &SMatrix<f64, D, D>) -> f64 {
    let (mut m, mut product) = (*m, 1.0);
    for k in 0..D {
        let pivot = (k..D).fold(k, |most, r| if m[(r, k)].abs() > m[(most, k)].abs() { r } else { most });
        if pivot != k {
            m.swap_rows(pivot, k);
            product = -product;
        }
        product *= m[(k, k)];
        if product == 0.0 {
            return 0.0;
        }
        for r in k + 1..D {
            let factor = m[(r, k)] / m[(k, k)];
            for c in k..D {
                m[(r, c)] -= factor * m[(k, c)];
            }
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3, Vector3};
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn no_rotation_is_nearer() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        for rank in 0..=4 {
            for _ in 0..30 {
                let mut m = Matrix3::from_fn(|_, c| if c < rank { rng.random_range(-1.0..1.0) } else { 0.0 });
                if rank == 4 {
                    // not far from a rotation, as in the chordal start
                    m = m * 0.2 + Rotation3::new(m.column(0) * 3.0).into_inner();
                }
                let nearest = nearest_rotation(&m);
                assert!((nearest.tr_mul(&nearest) - Matrix3::identity()).amax() < 1e-14);
                assert!((nearest.determinant() - 1.0).abs() < 1e-14);
                for _ in 0..50 {
                    let by = Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0));
                    let other = Rotation3::new(by).into_inner() * nearest;
                    assert!((other - m).norm() >= (nearest - m).norm() - 1e-12);
                }
            }
        }
    }

    #[test]
    fn singular_values_are_told_however_small() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut rotation =
            || Rotation3::new(Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0))).into_inner();
        for values in [[3.0, 2.0, 1.0], [1.0, 1e-10, 0.0], [1.0, 1e-6, 1e-12], [1.0, 1.0, 1.0], [0.0; 3]] {
            for _ in 0..20 {
                let m = rotation() * Matrix3::from_diagonal(&Vector3::from(values)) * rotation();
                for (found, expected) in singular_values(&m).iter().zip(values) {
                    assert!((found - expected).abs() <= 3e-15 * values[0], "{found} {expected}");
                }
            }
        }
    }

    #[test]
    fn determinants_agree_with_nalgebras() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..20 {
            let m = Matrix3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            assert!((determinant(&m) - m.determinant()).abs() < 1e-15 * 10.0);
        }
    }
}

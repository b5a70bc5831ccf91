use nalgebra::{SMatrix, SVector};

use crate::jacobi::eigenvectors;

/// The rotation nearest to a matrix in the Frobenius norm; one of them where there are several.
///
/// With `V` the eigenvectors of `Mᵀ M`, the columns of `M V` are made orthonormal; the last, for the smallest singular
/// value, is the one that may have to be turned over for the result to be proper.
pub(crate) fn nearest_rotation<const D: usize>(m: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
    let mut gram = m.tr_mul(m);
    let mut right = SMatrix::<f64, D, D>::zeros();
    eigenvectors(gram.as_mut_slice(), right.as_mut_slice(), D);
    let mut left = m * right;
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
        for rank in 0..=3 {
            for _ in 0..30 {
                let m = Matrix3::from_fn(|_, c| if c < rank { rng.random_range(-1.0..1.0) } else { 0.0 });
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
    fn determinants_agree_with_nalgebras() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..20 {
            let m = Matrix3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            assert!((determinant(&m) - m.determinant()).abs() < 1e-15 * 10.0);
        }
    }
}

use nalgebra::{SMatrix, SVector};

use crate::Error;

/// The mean of `m` and its transpose: takes the last-digit asymmetry of a triple product away.
pub(crate) fn symmetrize<const N: usize>(m: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (m + m.transpose()) * 0.5
}

/// Lower triangular `L` with `L Lᵀ = m` for a positive definite `m`.
pub(crate) fn factor<const N: usize>(
    m: &SMatrix<f64, N, N>,
    what: &'static str,
) -> Result<SMatrix<f64, N, N>, Error> {
    let mut l = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        let value = m[(j, j)] - (0..j).map(|k| l[(j, k)] * l[(j, k)]).sum::<f64>();
        // also false for NaN; the right side is the rounding of the subtraction, below which the sign is noise
        if !(value > f64::EPSILON * m[(j, j)] && value.is_finite()) {
            return Err(Error::NotPositiveDefinite { what, pivot: j, value });
        }
        let pivot = value.sqrt();
        l[(j, j)] = pivot;
        for i in j + 1..N {
            let dot = (0..j).map(|k| l[(i, k)] * l[(j, k)]).sum::<f64>();
            l[(i, j)] = (m[(i, j)] - dot) / pivot;
        }
    }
    Ok(l)
}

/// `L⁻¹ x`; its squared length is `xᵀ (L Lᵀ)⁻¹ x`.
pub(crate) fn whiten<const N: usize>(l: &SMatrix<f64, N, N>, x: &SVector<f64, N>) -> SVector<f64, N> {
    let mut y = *x;
    for i in 0..N {
        let dot = (0..i).map(|k| l[(i, k)] * y[k]).sum::<f64>();
        y[i] = (y[i] - dot) / l[(i, i)];
    }
    y
}

/// `L⁻¹ m`, column by column.
pub(crate) fn whiten_columns<const N: usize>(
    l: &SMatrix<f64, N, N>,
    m: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    let mut whitened = *m;
    for mut column in whitened.column_iter_mut() {
        let solved = whiten(l, &column.clone_owned());
        column.copy_from(&solved);
    }
    whitened
}

/// The inverse of a positive definite matrix, exactly symmetric: `L⁻ᵀ L⁻¹`.
pub(crate) fn invert<const N: usize>(
    m: &SMatrix<f64, N, N>,
    what: &'static str,
) -> Result<SMatrix<f64, N, N>, Error> {
    let root = whiten_columns(&factor(m, what)?, &SMatrix::identity());
    Ok(symmetrize(&(root.transpose() * root)))
}

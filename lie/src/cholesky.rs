use nalgebra::{SMatrix, SVector};

use crate::Error;

/// Asymmetry, relative to the geometric mean of the two diagonal entries, that still counts as rounding.
const SYMMETRY_TOLERANCE: f64 = 1e-9;

/// Deviation of a rotation's norm from one that still counts as rounding: about 10⁶ steps without renormalising.
const UNIT_TOLERANCE: f64 = 1e-9;

/// First non-finite entry of a matrix or vector, as an error about `what`.
pub(crate) fn check_finite<const R: usize, const C: usize>(
    m: &SMatrix<f64, R, C>,
    what: &'static str,
) -> Result<(), Error> {
    match m.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        Some((index, &value)) => Err(Error::NotFinite { what, index, value }),
        None => Ok(()),
    }
}

/// `Ok` iff the norm of a rotation is one up to rounding.
pub(crate) fn check_unit(norm: f64) -> Result<(), Error> {
    if (norm - 1.0).abs() <= UNIT_TOLERANCE { Ok(()) } else { Err(Error::NotUnit { norm }) }
}

/// `Ok` iff `m` is finite and symmetric up to rounding.
pub(crate) fn check_symmetric<const N: usize>(
    m: &SMatrix<f64, N, N>,
    what: &'static str,
) -> Result<(), Error> {
    check_finite(m, what)?;
    for row in 0..N {
        for column in 0..row {
            let difference = (m[(row, column)] - m[(column, row)]).abs();
            let scale = (m[(row, row)].abs() * m[(column, column)].abs()).sqrt();
            if difference > SYMMETRY_TOLERANCE * scale {
                return Err(Error::NotSymmetric { what, row, column, difference });
            }
        }
    }
    Ok(())
}

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

use nalgebra::SMatrix;

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
            // roots first: the product of two large variances overflows
            let scale = m[(row, row)].abs().sqrt() * m[(column, column)].abs().sqrt();
            if difference > SYMMETRY_TOLERANCE * scale {
                return Err(Error::NotSymmetric { what, row, column, difference });
            }
        }
    }
    Ok(())
}

/// Deviation of a matrix from a rotation that still counts as rounding (a file with seven digits passes).
const ROTATION_TOLERANCE: f64 = 1e-6;

/// `Ok` iff `RᵀR = I` and `det R > 0`.
pub(crate) fn check_rotation<const D: usize>(r: &SMatrix<f64, D, D>, determinant: f64) -> Result<(), Error> {
    check_finite(r, "the rotation matrix")?;
    // entries first: squares of huge ones overflow to NaN, which no comparison below would see
    let beyond = r.amax() - 1.0;
    if beyond > ROTATION_TOLERANCE {
        return Err(Error::NotRotation { reason: "an entry is larger than one", deviation: beyond });
    }
    let deviation = (r.transpose() * r - SMatrix::identity()).amax();
    if deviation > ROTATION_TOLERANCE {
        return Err(Error::NotRotation { reason: "its columns are not orthonormal", deviation });
    }
    if determinant < 0.0 {
        return Err(Error::NotRotation {
            reason: "it is a reflection",
            deviation: (determinant - 1.0).abs(),
        });
    }
    Ok(())
}

/// `Ok` iff a homogeneous matrix is finite and ends in the row `0 … 0 1`.
pub(crate) fn check_bottom_row<const D: usize>(m: &SMatrix<f64, D, D>) -> Result<(), Error> {
    check_finite(m, "the homogeneous matrix")?;
    let ideal = SMatrix::<f64, D, D>::identity();
    let deviation = (m.row(D - 1) - ideal.row(D - 1)).amax();
    if deviation > ROTATION_TOLERANCE {
        return Err(Error::NotRotation { reason: "its last row is not 0 … 0 1", deviation });
    }
    Ok(())
}

/// `Ok` iff a matrix is the hat of a tangent vector up to rounding.
pub(crate) fn check_hat<const D: usize>(
    m: &SMatrix<f64, D, D>,
    ideal: &SMatrix<f64, D, D>,
) -> Result<(), Error> {
    check_finite(m, "the hat matrix")?;
    let deviation = (m - ideal).amax();
    if deviation > ROTATION_TOLERANCE * m.amax() { Err(Error::NotHat { deviation }) } else { Ok(()) }
}

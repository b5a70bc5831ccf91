//! Matrices of float64 in C order as numpy stores them.

use anyhow::{Context, Result, ensure};

/// Rows, columns and row-major values of a two-dimensional npy file.
pub(crate) fn read_npy(bytes: &[u8]) -> Result<(usize, usize, Vec<f64>)> {
    ensure!(bytes.starts_with(b"\x93NUMPY"), "not an npy file");
    let wide = *bytes.get(6).context("cut off")? > 1;
    let (from, size) = if wide { (12, 4) } else { (10, 2) };
    let field = bytes.get(8..8 + size).context("cut off")?;
    let length = field.iter().rev().fold(0_usize, |sum, b| (sum << 8) | usize::from(*b));
    let (header, body) =
        bytes.get(from..).and_then(|rest| rest.split_at_checked(length)).context("cut off header")?;
    let header = std::str::from_utf8(header)?;
    ensure!(header.contains("'<f8'"), "entries are not little-endian float64");
    ensure!(header.contains("'fortran_order': False"), "not in C order");
    let shape = header.split("'shape':").nth(1).context("no shape")?;
    let inner = shape.split(['(', ')']).nth(1).context("no shape")?;
    let sizes: Vec<usize> = inner
        .split(',')
        .map(str::trim)
        .filter(|s| !s.is_empty())
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    let &[rows, columns] = sizes.as_slice() else { anyhow::bail!("shape {sizes:?} is not a matrix") };
    ensure!(body.len().is_multiple_of(8), "{} bytes are no whole number of entries", body.len());
    let values: Vec<f64> = body
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
        .collect();
    ensure!(
        rows.checked_mul(columns) == Some(values.len()),
        "{} entries for {rows} × {columns}",
        values.len()
    );
    Ok((rows, columns, values))
}

//! Readers of point files: text columns, PLY, PCD and VTK.
//!
//! [`read_points`] chooses by the file's extension; the `parse_*` functions work on bytes in memory. All return
//! the first `D` coordinates of every point; points with a coordinate that is not finite are an error in text
//! files (a line is named) and are dropped in PLY and PCD, where NaN stands for "no return".

mod columns;
mod fields;
mod pcd;
mod ply;
mod vtk;

pub use columns::parse_columns;
pub use pcd::parse_pcd;
pub use ply::parse_ply;
pub use vtk::parse_vtk;

use std::path::Path;

use nalgebra::SVector;

use crate::Error;

/// Reads the points of a file: `.ply`, `.pcd`, `.vtk`, anything else as text columns.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] with the line (or, in binary data, the point)
/// when it is not what it should be.
pub fn read_points<const D: usize>(path: &Path) -> Result<Vec<SVector<f64, D>>, Error> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| Error::Io { path: name, message: e.to_string() })?;
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("ply") => parse_ply(&bytes),
        Some("pcd") => parse_pcd(&bytes),
        Some("vtk") => parse_vtk(&bytes),
        _ => parse_columns(&bytes),
    }
}

/// An error at a line, counted from 1.
pub(crate) fn at(line: usize, message: impl Into<String>) -> Error {
    Error::Parse { line, message: message.into() }
}

/// The text of a line of bytes without its end.
pub(crate) fn text(line: usize, bytes: &[u8]) -> Result<&str, Error> {
    std::str::from_utf8(bytes).map(str::trim).map_err(|_| at(line, "not text"))
}

/// One finite number.
pub(crate) fn number(line: usize, word: &str) -> Result<f64, Error> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(at(line, format!("`{word}` is not a finite number"))),
    }
}

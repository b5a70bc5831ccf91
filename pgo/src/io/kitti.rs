//! Trajectories in the format of the KITTI odometry benchmark: one line a pose, the upper three rows of its
//! homogeneous matrix row by row, twelve numbers, metres. There are no times: line `k` is pose `k`.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::text;
use crate::Error;
use crate::nearest_rotation::nearest_rotation;

/// Largest deviation of a matrix in a file from the nearest rotation, in any entry: files hold six digits or more.
const ROTATION_TOLERANCE: f64 = 1e-4;

/// Reads a file.
///
/// # Errors
/// [`Error::File`]; [`Error::InFile`] with what [`parse`] returns.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<Isometry3<f64>>, Error> {
    text::read(path.as_ref(), parse)
}

/// Parses a text. Rotations are the nearest ones to the matrices, which may be off by 1e-4 in any entry.
///
/// # Errors
/// [`Error::Parse`] with the line and the reason.
pub fn parse(text: &str) -> Result<Vec<Isometry3<f64>>, Error> {
    text::lines(text, |tokens| {
        let mut matrix = Matrix3::zeros();
        let mut translation = Vector3::zeros();
        for row in 0..3 {
            for column in 0..3 {
                matrix[(row, column)] = text::number(tokens)?;
            }
            translation[row] = text::number(tokens)?;
        }
        if matrix.amax() > 1.0 + ROTATION_TOLERANCE {
            return Err("the left three columns are not a rotation matrix".into());
        }
        let rotation = nearest_rotation(&matrix);
        if (rotation - matrix).amax() > ROTATION_TOLERANCE {
            return Err("the left three columns are not a rotation matrix".into());
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        Ok(Isometry3::from_parts(Translation3::from(translation), rotation))
    })
}

/// The text of a trajectory; reading it again gives the same translations and, but for rounding, rotations.
pub fn to_text(trajectory: &[Isometry3<f64>]) -> String {
    let mut text = String::new();
    for pose in trajectory {
        let r = pose.rotation.to_rotation_matrix();
        for row in 0..3 {
            for column in 0..3 {
                let _ = write!(text, "{} ", r[(row, column)]);
            }
            // writing to a string cannot fail
            let _ = write!(text, "{}{}", pose.translation.vector[row], if row < 2 { " " } else { "\n" });
        }
    }
    text
}

/// Writes a trajectory to a file.
///
/// # Errors
/// [`Error::File`].
pub fn write(trajectory: &[Isometry3<f64>], path: impl AsRef<Path>) -> Result<(), Error> {
    text::write(path.as_ref(), &to_text(trajectory))
}

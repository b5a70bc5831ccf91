//! Trajectories in the format of the TUM RGB-D benchmark: one line a pose, `time x y z qx qy qz qw`, seconds and
//! metres; lines that start with `#` are comments.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Isometry3;

use super::g2o::G2oPose;
use super::text;
use crate::Error;

/// A pose at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// Time in seconds.
    pub time: f64,
    /// `world_from_body`.
    pub pose: Isometry3<f64>,
}

/// Reads a file.
///
/// # Errors
/// [`Error::File`]; [`Error::InFile`] with what [`parse`] returns.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<StampedPose>, Error> {
    text::read(path.as_ref(), parse)
}

/// Parses a text. Quaternions are normalised unless they are so already; times may come in any order.
///
/// # Errors
/// [`Error::Parse`] with the line and the reason.
pub fn parse(text: &str) -> Result<Vec<StampedPose>, Error> {
    text::lines(text, |tokens| {
        let time = text::number(tokens)?;
        let mut numbers = [0.0; 7];
        for x in &mut numbers {
            *x = text::number(tokens)?;
        }
        Ok(StampedPose { time, pose: Isometry3::from_numbers(&numbers)? })
    })
}

/// The text of a trajectory; reading it again gives the same bits.
pub fn to_text(trajectory: &[StampedPose]) -> String {
    let mut text = String::new();
    for StampedPose { time, pose } in trajectory {
        let (t, q) = (&pose.translation, &pose.rotation);
        // the shortest digits that read back as the same number; writing to a string cannot fail
        let _ = writeln!(text, "{time} {} {} {} {} {} {} {}", t.x, t.y, t.z, q.i, q.j, q.k, q.w);
    }
    text
}

/// Writes a trajectory to a file.
///
/// # Errors
/// [`Error::File`].
pub fn write(trajectory: &[StampedPose], path: impl AsRef<Path>) -> Result<(), Error> {
    text::write(path.as_ref(), &to_text(trajectory))
}

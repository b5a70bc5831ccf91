/// What was wrong with an input of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate that is NaN or infinite.
    #[error("point {index} has a coordinate that is not a finite number")]
    NonFinitePoint {
        /// Index of the first such point.
        index: usize,
    },
    /// A pose, normal or other per-point quantity that is NaN or infinite.
    #[error("{what} is not finite")]
    NonFinite {
        /// What it was.
        what: &'static str,
    },
    /// Fewer points than the operation needs.
    #[error("{what} has {found} points, at least {needed} are needed")]
    TooFewPoints {
        /// Which set.
        what: &'static str,
        /// How many it has.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// A residual that needs normals met a cloud without them.
    #[error("the {what} cloud has no normals, which this residual needs: see `Cloud::estimate_normals`")]
    MissingNormals {
        /// Which cloud.
        what: &'static str,
    },
    /// A residual that needs covariances met two clouds without them.
    #[error(
        "neither cloud has covariances, which this residual needs: see `Cloud::with_covariances` and `estimate_covariances`"
    )]
    MissingCovariances,
    /// Two lists that belong together differ in length.
    #[error("{what}: {found} entries for {expected} points")]
    LengthMismatch {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The number of points.
        expected: usize,
    },
    /// A file that cannot be read.
    #[error("{path}: {message}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        message: String,
    },
    /// A file that is not what it should be.
    #[error("line {line}: {message}")]
    Parse {
        /// Line, counted from 1; for binary data the last line of the header.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A parameter outside its valid range.
    #[error("parameter `{name}` is {value}, which is outside {range}")]
    Parameter {
        /// Field name.
        name: &'static str,
        /// Offending value.
        value: f64,
        /// Valid range in words.
        range: &'static str,
    },
    /// Points so far apart that a grid over them would not fit in memory.
    #[error(
        "{what} spans {width} m x {height} m, which in cells of {cell} m makes a grid of {cells} cells (limit {limit}); its farthest point is {farthest}"
    )]
    GridTooLarge {
        /// Which set of points.
        what: &'static str,
        /// Extent of the points in x, metres.
        width: f64,
        /// Extent of the points in y, metres.
        height: f64,
        /// Edge of a cell, metres.
        cell: f64,
        /// Cells the grid would have.
        cells: u64,
        /// Largest number allowed.
        limit: u64,
        /// Index of the point farthest from the median of the coordinates: the likely culprit.
        farthest: usize,
    },
    /// A covariance that is not positive definite.
    #[error("{what} is not positive definite")]
    NotPositiveDefinite {
        /// Which matrix.
        what: &'static str,
    },
}

/// Checks `value` against a range told in words.
pub(crate) fn check(name: &'static str, value: f64, valid: bool, range: &'static str) -> Result<(), Error> {
    if valid { Ok(()) } else { Err(Error::Parameter { name, value, range }) }
}

use thiserror::Error;

/// What can be wrong with the input of this crate.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A point or a centroid with a coordinate that is not finite.
    #[error("point {index} of {what} has a coordinate that is not finite")]
    NonFinitePoint {
        /// Which argument holds it.
        what: &'static str,
        /// Its index there.
        index: usize,
    },
    /// An object whose length or breadth is negative or not finite.
    #[error("object {index} of {map} has extent {value}, which is not a finite length")]
    BadExtent {
        /// `map1` or `map2`.
        map: &'static str,
        /// Index of the object.
        index: usize,
        /// The offending value, metres.
        value: f64,
    },
    /// A covariance that is not symmetric positive semi-definite.
    #[error("object {index} of {map} has a covariance that is not positive semi-definite")]
    BadCovariance {
        /// `map1` or `map2`.
        map: &'static str,
        /// Index of the object.
        index: usize,
    },
    /// A parameter outside its range.
    #[error("parameter {name} = {value} is out of range: {need}")]
    BadParameter {
        /// Name of the field or argument.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What would be valid.
        need: &'static str,
    },
    /// A cost that is NaN or -∞.
    #[error("cost ({row}, {column}) is {value}; costs are finite or +∞ (forbidden)")]
    BadCost {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// A slice whose length does not fit the stated shape.
    #[error("{what} has {found} elements where {expected} are needed")]
    WrongLength {
        /// Which argument.
        what: &'static str,
        /// Elements needed.
        expected: usize,
        /// Elements given.
        found: usize,
    },
    /// A row (a column where there are more rows than columns) that no finite-cost assignment can serve.
    #[error("row {row} cannot be assigned: its allowed columns are all needed by other rows")]
    Infeasible {
        /// The first row found without an augmenting path.
        row: usize,
    },
    /// A text that is not a QAPLIB instance or not an npy file.
    #[error("{what}: {reason}")]
    Parse {
        /// What was read.
        what: &'static str,
        /// Why it failed.
        reason: String,
    },
}

/// What was wrong with an input of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A probability outside the open interval (0, 1).
    #[error("probability {value} is not between 0 and 1")]
    Probability {
        /// The offending value.
        value: f64,
    },
    /// Zero degrees of freedom.
    #[error("a chi-square distribution needs at least one degree of freedom")]
    DegreesOfFreedom,
    /// NaN or infinity where a number is needed.
    #[error("{what}: entry {index} is {value}, not a finite number")]
    NotFinite {
        /// Which argument.
        what: &'static str,
        /// Index of the first bad entry, matrices column by column.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// A quaternion or complex number whose norm is not one.
    #[error("the rotation has norm {norm}, not 1; see `LieGroup::renormalize`")]
    NotUnit {
        /// The norm found.
        norm: f64,
    },
    /// A matrix that is not a rotation (or not the homogeneous matrix of a pose).
    #[error("the matrix is not a rotation: {reason}, off by {deviation}")]
    NotRotation {
        /// Which property fails.
        reason: &'static str,
        /// By how much.
        deviation: f64,
    },
    /// A matrix that is not skew-symmetric (or not the hat of a tangent).
    #[error("the matrix is not the hat of a tangent vector: off by {deviation}")]
    NotHat {
        /// By how much.
        deviation: f64,
    },
    /// A covariance or information matrix that is not symmetric.
    #[error(
        "{what} is not symmetric: entries ({row}, {column}) and ({column}, {row}) differ by {difference}"
    )]
    NotSymmetric {
        /// Which matrix.
        what: &'static str,
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The difference found.
        difference: f64,
    },
    /// A covariance or information matrix that is not positive definite (not semi-definite where that is
    /// enough).
    #[error("{what} is not positive definite: pivot {pivot} of its Cholesky factorisation is {value}")]
    NotPositiveDefinite {
        /// Which matrix.
        what: &'static str,
        /// Index of the failing pivot.
        pivot: usize,
        /// Its value.
        value: f64,
    },
    /// A negative squared distance.
    #[error("the squared distance {value} is negative")]
    NegativeDistance {
        /// The offending value.
        value: f64,
    },
    /// A mean of nothing.
    #[error("the mean of no poses is not defined")]
    Empty,
    /// A different number of weights than of poses.
    #[error("{poses} poses but {weights} weights")]
    WeightCount {
        /// Number of poses.
        poses: usize,
        /// Number of weights.
        weights: usize,
    },
    /// A weight that is negative or not finite, or weights that are all zero.
    #[error("weight {index} is {value}; weights are finite, not negative and not all zero")]
    Weight {
        /// Index of the weight.
        index: usize,
        /// The offending value.
        value: f64,
    },
}

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
}

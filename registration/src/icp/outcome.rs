use nalgebra::{SMatrix, SVector};

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Termination {
    /// The steps fell below the limits of the stop rule.
    Converged,
    /// The iteration limit came first.
    MaxIterations,
    /// Fewer pairs than the pose has unknowns were left; the pose is the last one that had enough.
    TooFewPairs,
}

/// Statistics of the residuals of the pairs that took part, at the answer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ResidualStatistics {
    /// Source points with a target point within the matcher's reach.
    pub matched: usize,
    /// Pairs the rejectors left.
    pub inliers: usize,
    /// Root mean square distance of those pairs, metres.
    pub rms: f64,
    /// Estimated noise of one residual coordinate, metres.
    pub sigma: f64,
}

/// Where the source lies, and how sure that is.
///
/// Tangent order is translation, then rotation; covariance and information belong to a perturbation on the
/// right, `target_from_source · exp(ξ)`, that is in the frame of the source.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration<G, const N: usize> {
    /// Maps source points into the target's frame.
    pub target_from_source: G,
    /// Covariance of `ξ`, metres and radians; [`crate::DEGENERATE_SIGMA`] along degenerate directions.
    pub covariance: SMatrix<f64, N, N>,
    /// Information of `ξ`, exactly zero along degenerate directions.
    pub information: SMatrix<f64, N, N>,
    /// Unit directions in `ξ` along which the scans do not fix the pose. Empty: everything is fixed.
    pub degenerate_directions: Vec<SVector<f64, N>>,
    /// Share of the source points with a target point within `overlap_radius`.
    pub overlap: f64,
    /// Residuals at the answer.
    pub residuals: ResidualStatistics,
    /// Steps taken.
    pub iterations: usize,
    /// Why it ended.
    pub termination: Termination,
}

impl<G, const N: usize> Registration<G, N> {
    /// Whether the iteration converged.
    pub fn converged(&self) -> bool {
        self.termination == Termination::Converged
    }

    /// Whether some direction is not fixed by the scans.
    pub fn is_degenerate(&self) -> bool {
        !self.degenerate_directions.is_empty()
    }
}

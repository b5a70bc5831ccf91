use crate::{Error, Key};

/// How closely [`crate::Incremental`] follows the batch solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum IncrementalMode {
    /// One step an update; poses are linearised anew when their estimates have left their linearisation points
    /// by more than a threshold, and small changes are not followed far.
    #[default]
    Fluid,
    /// Each update iterates until every pose is at the optimum, as a batch solution from the same start would.
    Exact,
}

/// Parameters of [`crate::Incremental`].
#[derive(Debug, Clone, PartialEq)]
pub struct IncrementalParams {
    /// How closely to follow the batch solution. Default: fluid.
    pub mode: IncrementalMode,
    /// Largest component of a pose's step, in metres or radians, before the pose is linearised anew (fluid mode).
    /// Default 0.01.
    pub relinearize_threshold: f64,
    /// Change of a step, in metres or radians, that is not followed further down (fluid mode). Default 1e-4.
    pub wildfire_threshold: f64,
    /// Largest component of a step that counts as none, in metres or radians (exact mode). Default 1e-10.
    pub exact_tolerance: f64,
    /// Largest number of iterations of one update: of exact mode, or while kernels narrow. Default 50.
    pub max_iterations: usize,
    /// Graduation of robust kernels: a new factor's kernel is widened until it is nearly quadratic at the
    /// factor's residual, and narrowed by this factor an iteration. A right closure that closes a long loop with
    /// drift then pulls although its first residual is an outlier's; a wrong one loses in the end all the same.
    /// `None`: kernels are used as they are. Default: 2. No effect without robust kernels.
    ///
    /// **Source**: the idea of McGann, Rogers, Kaess, *Robust Incremental Smoothing and Mapping (riSAM)*, 2023;
    /// we widen the factor's own kernel instead of using one special family.
    pub graduation: Option<f64>,
}

impl Default for IncrementalParams {
    fn default() -> Self {
        Self {
            mode: IncrementalMode::default(),
            relinearize_threshold: 0.01,
            wildfire_threshold: 1e-4,
            exact_tolerance: 1e-10,
            max_iterations: 50,
            graduation: Some(2.0),
        }
    }
}

impl IncrementalParams {
    pub(super) fn check(&self) -> Result<(), Error> {
        let at_least = |name, value: f64, least: f64| {
            if value.is_finite() && value >= least { Ok(()) } else { Err(Error::Parameter { name, value }) }
        };
        at_least("relinearize_threshold", self.relinearize_threshold, 0.0)?;
        at_least("wildfire_threshold", self.wildfire_threshold, 0.0)?;
        at_least("exact_tolerance", self.exact_tolerance, f64::MIN_POSITIVE)?;
        at_least("max_iterations", self.max_iterations as f64, 1.0)?;
        self.graduation.map_or(Ok(()), |rate| at_least("graduation", rate, 1.01))
    }

    /// Thresholds of following a change and of linearising anew.
    pub(super) fn thresholds(&self) -> (f64, f64) {
        match self.mode {
            IncrementalMode::Fluid => (self.wildfire_threshold, self.relinearize_threshold),
            IncrementalMode::Exact => (0.0, self.exact_tolerance),
        }
    }
}

/// What an update did.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IncrementalUpdate {
    /// Factors taken in.
    pub new_factors: usize,
    /// Poses linearised anew, over all iterations.
    pub relinearised: usize,
    /// Poses eliminated anew, over all iterations.
    pub eliminated: usize,
    /// Factorisations.
    pub iterations: usize,
    /// Whether no pose is left to linearise anew.
    pub converged: bool,
    /// Poses whose estimates moved, ascending.
    pub touched: Vec<Key>,
}

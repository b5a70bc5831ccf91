use super::{GncLoss, GncParams};

/// Control parameter of the graduation, and the weights that follow from it.
pub(super) struct Schedule<'a> {
    params: &'a GncParams,
    /// Largest squared residual of an inlier.
    limit: f64,
    control: f64,
    /// Rounds so far.
    pub(super) count: usize,
}

/// Weights below this are zero, those above one less this are one.
const NEGLIGIBLE: f64 = 1e-4;
/// Weights of Geman-McClure, which never end, below which a measurement takes no part.
const FADED: f64 = 1e-8;
/// Control parameter after a consensus: what is more than a hundred times over the limit stays out.
const AFTER_CONSENSUS: f64 = 0.01;

impl<'a> Schedule<'a> {
    pub(super) fn new(params: &'a GncParams, limit: f64) -> Self {
        Self { params, limit, control: 1.0, count: 0 }
    }

    /// The control parameter at which the surrogate cost is convex up to the largest squared residual.
    pub(super) fn start_convex(&mut self, worst: f64) {
        self.control = match self.params.loss {
            GncLoss::TruncatedLeastSquares if worst <= self.limit => f64::INFINITY,
            GncLoss::TruncatedLeastSquares => self.limit / (2.0 * worst - self.limit),
            GncLoss::GemanMcClure => 2.0 * worst / self.limit,
        };
    }

    /// The control parameter for a start near the solution.
    pub(super) fn after_consensus(&mut self) {
        self.control = match self.params.loss {
            GncLoss::TruncatedLeastSquares => AFTER_CONSENSUS,
            GncLoss::GemanMcClure => 1.0 / AFTER_CONSENSUS,
        };
    }

    /// Sets the weights for squared residuals; `false` when all is decided.
    pub(super) fn reweigh(&mut self, chi2: impl Iterator<Item = f64>, weights: &mut [f64]) -> bool {
        let mut undecided = false;
        for (weight, chi2) in weights.iter_mut().zip(chi2) {
            *weight = self.weight(chi2);
            undecided |= (NEGLIGIBLE..1.0 - NEGLIGIBLE).contains(weight);
        }
        self.count += 1;
        match self.params.loss {
            GncLoss::TruncatedLeastSquares => {
                self.control *= self.params.control_step;
                undecided
            }
            GncLoss::GemanMcClure => {
                let more = self.control > 1.0;
                self.control = (self.control / self.params.control_step).max(1.0);
                more
            }
        }
    }

    fn weight(&self, chi2: f64) -> f64 {
        let (mu, limit) = (self.control, self.limit);
        match self.params.loss {
            GncLoss::TruncatedLeastSquares if mu.is_infinite() => f64::from(u8::from(chi2 <= limit)),
            GncLoss::TruncatedLeastSquares => {
                if chi2 >= (mu + 1.0) / mu * limit {
                    0.0
                } else if chi2 <= mu / (mu + 1.0) * limit {
                    1.0
                } else {
                    ((limit * mu * (mu + 1.0) / chi2).sqrt() - mu).clamp(0.0, 1.0)
                }
            }
            GncLoss::GemanMcClure => {
                let scaled = mu * limit;
                let weight = (scaled / (chi2 + scaled)).powi(2);
                if weight < FADED { 0.0 } else { weight }
            }
        }
    }

    /// Rounds what is still open: a measurement is in when its residual is an inlier's.
    pub(super) fn decide(&self, chi2: impl Iterator<Item = f64>, weights: &mut [f64]) {
        for (weight, chi2) in weights.iter_mut().zip(chi2) {
            let inside = match self.params.loss {
                GncLoss::TruncatedLeastSquares => *weight > 0.5,
                GncLoss::GemanMcClure => chi2 <= self.limit,
            };
            *weight = f64::from(u8::from(inside));
        }
    }

    /// Takes in what agrees with the optimum and throws out what does not; `false` when nothing changes.
    pub(super) fn recheck(&self, chi2: impl Iterator<Item = f64>, weights: &mut [f64]) -> bool {
        let mut changed = false;
        for (weight, chi2) in weights.iter_mut().zip(chi2) {
            let inside = f64::from(u8::from(chi2 <= self.limit));
            changed |= inside != *weight;
            *weight = inside;
        }
        changed
    }
}

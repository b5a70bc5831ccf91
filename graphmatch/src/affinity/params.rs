use crate::lanes::{self, LANES, Lanes};
use crate::{Error, Object};

/// What a difference `Δ` of two edge lengths is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// `exp(−μ |Δ|)`, the published form; below 10⁻¹² counted as 0.
    Laplacian {
        /// Decay, 1/m.
        mu: f64,
    },
    /// `exp(−Δ² / 2σ²)` within `gate · σ`, else 0.
    Gaussian {
        /// Standard deviation of the difference of two sightings of one edge, metres: √2 times that of a
        /// coordinate's difference.
        sigma: f64,
        /// Cut in standard deviations.
        gate: f64,
    },
    /// 1 within `gate · σ`, else 0.
    Cutoff {
        /// As for the Gaussian.
        sigma: f64,
        /// Cut in standard deviations.
        gate: f64,
    },
}

impl Kernel {
    /// Largest difference with a value above 0, metres.
    pub(super) fn reach(&self) -> f64 {
        match *self {
            Self::Laplacian { mu } => 12.0 * std::f64::consts::LN_10 / mu,
            Self::Gaussian { sigma, gate } | Self::Cutoff { sigma, gate } => sigma * gate,
        }
    }

    pub(super) fn value(&self, difference: f64) -> f64 {
        if difference.abs() > self.reach() {
            return 0.0;
        }
        match *self {
            Self::Laplacian { mu } => (-mu * difference.abs()).exp(),
            Self::Gaussian { sigma, .. } => (-0.5 * (difference / sigma).powi(2)).exp(),
            Self::Cutoff { .. } => 1.0,
        }
    }

    /// [`Kernel::value`] of differences side by side, to a few units in the last place.
    #[inline(always)]
    pub(super) fn values(&self, differences: &Lanes) -> Lanes {
        let reach = self.reach();
        let exponents = match *self {
            Self::Laplacian { mu } => differences.map(|d| -mu * d.abs()),
            // what a wide gate lets through beyond the range of the exponential weighs nothing either way
            Self::Gaussian { sigma, .. } => {
                differences.map(|d| (-0.5 * (d / sigma) * (d / sigma)).max(-700.0))
            }
            Self::Cutoff { .. } => [0.0; LANES],
        };
        let mut values = lanes::exp(&exponents);
        for lane in 0..LANES {
            values[lane] = if differences[lane].abs() > reach { 0.0 } else { values[lane] };
        }
        values
    }
}

/// How length and breadth of two objects enter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Attributes {
    /// Not at all.
    Ignore,
    /// Weight `exp(−μ (|ΔL| + |ΔB|))`, the published form.
    Laplacian {
        /// Decay, 1/m.
        mu: f64,
    },
    /// Weight `exp(−(ΔL² + ΔB²) / 4σ²)`, 0 where one difference exceeds `gate · σ`. Two such weights multiply in an
    /// entry, so a pair's likelihood enters whole.
    Gaussian {
        /// Standard deviation of a dimension's difference, metres.
        sigma: f64,
        /// Cut in standard deviations.
        gate: f64,
    },
    /// Weight 1 where both differences stay within `gate · σ`, else 0.
    Gate {
        /// Standard deviation of a dimension's difference, metres.
        sigma: f64,
        /// Cut in standard deviations.
        gate: f64,
    },
}

impl Attributes {
    pub(super) fn weight(&self, a: &Object, b: &Object) -> f64 {
        let (dl, db) = ((a.length - b.length).abs(), (a.breadth - b.breadth).abs());
        match *self {
            Self::Ignore => 1.0,
            Self::Laplacian { mu } => (-mu * (dl + db)).exp(),
            Self::Gaussian { sigma, gate } | Self::Gate { sigma, gate } if dl.max(db) > gate * sigma => 0.0,
            Self::Gaussian { sigma, .. } => (-0.25 * (dl * dl + db * db) / (sigma * sigma)).exp(),
            Self::Gate { .. } => 1.0,
        }
    }
}

/// Knobs of [`Affinity::new`](crate::Affinity::new).
#[derive(Debug, Clone, PartialEq)]
pub struct AffinityParams {
    /// Worth of a difference of edge lengths. Default Gaussian, σ = 0.2 √2 m, cut at 3 σ.
    pub kernel: Kernel,
    /// Role of length and breadth. Default ignored.
    pub attributes: Attributes,
    /// Edges shorter than this agree with none: their direction is noise. Default 0 m.
    pub min_edge: f64,
}

impl Default for AffinityParams {
    fn default() -> Self {
        Self {
            kernel: Kernel::Gaussian { sigma: 0.2 * std::f64::consts::SQRT_2, gate: 3.0 },
            attributes: Attributes::Ignore,
            min_edge: 0.0,
        }
    }
}

impl AffinityParams {
    pub(super) fn check(&self) -> Result<(), Error> {
        let mut values = Vec::new();
        match self.kernel {
            Kernel::Laplacian { mu } => values.push(("mu", mu)),
            Kernel::Gaussian { sigma, gate } | Kernel::Cutoff { sigma, gate } => {
                values.extend([("sigma", sigma), ("gate", gate)]);
            }
        }
        match self.attributes {
            Attributes::Ignore => {}
            Attributes::Laplacian { mu } => values.push(("mu", mu)),
            Attributes::Gaussian { sigma, gate } | Attributes::Gate { sigma, gate } => {
                values.extend([("sigma", sigma), ("gate", gate)]);
            }
        }
        for (name, value) in values {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::BadParameter { name, value, need: "finite and positive" });
            }
        }
        if !(self.min_edge.is_finite() && self.min_edge >= 0.0) {
            let value = self.min_edge;
            return Err(Error::BadParameter { name: "min_edge", value, need: "finite and not negative" });
        }
        Ok(())
    }
}

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
        if difference.abs() > self.reach() { 0.0 } else { self.exponents(&[difference])[0].exp() }
    }

    /// [`Kernel::value`] of differences side by side, to a few units in the last place.
    #[inline(always)]
    pub(super) fn values(&self, differences: &Lanes) -> Lanes {
        let reach = self.reach();
        let mut values = lanes::exp(&self.exponents(differences));
        for lane in 0..LANES {
            values[lane] = if differences[lane].abs() > reach { 0.0 } else { values[lane] };
        }
        values
    }

    /// Logarithms of the values of differences within reach.
    #[inline(always)]
    fn exponents<const N: usize>(&self, differences: &[f64; N]) -> [f64; N] {
        match *self {
            Self::Laplacian { mu } => differences.map(|d| -mu * d.abs()),
            // What a wide gate lets through beyond the range of the exponential weighs nothing either way.
            Self::Gaussian { sigma, .. } => {
                differences.map(|d| (-0.5 * (d / sigma) * (d / sigma)).max(-700.0))
            }
            Self::Cutoff { .. } => [0.0; N],
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_difference_is_worth_what_it_is_worth_beside_others() {
        let kernels = [
            Kernel::Laplacian { mu: 8.0 },
            Kernel::Gaussian { sigma: 0.3, gate: 3.0 },
            Kernel::Cutoff { sigma: 0.3, gate: 3.0 },
        ];
        let differences = [0.0, -0.1, 0.29, -0.5, 0.899, -0.901, 3.0, 4.0];
        for kernel in kernels {
            for (value, d) in kernel.values(&differences).into_iter().zip(differences) {
                assert!((value - kernel.value(d)).abs() <= 1e-15 + 1e-14 * value, "{kernel:?} {d}");
            }
        }
        assert!((kernels[0].value(-0.5) - (-4.0_f64).exp()).abs() < 1e-15);
        assert!((kernels[1].value(0.6) - (-2.0_f64).exp()).abs() < 1e-15);
        assert_eq!([kernels[2].value(0.89), kernels[2].value(0.91)], [1.0, 0.0]);
    }
}

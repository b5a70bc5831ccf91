/// Robust kernel of one factor: how its cost grows with the whitened residual norm `r`.
///
/// The cost of a factor is `½ ρ(r²)`; `k` is the residual norm, in standard deviations, at which the kernel
/// starts to distrust the measurement. Every kernel behaves as `r²` near zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Kernel {
    /// Plain least squares, `ρ = r²`.
    #[default]
    None,
    /// `ρ = r²` up to `k`, then `2 k r - k²`.
    Huber(f64),
    /// `ρ = k² ln(1 + r²/k²)`.
    Cauchy(f64),
    /// `ρ = k²/3 (1 - (1 - r²/k²)³)` up to `k`, then constant.
    Tukey(f64),
    /// `ρ = r² k² / (k² + r²)`.
    GemanMcClure(f64),
    /// `ρ = k² (1 - exp(-r²/k²))`.
    Welsch(f64),
    /// Dynamic covariance scaling with parameter `Φ`: `ρ = r²` while `r² ≤ Φ`, then
    /// `4 Φ r² / (Φ + r²) - Φ`, whose weight is `s²` with the published scale `s = 2Φ / (Φ + r²)`.
    ///
    /// **Source**: Agarwal, Tipaldi, Spinello, Stachniss, Burgard, *Robust Map Optimization using Dynamic
    /// Covariance Scaling*, 2013, equation 15.
    Dcs(f64),
}

/// Value and derivative of a kernel at one squared residual norm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighed {
    /// `ρ(r²)`, twice the cost.
    pub rho: f64,
    /// `dρ/d(r²)`, the weight of the factor in iteratively reweighted least squares.
    pub weight: f64,
}

impl Kernel {
    /// `ρ` and its derivative at the squared whitened norm `chi2`.
    pub fn weigh(self, chi2: f64) -> Weighed {
        let (rho, weight) = match self {
            Kernel::None => (chi2, 1.0),
            Kernel::Huber(k) if chi2 <= k * k => (chi2, 1.0),
            Kernel::Huber(k) => {
                let r = chi2.sqrt();
                (2.0 * k * r - k * k, k / r)
            }
            Kernel::Cauchy(k) => {
                let q = chi2 / (k * k);
                (k * k * q.ln_1p(), 1.0 / (1.0 + q))
            }
            Kernel::Tukey(k) if chi2 <= k * k => {
                let u = 1.0 - chi2 / (k * k);
                (k * k / 3.0 * (1.0 - u * u * u), u * u)
            }
            Kernel::Tukey(k) => (k * k / 3.0, 0.0),
            Kernel::GemanMcClure(k) => {
                let s = k * k / (k * k + chi2);
                (chi2 * s, s * s)
            }
            Kernel::Welsch(k) => {
                let e = (-chi2 / (k * k)).exp();
                (k * k * (1.0 - e), e)
            }
            Kernel::Dcs(phi) if chi2 <= phi => (chi2, 1.0),
            Kernel::Dcs(phi) => {
                let s = 2.0 * phi / (phi + chi2);
                (2.0 * s * chi2 - phi, s * s)
            }
        };
        Weighed { rho, weight }
    }

    /// The same kernel with its region of trust stretched by `factor` in residual norm.
    pub fn widened(self, factor: f64) -> Self {
        match self {
            Kernel::None => Kernel::None,
            Kernel::Huber(k) => Kernel::Huber(k * factor),
            Kernel::Cauchy(k) => Kernel::Cauchy(k * factor),
            Kernel::Tukey(k) => Kernel::Tukey(k * factor),
            Kernel::GemanMcClure(k) => Kernel::GemanMcClure(k * factor),
            Kernel::Welsch(k) => Kernel::Welsch(k * factor),
            Kernel::Dcs(phi) => Kernel::Dcs(phi * factor * factor),
        }
    }

    /// Whether the parameter is a positive finite number.
    pub fn is_valid(self) -> bool {
        match self {
            Kernel::None => true,
            Kernel::Huber(k)
            | Kernel::Cauchy(k)
            | Kernel::Tukey(k)
            | Kernel::GemanMcClure(k)
            | Kernel::Welsch(k)
            | Kernel::Dcs(k) => k.is_finite() && k > 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNELS: [Kernel; 7] = [
        Kernel::None,
        Kernel::Huber(1.3),
        Kernel::Cauchy(0.9),
        Kernel::Tukey(4.0),
        Kernel::GemanMcClure(1.1),
        Kernel::Welsch(2.0),
        Kernel::Dcs(1.7),
    ];

    #[test]
    fn weights_are_the_derivative_of_the_cost() {
        for kernel in KERNELS {
            for chi2 in [1e-3, 0.3, 1.0, 1.6, 1.8, 5.0, 15.9, 16.1, 100.0] {
                let h = 1e-6 * chi2;
                let slope = (kernel.weigh(chi2 + h).rho - kernel.weigh(chi2 - h).rho) / (2.0 * h);
                assert!((slope - kernel.weigh(chi2).weight).abs() < 1e-6, "{kernel:?} at {chi2}");
            }
        }
    }

    #[test]
    fn a_widened_kernel_is_the_kernel_of_a_smaller_residual() {
        for kernel in KERNELS {
            for chi2 in [0.1, 1.5, 7.0, 40.0] {
                let (wide, plain) = (kernel.widened(3.0).weigh(9.0 * chi2), kernel.weigh(chi2));
                assert!((wide.weight - plain.weight).abs() < 1e-14, "{kernel:?} at {chi2}");
                assert!((wide.rho - 9.0 * plain.rho).abs() < 1e-12 * wide.rho, "{kernel:?} at {chi2}");
            }
        }
    }

    #[test]
    fn dcs_weight_is_the_square_of_the_published_scale() {
        let (phi, chi2) = (1.7, 6.0);
        let scale: f64 = 2.0 * phi / (phi + chi2);
        assert!((Kernel::Dcs(phi).weigh(chi2).weight - scale * scale).abs() < 1e-15);
        assert!((Kernel::Dcs(phi).weigh(phi).rho - phi).abs() < 1e-15);
    }
}

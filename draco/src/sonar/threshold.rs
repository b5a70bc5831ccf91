use crate::Error;

/// How the noise around a cell is estimated from the training cells before and behind it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CfarKind {
    /// Cell averaging: the mean of both sides.
    Ca,
    /// Smallest of the two sides' means: keeps weak echoes beside strong ones.
    Soca,
    /// Greatest of the two sides' means: few false alarms at edges.
    Goca,
    /// Order statistic: the cell of this rank among both sides, counting from 1 for the weakest.
    Os {
        /// The rank.
        rank: usize,
    },
}

/// Iterations of bisection: halves the bracket down to the last bit.
const BISECTIONS: usize = 200;

/// The factor τ on the noise estimate that lets a share `false_alarm` of cells of exponential noise through, with
/// `training` cells on both sides together.
///
/// ```text
/// n = training / 2
/// core = (2 + τ/n)⁻ⁿ · Σ_{k<n} C(n+k-1, k) (2 + τ/n)⁻ᵏ
/// CA    τ = N (Pfa^(-1/N) - 1)
/// SOCA  core = Pfa / 2
/// GOCA  (1 + τ/n)⁻ⁿ - core = Pfa / 2
/// OS    Π_{i<rank} (N - i) / (N - i + τ) = Pfa
/// ```
///
/// # Errors
/// [`Error::Parameter`] unless 0 < `false_alarm` < 1, `training` is even and at least 2, and a rank is among the
/// training cells.
///
/// **Source**: Gandhi and Kassam, *Analysis of CFAR processors in nonhomogeneous background*, IEEE TAES 24(4), 1988.
///
/// ```
/// use draco::sonar::{CfarKind, threshold_factor};
///
/// let tau = threshold_factor(CfarKind::Soca, 40, 0.1)?;
/// assert!((tau - 2.7491).abs() < 1e-3);
/// # Ok::<(), draco::Error>(())
/// ```
pub fn threshold_factor(kind: CfarKind, training: usize, false_alarm: f64) -> Result<f64, Error> {
    if !(false_alarm > 0.0 && false_alarm < 1.0) {
        return Err(Error::Parameter {
            name: "false_alarm",
            value: false_alarm,
            reason: "must be between 0 and 1",
        });
    }
    if training < 2 || training % 2 == 1 {
        let value = training as f64;
        return Err(Error::Parameter { name: "training", value, reason: "must be even and at least 2" });
    }
    if let CfarKind::Os { rank } = kind
        && !(1..=training).contains(&rank)
    {
        let reason = "must be from 1 to the number of training cells";
        return Err(Error::Parameter { name: "rank", value: rank as f64, reason });
    }
    let cells = training as f64;
    let alarm = |tau: f64| match kind {
        CfarKind::Ca => (1.0 + tau / cells).powf(-cells),
        CfarKind::Soca => 2.0 * smallest_of(training / 2, tau),
        CfarKind::Goca => {
            let half = 0.5 * cells;
            2.0 * ((1.0 + tau / half).powf(-half) - smallest_of(training / 2, tau))
        }
        CfarKind::Os { rank } => {
            (0..rank).map(|index| cells - index as f64).map(|left| left / (left + tau)).product()
        }
    };
    Ok(bisect(alarm, false_alarm))
}

/// `core` of the formulas; the binomial coefficient grows term by term, which stays finite for any `n`.
fn smallest_of(n: usize, tau: f64) -> f64 {
    let base = 2.0 + tau / n as f64;
    let mut term = 1.0;
    let mut sum = 0.0;
    for k in 0..n {
        sum += term;
        term *= (n + k) as f64 / ((k + 1) as f64 * base);
    }
    // In logarithms, because base^-n alone may underflow.
    (sum.ln() - n as f64 * base.ln()).exp()
}

/// Where the falling function `alarm` takes the value `wanted`.
fn bisect(alarm: impl Fn(f64) -> f64, wanted: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while alarm(high) > wanted && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if alarm(middle) > wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values computed for the published system with another program, to four decimals.
    #[test]
    fn factors_are_those_computed_elsewhere() {
        let table = [
            (CfarKind::Ca, 0.1, 2.3701),
            (CfarKind::Soca, 0.1, 2.7491),
            (CfarKind::Goca, 0.1, 2.1219),
            (CfarKind::Ca, 0.01, 4.8807),
            (CfarKind::Soca, 0.01, 5.7550),
            (CfarKind::Goca, 0.01, 4.3977),
        ];
        for (kind, false_alarm, expected) in table {
            let tau = threshold_factor(kind, 40, false_alarm).expect("valid");
            assert!((tau - expected).abs() < 1e-3, "{kind:?} at {false_alarm}: {tau} against {expected}");
        }
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        for (kind, training, false_alarm) in [
            (CfarKind::Ca, 40, 0.0),
            (CfarKind::Ca, 40, f64::NAN),
            (CfarKind::Soca, 0, 0.1),
            (CfarKind::Goca, 7, 0.1),
            (CfarKind::Os { rank: 0 }, 8, 0.1),
            (CfarKind::Os { rank: 9 }, 8, 0.1),
        ] {
            assert!(
                threshold_factor(kind, training, false_alarm).is_err(),
                "{kind:?} {training} {false_alarm}"
            );
        }
    }
}

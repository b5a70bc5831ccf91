use super::sinkhorn::sinkhorn;
use crate::{Affinity, Error};

/// Knobs of [`graduated_assignment`].
#[derive(Debug, Clone, PartialEq)]
pub struct GraduatedParams {
    /// Sharpness at first, in units of 1 over the largest gradient. Default 1.
    pub beta_start: f64,
    /// Factor of the sharpness from level to level, above 1. Default 1.15.
    pub beta_rate: f64,
    /// Sharpness at which to stop, at most 300. Default 100.
    pub beta_end: f64,
    /// Gradient steps at each level. Default 4.
    pub steps: usize,
}

impl Default for GraduatedParams {
    fn default() -> Self {
        Self { beta_start: 1.0, beta_rate: 1.15, beta_end: 100.0, steps: 4 }
    }
}

/// Scores of all pairs by softened assignments that grow sharper.
///
/// # Errors
/// A parameter out of range.
///
/// **Source**: Gold, Rangarajan, "A graduated assignment algorithm for graph matching", 1996. The gradient is scaled to
/// a largest entry of 1 in each step, so sharpness needs no tuning to the affinity; no slack row.
pub fn graduated_assignment(affinity: &Affinity, params: &GraduatedParams) -> Result<Vec<f64>, Error> {
    let ranges = [
        ("beta_start", params.beta_start, 1e-9, 300.0),
        ("beta_rate", params.beta_rate, 1.0 + 1e-6, 1e6),
        ("beta_end", params.beta_end, 1e-9, 300.0),
    ];
    for (name, value, low, high) in ranges {
        if !(low..=high).contains(&value) {
            return Err(Error::BadParameter { name, value, need: "positive, at most 300; a rate above 1" });
        }
    }
    let (rows, columns) = (affinity.rows(), affinity.columns());
    let mut x = vec![1.0 / rows.max(columns).max(1) as f64; rows * columns];
    let mut gradient = vec![0.0; x.len()];
    let mut beta = params.beta_start;
    while beta <= params.beta_end {
        for _ in 0..params.steps {
            affinity.apply(&x, &mut gradient);
            let largest = gradient.iter().copied().fold(0.0, f64::max);
            if largest == 0.0 {
                return Ok(vec![0.0; x.len()]);
            }
            for (x, g) in x.iter_mut().zip(&gradient) {
                *x = (beta * (g / largest - 1.0)).exp();
            }
            sinkhorn(&mut x, rows, columns, 30);
        }
        beta *= params.beta_rate;
    }
    Ok(x)
}

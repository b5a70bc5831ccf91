/// Robust kernel: how the weight of a pair falls with its residual.
///
/// `scale` is the residual (metres) at which the weight has clearly fallen; below it pairs count almost fully.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Kernel {
    /// Least squares: weight 1.
    #[default]
    None,
    /// `min(1, s/|r|)`.
    Huber {
        /// `s`, metres.
        scale: f64,
    },
    /// `1 / (1 + (r/s)²)`.
    Cauchy {
        /// `s`, metres.
        scale: f64,
    },
    /// `(1 - (r/s)²)²` inside `s`, 0 outside.
    Tukey {
        /// `s`, metres.
        scale: f64,
    },
    /// `1 / (1 + (r/s)²)²`.
    GemanMcClure {
        /// `s`, metres.
        scale: f64,
    },
    /// `exp(-(r/s)²)`.
    Welsch {
        /// `s`, metres.
        scale: f64,
    },
}

impl Kernel {
    /// Weight of a pair with this squared residual.
    #[inline]
    pub fn weight(&self, residual_sq: f64) -> f64 {
        match *self {
            Kernel::None => 1.0,
            Kernel::Huber { scale } => {
                if residual_sq <= scale * scale {
                    1.0
                } else {
                    scale / residual_sq.sqrt()
                }
            }
            Kernel::Cauchy { scale } => 1.0 / (1.0 + residual_sq / (scale * scale)),
            Kernel::Tukey { scale } => {
                let inside = (1.0 - residual_sq / (scale * scale)).max(0.0);
                inside * inside
            }
            Kernel::GemanMcClure { scale } => {
                let w = 1.0 / (1.0 + residual_sq / (scale * scale));
                w * w
            }
            Kernel::Welsch { scale } => (-residual_sq / (scale * scale)).exp(),
        }
    }

    /// Derivative of the influence `w(r²) r` of a residual with respect to one of its `dimensions` coordinates,
    /// averaged over their directions.
    ///
    /// * `w` – its weight.
    #[inline]
    pub(crate) fn slope(&self, residual_sq: f64, w: f64, dimensions: usize) -> f64 {
        if *self == Kernel::None {
            return w;
        }
        let step = 1e-6 * residual_sq.max(1e-12);
        let dw = (self.weight(residual_sq + step) - w) / step;
        w + 2.0 * residual_sq * dw / dimensions as f64
    }

    /// The same kernel with its scale times `factor`.
    pub fn widened(&self, factor: f64) -> Self {
        let mut wider = *self;
        match &mut wider {
            Kernel::None => {}
            Kernel::Huber { scale }
            | Kernel::Cauchy { scale }
            | Kernel::Tukey { scale }
            | Kernel::GemanMcClure { scale }
            | Kernel::Welsch { scale } => *scale *= factor,
        }
        wider
    }

    /// Its scale, metres; `None` for least squares.
    pub fn scale(&self) -> Option<f64> {
        match *self {
            Kernel::None => None,
            Kernel::Huber { scale }
            | Kernel::Cauchy { scale }
            | Kernel::Tukey { scale }
            | Kernel::GemanMcClure { scale }
            | Kernel::Welsch { scale } => Some(scale),
        }
    }
}

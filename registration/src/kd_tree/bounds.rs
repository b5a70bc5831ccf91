use nalgebra::SVector;

#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds<const D: usize> {
    pub(super) low: SVector<f64, D>,
    pub(super) high: SVector<f64, D>,
}

impl<const D: usize> Bounds<D> {
    pub(super) fn everywhere() -> Self {
        Self { low: SVector::repeat(f64::NEG_INFINITY), high: SVector::repeat(f64::INFINITY) }
    }

    /// The square is summed in the order in which the distance of a point is, and each part of it is rounded from
    /// less: it never exceeds the distance of a point inside, so ties are kept.
    #[inline(always)]
    pub(super) fn distance_sq(&self, query: &SVector<f64, D>) -> f64 {
        let mut sum = 0.0;
        for axis in 0..D {
            let below = self.low[axis] - query[axis];
            let above = query[axis] - self.high[axis];
            let out = if below > above { below } else { above };
            let out = if out > 0.0 { out } else { 0.0 };
            sum += out * out;
        }
        sum
    }

    /// Whether every point outside is farther from the query than the root of `limit_sq`.
    #[inline(always)]
    pub(super) fn encloses(&self, query: &SVector<f64, D>, limit_sq: f64) -> bool {
        let mut margin = f64::INFINITY;
        for axis in 0..D {
            let (left, right) = (query[axis] - self.low[axis], self.high[axis] - query[axis]);
            let least = if left < right { left } else { right };
            margin = if least < margin { least } else { margin };
        }
        margin > 0.0 && margin * margin > limit_sq
    }
}

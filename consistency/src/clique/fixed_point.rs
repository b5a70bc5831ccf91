/// Weights as integers, so that bounds are exact and do not depend on the order of summation.
///
/// The scale is a power of two with the sum below 2^52: weights that are multiples of a common power of two (all
/// integers, say) and do not span more than 52 bits are represented exactly, others are rounded to a relative
/// error of the total of at most `n · 2^-51`.
#[derive(Debug)]
pub(super) struct FixedPoint {
    exponent: i32,
}

const TOTAL_BITS: i32 = 52;

impl FixedPoint {
    pub(super) fn for_weights(weights: impl Iterator<Item = f64>) -> Self {
        let (largest, count) = weights.fold((0.0f64, 0usize), |(m, n), w| (m.max(w), n + 1));
        let bits = |x: f64| if x > 0.0 { x.log2().floor() as i32 + 1 } else { 0 };
        Self { exponent: (TOTAL_BITS - bits(largest) - bits(count as f64)).clamp(-1000, 1000) }
    }

    pub(super) fn to_integer(&self, weight: f64) -> u64 {
        (weight * 2f64.powi(self.exponent)).round() as u64
    }

    pub(super) fn to_weight(&self, integer: u64) -> f64 {
        integer as f64 * 2f64.powi(-self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_and_halves_are_exact() {
        let weights = [200.0, 1.0, 0.5, 0.0, 123.25];
        let scale = FixedPoint::for_weights(weights.iter().copied());
        for w in weights {
            assert_eq!(scale.to_weight(scale.to_integer(w)), w);
        }
    }

    #[test]
    fn extremes_do_not_overflow() {
        for w in [f64::MAX, f64::MIN_POSITIVE, 5e-324, 0.0] {
            let scale = FixedPoint::for_weights(std::iter::repeat_n(w, 1000));
            assert!(scale.to_integer(w) <= 1 << 43, "{w}");
        }
    }
}

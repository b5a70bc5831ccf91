//! Loops over numbers side by side, so that they compile to the vectors of the machine where they are inlined under a
//! dispatch. The order of the sums is the same on every machine.

const LANES: usize = 8;

/// Sum of `value` of all numbers.
#[inline(always)]
pub(super) fn sum(x: &[f64], value: impl Fn(f64) -> f64) -> f64 {
    let chunks = x.chunks_exact(LANES);
    let tail: f64 = chunks.remainder().iter().map(|x| value(*x)).sum();
    let mut sums = [0.0; LANES];
    for chunk in chunks {
        sums.iter_mut().zip(chunk).for_each(|(sum, x)| *sum += value(*x));
    }
    tail + total(sums)
}

/// Replaces each `x` by the first of what `next` gives for it and its partners `y` and `z`, and sums the two others.
#[inline(always)]
pub(super) fn replace(
    x: &mut [f64],
    y: &[f64],
    z: &[f64],
    next: impl Fn(f64, f64, f64) -> [f64; 3],
) -> [f64; 2] {
    let ((xs, x_tail), (ys, y_tail), (zs, z_tail)) =
        (x.as_chunks_mut::<LANES>(), y.as_chunks::<LANES>(), z.as_chunks::<LANES>());
    let mut sums = [[0.0; LANES]; 2];
    for ((x, y), z) in xs.iter_mut().zip(ys).zip(zs) {
        // All read before anything is written, so that lanes stay together.
        let mut out = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            [out[0][lane], out[1][lane], out[2][lane]] = next(x[lane], y[lane], z[lane]);
        }
        *x = out[0];
        for lane in 0..LANES {
            sums[0][lane] += out[1][lane];
            sums[1][lane] += out[2][lane];
        }
    }
    for (lane, ((x, y), z)) in x_tail.iter_mut().zip(y_tail).zip(z_tail).enumerate() {
        let [new, a, b] = next(*x, *y, *z);
        *x = new;
        sums[0][lane] += a;
        sums[1][lane] += b;
    }
    sums.map(total)
}

/// Sum of the products of two rows of equal length.
#[inline(always)]
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (xs, ys) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let tail: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(x, y)| x * y).sum();
    let mut sums = [0.0; LANES];
    for (x, y) in xs.zip(ys) {
        sums.iter_mut().zip(x.iter().zip(y)).for_each(|(sum, (x, y))| *sum += x * y);
    }
    tail + total(sums)
}

/// Sum of the lanes in pairs, of which none waits long for another.
#[inline(always)]
fn total([a, b, c, d, e, f, g, h]: [f64; LANES]) -> f64 {
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// Largest number, at least 0.
#[inline(always)]
pub(super) fn largest(x: &[f64]) -> f64 {
    let chunks = x.chunks_exact(LANES);
    let tail = chunks.remainder().iter().copied().fold(0.0, f64::max);
    let mut most = [0.0; LANES];
    for chunk in chunks {
        most.iter_mut().zip(chunk).for_each(|(most, x)| *most = if x > most { *x } else { *most });
    }
    most.into_iter().fold(tail, f64::max)
}

/// 1/n! for n from 0 to 13; what follows is below rounding for |r| ≤ ln 2 / 2.
const SERIES: [f64; 14] = {
    let mut series = [1.0; 14];
    let mut n = 1;
    while n < 14 {
        series[n] = series[n - 1] / n as f64;
        n += 1;
    }
    series
};

/// `eˣ` of a number from −700 to 0 (or a rounding above), to a few units in the last place, without branches.
///
/// `x = k ln 2 + r` with a whole `k`; `eʳ` by its series, `2ᵏ` by its bits.
#[inline(always)]
pub(super) fn exp(x: f64) -> f64 {
    /// Adding this leaves a number rounded to a whole one, in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    // ln 2 in two parts, the first short enough that its product with k is exact.
    const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = x - k * LN_2[0] - k * LN_2[1];
    let series = SERIES.iter().rev().fold(0.0_f64, |sum, c| sum.mul_add(r, *c));
    series * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_that_of_the_standard_library() {
        for k in 0..70_000 {
            let x = -0.01 * f64::from(k);
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-15 * 4.0, "{x}: {} and {}", exp(x), x.exp());
        }
        assert_eq!(exp(0.0), 1.0);
    }

    #[test]
    fn sums_and_largest_take_the_tail_in() {
        let x: Vec<f64> = (0..19).map(f64::from).collect();
        assert_eq!(sum(&x, |x| 2.0 * x), 342.0);
        assert_eq!(dot(&x, &x), 2109.0);
        assert_eq!(largest(&x), 18.0);
        assert_eq!(largest(&x[..3]), 2.0);
    }
}

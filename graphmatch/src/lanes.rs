//! Loops over numbers side by side, so that they compile to the vectors of the machine where they are inlined under a
//! dispatch. The order of the sums is the same on every machine.

pub(crate) const LANES: usize = 8;

/// Numbers side by side. Loops over such arrays become whole vectors, those over slices sometimes not.
pub(crate) type Lanes = [f64; LANES];

/// Calls `visit` with eight numbers of each of three rows at a time, which it may replace in the first; lengths are
/// multiples of eight. (A second call for what is left over would keep `visit` from being inlined.)
#[inline(always)]
pub(crate) fn replace(
    x: &mut [f64],
    y: &[f64],
    z: &[f64],
    mut visit: impl FnMut(&mut Lanes, &Lanes, &Lanes),
) {
    debug_assert!([x.len(), y.len(), z.len()].iter().all(|n| n % LANES == 0));
    let (xs, ys, zs) = (x.as_chunks_mut().0, y.as_chunks().0, z.as_chunks().0);
    for ((x, y), z) in xs.iter_mut().zip(ys).zip(zs) {
        visit(x, y, z);
    }
}

/// Sum of all numbers; a multiple of eight.
#[inline(always)]
pub(crate) fn sum(x: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    for chunk in x.as_chunks::<LANES>().0 {
        for lane in 0..LANES {
            sums[lane] += chunk[lane];
        }
    }
    total(&sums)
}

/// Sum of the lanes in pairs. Not inlined: the loop before would be compiled for these pairs, not for whole vectors.
#[inline(never)]
pub(crate) fn total([a, b, c, d, e, f, g, h]: &Lanes) -> f64 {
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// Scalar product.
#[inline(always)]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, x), (ys, y)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for lane in 0..LANES {
            sums[lane] += x[lane] * y[lane];
        }
    }
    total(&sums) + x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>()
}

/// Largest number, at least 0; a multiple of eight.
#[inline(always)]
pub(crate) fn largest(x: &[f64]) -> f64 {
    let mut most = [0.0; LANES];
    for chunk in x.as_chunks::<LANES>().0 {
        for lane in 0..LANES {
            most[lane] = if chunk[lane] > most[lane] { chunk[lane] } else { most[lane] };
        }
    }
    most.into_iter().fold(0.0, f64::max)
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

/// `eˣ` of numbers from −700 to 0 (or a rounding above), to a few units in the last place, without branches.
///
/// `x = k ln 2 + r` with a whole `k`; `eʳ` by its series, `2ᵏ` by its bits.
#[inline(always)]
pub(crate) fn exp(x: &Lanes) -> Lanes {
    /// Adding this leaves a number rounded to a whole one, in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    // ln 2 in two parts, the first short enough that its product with k is exact.
    const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
    let (mut shifted, mut r, mut series) = ([0.0; LANES], [0.0; LANES], [0.0_f64; LANES]);
    for lane in 0..LANES {
        shifted[lane] = x[lane] * std::f64::consts::LOG2_E + ROUND;
        let k = shifted[lane] - ROUND;
        r[lane] = x[lane] - k * LN_2[0] - k * LN_2[1];
    }
    for c in SERIES.iter().rev() {
        for lane in 0..LANES {
            series[lane] = series[lane].mul_add(r[lane], *c);
        }
    }
    for lane in 0..LANES {
        series[lane] *= f64::from_bits(shifted[lane].to_bits().wrapping_add(1023) << 52);
    }
    series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_that_of_the_standard_library() {
        for k in 0..70_000 {
            let x = -0.01 * f64::from(k);
            let [found, ..] = exp(&[x; LANES]);
            assert!((found / x.exp() - 1.0).abs() < 1e-15 * 4.0, "{x}: {found} and {}", x.exp());
        }
        assert_eq!(exp(&[0.0; LANES]), [1.0; LANES]);
    }

    #[test]
    fn sums_and_largest_take_all_in() {
        let x: Vec<f64> = (0..24).map(f64::from).collect();
        assert_eq!(sum(&x), 276.0);
        assert_eq!(largest(&x), 23.0);
        assert_eq!(dot(&x[..19], &x[1..20]), (0..19).map(|k| f64::from(k * (k + 1))).sum::<f64>());
        let mut doubled = x.clone();
        replace(&mut doubled, &x, &x, |sum, x, _| sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += x));
        assert!(doubled.iter().zip(&x).all(|(d, x)| *d == 2.0 * x));
    }
}

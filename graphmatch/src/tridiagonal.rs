/// Largest eigenvalue of a symmetric tridiagonal matrix, and its eigenvector, of norm 1.
///
/// * `diagonal` – at least one entry, finite; `off` – one entry fewer.
///
/// Bisection by Sturm counts, then inverse iteration: unlike a QR sweep neither can settle on another eigenvalue,
/// however differently the entries are scaled. Cost O(60 n).
///
/// **Source**: Golub, Van Loan, "Matrix Computations", §8.4.1 and §8.2.2.
pub(crate) fn largest_eigenpair(diagonal: &[f64], off: &[f64]) -> (f64, Vec<f64>) {
    let value = largest_eigenvalue(diagonal, off);
    (value, eigenvector(diagonal, off, value))
}

fn largest_eigenvalue(diagonal: &[f64], off: &[f64]) -> f64 {
    let n = diagonal.len();
    let reach = |k: usize| {
        let left = if k > 0 { off[k - 1].abs() } else { 0.0 };
        left + off.get(k).map_or(0.0, |e| e.abs())
    };
    // The largest diagonal entry is a Rayleigh quotient, the largest Gershgorin disk an upper bound.
    let mut low = diagonal.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut high = (0..n).map(|k| diagonal[k] + reach(k)).fold(f64::NEG_INFINITY, f64::max);
    let scale = low.abs().max(high.abs());
    while high - low > 2.0 * f64::EPSILON * scale {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if is_above_all(diagonal, off, middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Whether `x` exceeds every eigenvalue: all pivots of `T − x` are negative.
fn is_above_all(diagonal: &[f64], off: &[f64], x: f64) -> bool {
    let mut pivot = diagonal[0] - x;
    for (d, e) in diagonal[1..].iter().zip(off) {
        if pivot >= 0.0 {
            return false;
        }
        pivot = d - x - e * e / pivot;
    }
    pivot < 0.0
}

/// Two steps of inverse iteration at `value`, by elimination with row exchanges.
fn eigenvector(diagonal: &[f64], off: &[f64], value: f64) -> Vec<f64> {
    let n = diagonal.len();
    let scale = diagonal.iter().chain(off).fold(value.abs(), |m, x| m.max(x.abs()));
    let tiny = (f64::EPSILON * scale).max(f64::MIN_POSITIVE);
    // Rows of the upper triangle: pivot and the two entries right of it; multiplier and exchange of each step.
    let mut upper: Vec<[f64; 3]> = Vec::with_capacity(n);
    let mut steps: Vec<(f64, bool)> = Vec::with_capacity(n);
    let mut row = [diagonal[0] - value, off.first().copied().unwrap_or(0.0), 0.0];
    for k in 1..n {
        let mut below = [off[k - 1], diagonal[k] - value, off.get(k).copied().unwrap_or(0.0)];
        let exchange = below[0].abs() > row[0].abs();
        if exchange {
            std::mem::swap(&mut row, &mut below);
        }
        let factor = if row[0] == 0.0 { 0.0 } else { below[0] / row[0] };
        upper.push(row);
        steps.push((factor, exchange));
        row = [below[1] - factor * row[1], below[2] - factor * row[2], 0.0];
    }
    upper.push(row);
    let mut x = vec![1.0; n];
    for _ in 0..3 {
        for (k, &(factor, exchange)) in steps.iter().enumerate() {
            if exchange {
                x.swap(k, k + 1);
            }
            x[k + 1] -= factor * x[k];
        }
        for k in (0..n).rev() {
            let [pivot, one, two] = upper[k];
            let sum = x[k]
                - one * x.get(k + 1).copied().unwrap_or(0.0)
                - two * x.get(k + 2).copied().unwrap_or(0.0);
            let pivot = if pivot.abs() < tiny { tiny.copysign(pivot) } else { pivot };
            x[k] = sum / pivot;
        }
        // By the largest entry first: squares of entries near 1/tiny overflow.
        let largest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        x.iter_mut().for_each(|v| *v /= largest);
        let norm = x.iter().map(|v| v * v).sum::<f64>().sqrt();
        x.iter_mut().for_each(|v| *v /= norm);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residual(diagonal: &[f64], off: &[f64]) -> f64 {
        let (value, x) = largest_eigenpair(diagonal, off);
        let n = x.len();
        (0..n)
            .map(|k| {
                let left = if k > 0 { off[k - 1] * x[k - 1] } else { 0.0 };
                let right = if k + 1 < n { off[k] * x[k + 1] } else { 0.0 };
                (diagonal[k] * x[k] + left + right - value * x[k]).abs()
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn second_difference_matrix_has_its_known_eigenvalue() {
        let n = 12;
        let (diagonal, off) = (vec![2.0; n], vec![-1.0; n - 1]);
        let (value, x) = largest_eigenpair(&diagonal, &off);
        let expected = 2.0 + 2.0 * (std::f64::consts::PI / (n as f64 + 1.0)).cos();
        assert!((value - expected).abs() < 1e-14);
        assert!(residual(&diagonal, &off) < 1e-14);
        assert!((x.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn blocks_of_different_scale_and_splits_are_solved() {
        for (diagonal, off) in [
            (vec![3.0], vec![]),
            (vec![0.0, 0.0], vec![0.0]),
            (vec![1.0, 1.0, 1.0], vec![0.0, 0.0]),
            (vec![1e-9, 2e-9, 1e-3, 5.0], vec![1e-9, 1e-12, 1e-3]),
            (vec![5.0, 1e-3, 5.0], vec![1e-160, 1e-160]),
            (vec![0.0, 0.0, 0.0], vec![1.0, 1e-9]),
        ] {
            let largest = diagonal.iter().chain(&off).fold(0.0_f64, |m, x: &f64| m.max(x.abs()));
            assert!(residual(&diagonal, &off) <= 1e-12 * largest, "{diagonal:?} {off:?}");
        }
    }
}

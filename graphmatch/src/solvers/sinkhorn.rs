use super::lanes;

/// Scales a positive matrix so that rows and columns sum to 1 in turn, `iterations` half steps, rows (of the side with
/// fewer members) first. On plain numbers: entries must stay within e^±300 of each other.
#[inline(always)]
pub(super) fn sinkhorn(x: &mut [f64], rows: usize, columns: usize, iterations: usize) {
    if x.is_empty() {
        return;
    }
    let rows_first = rows <= columns;
    let mut sums = vec![0.0; columns];
    for step in 0..iterations {
        if (step % 2 == 0) == rows_first {
            for row in x.chunks_exact_mut(columns) {
                let factor = factor(lanes::sum(row, |x| x));
                row.iter_mut().for_each(|x| *x *= factor);
            }
        } else {
            sums.fill(0.0);
            for row in x.chunks_exact(columns) {
                sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            }
            sums.iter_mut().for_each(|sum| *sum = factor(*sum));
            for row in x.chunks_exact_mut(columns) {
                row.iter_mut().zip(&sums).for_each(|(x, f)| *x *= f);
            }
        }
    }
    debug_assert_eq!(x.len(), rows * columns);
}

/// What brings a sum to 1, if it is not 0.
#[inline(always)]
fn factor(sum: f64) -> f64 {
    if sum > 0.0 { sum.recip() } else { 1.0 }
}

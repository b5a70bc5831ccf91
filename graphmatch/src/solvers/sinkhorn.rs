use super::lanes;

/// Scales a positive matrix so that rows and columns sum to 1 in turn, `iterations` half steps, rows (of the side with
/// fewer members) first. On plain numbers: entries must stay within e^±300 of each other.
///
/// The matrix is only read until the end: a half step takes the factors of one side from those of the other.
#[inline(always)]
pub(super) fn sinkhorn(x: &mut [f64], rows: usize, columns: usize, iterations: usize) {
    if x.is_empty() {
        return;
    }
    let (mut of_row, mut of_column) = (vec![1.0; rows], vec![1.0; columns]);
    let mut left = iterations;
    if rows > columns && left > 0 {
        of_column.fill(0.0);
        x.chunks_exact(columns).for_each(|row| add(&mut of_column, 1.0, row));
        of_column.iter_mut().for_each(|sum| *sum = factor(*sum));
        left -= 1;
    }
    let mut sums = vec![0.0; columns];
    while left > 0 {
        // A row's factor is final when its own sum is known, so the same pass over the row serves both half steps.
        sums.fill(0.0);
        for (of_row, row) in of_row.iter_mut().zip(x.chunks_exact(columns)) {
            *of_row = factor(lanes::dot(row, &of_column));
            add(&mut sums, *of_row, row);
        }
        if left > 1 {
            of_column.iter_mut().zip(&sums).for_each(|(of_column, sum)| *of_column = factor(*sum));
        }
        left = left.saturating_sub(2);
    }
    for (of_row, row) in of_row.iter().zip(x.chunks_exact_mut(columns)) {
        row.iter_mut().zip(&of_column).for_each(|(x, of_column)| *x *= of_row * of_column);
    }
    debug_assert_eq!(x.len(), rows * columns);
}

#[inline(always)]
fn add(sums: &mut [f64], factor: f64, row: &[f64]) {
    sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += factor * x);
}

/// What brings a sum to 1, if it is not 0.
#[inline(always)]
fn factor(sum: f64) -> f64 {
    if sum > 0.0 { sum.recip() } else { 1.0 }
}

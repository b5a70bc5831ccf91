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
    let rows_first = rows <= columns;
    let (mut of_row, mut of_column) = (vec![1.0; rows], vec![1.0; columns]);
    for step in 0..iterations {
        if (step % 2 == 0) == rows_first {
            for (of_row, row) in of_row.iter_mut().zip(x.chunks_exact(columns)) {
                *of_row = factor(lanes::dot(row, &of_column));
            }
        } else {
            of_column.fill(0.0);
            for (of_row, row) in of_row.iter().zip(x.chunks_exact(columns)) {
                of_column.iter_mut().zip(row).for_each(|(sum, x)| *sum += of_row * x);
            }
            of_column.iter_mut().for_each(|sum| *sum = factor(*sum));
        }
    }
    for (of_row, row) in of_row.iter().zip(x.chunks_exact_mut(columns)) {
        row.iter_mut().zip(&of_column).for_each(|(x, of_column)| *x *= of_row * of_column);
    }
    debug_assert_eq!(x.len(), rows * columns);
}

/// What brings a sum to 1, if it is not 0.
#[inline(always)]
fn factor(sum: f64) -> f64 {
    if sum > 0.0 { sum.recip() } else { 1.0 }
}

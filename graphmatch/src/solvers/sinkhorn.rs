use crate::lanes::{LANES, Lanes};

/// Scales a positive matrix so that rows and columns sum to 1 in turn, `iterations` half steps, rows (of the side with
/// fewer members) first. On plain numbers: entries must stay within e^±300 of each other.
///
/// The matrix is only read until the end: a half step takes the factors of one side from those of the other.
#[inline(always)]
pub(super) fn sinkhorn(x: &mut [f64], rows: usize, columns: usize, iterations: usize) {
    debug_assert_eq!(x.len(), rows * columns);
    let across = Padded::new(rows, columns, |row, column| x[row * columns + column]);
    let down = Padded::new(columns, rows, |column, row| x[row * columns + column]);
    let (mut of_row, mut of_column) = (vec![[1.0; LANES]; down.width], vec![[1.0; LANES]; across.width]);
    for step in 0..iterations {
        if (step % 2 == 0) == (rows <= columns) {
            down.factors(of_column.as_flattened(), &mut of_row);
        } else {
            across.factors(of_row.as_flattened(), &mut of_column);
        }
    }
    for (row, of_row) in x.chunks_exact_mut(columns.max(1)).zip(of_row.as_flattened()) {
        row.iter_mut().zip(of_column.as_flattened()).for_each(|(x, of_column)| *x *= of_row * of_column);
    }
}

/// Rows of a matrix, each filled up with zeros to whole arrays.
struct Padded {
    /// Arrays a row.
    width: usize,
    values: Vec<Lanes>,
}

impl Padded {
    #[inline(always)]
    fn new(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let width = columns.div_ceil(LANES);
        let mut values = vec![[0.0; LANES]; rows * width];
        for row in 0..rows {
            let lanes = values[row * width..][..width].as_flattened_mut();
            lanes.iter_mut().take(columns).enumerate().for_each(|(column, x)| *x = entry(row, column));
        }
        Self { width, values }
    }

    /// What brings the sum of each column, its rows weighed, to 1.
    #[inline(always)]
    fn factors(&self, of_rows: &[f64], of_columns: &mut [Lanes]) {
        for (k, of_columns) in of_columns.iter_mut().enumerate() {
            let mut sums = [0.0; LANES];
            for (row, of_row) in self.values.chunks_exact(self.width).zip(of_rows) {
                for lane in 0..LANES {
                    sums[lane] += of_row * row[k][lane];
                }
            }
            for lane in 0..LANES {
                of_columns[lane] = if sums[lane] > 0.0 { sums[lane].recip() } else { 1.0 };
            }
        }
    }
}

/// Scales a positive matrix so that rows and columns sum to 1 in turn, `iterations` half steps, rows (of the side with
/// fewer members) first. On plain numbers: entries must stay within e^±300 of each other.
pub(super) fn sinkhorn(x: &mut [f64], rows: usize, columns: usize, iterations: usize) {
    if x.is_empty() {
        return;
    }
    let rows_first = rows <= columns;
    let mut sums = vec![0.0; columns];
    for step in 0..iterations {
        if (step % 2 == 0) == rows_first {
            for row in x.chunks_exact_mut(columns) {
                scale(row, row.iter().sum());
            }
        } else {
            sums.fill(0.0);
            for row in x.chunks_exact(columns) {
                sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            }
            let factors: Vec<f64> = sums.iter().map(|s| if *s > 0.0 { s.recip() } else { 1.0 }).collect();
            for row in x.chunks_exact_mut(columns) {
                row.iter_mut().zip(&factors).for_each(|(x, f)| *x *= f);
            }
        }
    }
    debug_assert_eq!(x.len(), rows * columns);
}

fn scale(row: &mut [f64], sum: f64) {
    if sum > 0.0 {
        let factor = sum.recip();
        row.iter_mut().for_each(|x| *x *= factor);
    }
}

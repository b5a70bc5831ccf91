use nalgebra::SMatrix;

/// `target -= aᵀ b`, unrolled.
#[inline]
pub(crate) fn subtract_transposed_product<const N: usize, const C: usize>(
    target: &mut SMatrix<f64, N, C>,
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, C>,
) {
    for (column, of_b) in target.data.0.iter_mut().zip(&b.data.0) {
        for (entry, of_a) in column.iter_mut().zip(&a.data.0) {
            *entry -= of_a.iter().zip(of_b).map(|(x, y)| x * y).sum::<f64>();
        }
    }
}

/// `target -= a b`, unrolled.
#[inline]
pub(crate) fn subtract_product<const N: usize, const C: usize>(
    target: &mut SMatrix<f64, N, C>,
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, C>,
) {
    for (column, of_b) in target.data.0.iter_mut().zip(&b.data.0) {
        for (of_a, factor) in a.data.0.iter().zip(of_b) {
            column.iter_mut().zip(of_a).for_each(|(entry, x)| *entry -= x * factor);
        }
    }
}

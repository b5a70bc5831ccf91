//! Dense kernels on column-major panels. Every sum has one fixed order, so the bits do not depend on the width
//! of the machine's vectors. Everything is inlined into one caller compiled for the vectors at hand.

/// Rows of a register tile.
pub(crate) const TILE: usize = 8;

/// `tile[j][i] = Σ_k panel[row + i + k · height] · panel[column + j + k · height]`.
///
/// Reads up to `ROWS - 1` values past the last row of the last column: panels are stored with that much to
/// spare behind them, and the caller ignores those rows.
#[inline(always)]
pub(crate) fn tile<const ROWS: usize, const N: usize>(
    panel: &[f64],
    height: usize,
    (row, column): (usize, usize),
    depth: usize,
) -> [[f64; ROWS]; N] {
    let mut sum = [[0.0; ROWS]; N];
    let (mut a, mut b) = (row, column);
    for _ in 0..depth {
        let (Some(left), Some(right)) = (
            panel.get(a..).and_then(|p| p.first_chunk::<ROWS>()),
            panel.get(b..).and_then(|p| p.first_chunk::<N>()),
        ) else {
            break;
        };
        for j in 0..N {
            for i in 0..ROWS {
                sum[j][i] += left[i] * right[j];
            }
        }
        a += height;
        b += height;
    }
    sum
}

/// Cholesky factorisation of a panel whose upper `width × width` part is a symmetric matrix (lower triangle
/// given), with the rows below divided by the transposed factor. `width` is a multiple of `N`.
///
/// Returns the column of the first pivot that is not positive.
#[inline(always)]
pub(crate) fn factor_panel<const N: usize>(
    panel: &mut [f64],
    height: usize,
    width: usize,
) -> Result<(), usize> {
    for first in (0..width).step_by(N) {
        if first > 0 {
            update_columns::<N>(panel, height, first);
        }
        for column in first..first + N {
            let begin = column * height;
            let pivot = panel[begin + column];
            if pivot.is_nan() || pivot <= 0.0 {
                return Err(column);
            }
            let scale = 1.0 / pivot.sqrt();
            let (left, right) = panel.split_at_mut(begin + height);
            let current = &mut left[begin + column..begin + height];
            for x in current.iter_mut() {
                *x *= scale;
            }
            for later in column + 1..first + N {
                let factor = current[later - column];
                let target = &mut right[(later - column - 1) * height + later..][..height - later];
                for (x, y) in target.iter_mut().zip(&current[later - column..]) {
                    *x -= factor * y;
                }
            }
        }
    }
    Ok(())
}

/// Subtracts from the `N` columns at `first` what the columns before them contribute.
#[inline(always)]
fn update_columns<const N: usize>(panel: &mut [f64], height: usize, first: usize) {
    let mut row = first;
    while row + 2 * TILE <= height {
        let sum = tile::<{ 2 * TILE }, N>(panel, height, (row, first), first);
        for (j, column) in sum.iter().enumerate() {
            let target = &mut panel[(first + j) * height + row..][..2 * TILE];
            for (x, y) in target.iter_mut().zip(column) {
                *x -= y;
            }
        }
        row += 2 * TILE;
    }
    while row < height {
        let sum = tile::<TILE, N>(panel, height, (row, first), first);
        let count = TILE.min(height - row);
        for (j, column) in sum.iter().enumerate() {
            let target = &mut panel[(first + j) * height + row..][..count];
            for (x, y) in target.iter_mut().zip(column) {
                *x -= y;
            }
        }
        row += TILE;
    }
}

/// A dot product in four interleaved sums, which vectors of any width up to four add in the same order.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [0.0; 4];
    let (mut left, mut right) = (a.chunks_exact(4), b.chunks_exact(4));
    for (x, y) in (&mut left).zip(&mut right) {
        for i in 0..4 {
            sum[i] += x[i] * y[i];
        }
    }
    for (i, (x, y)) in left.remainder().iter().zip(right.remainder()).enumerate() {
        sum[i] += x * y;
    }
    (sum[0] + sum[2]) + (sum[1] + sum[3])
}

//! Dense work on one front: column-major, `variables · N` columns, one row more for the right-hand side.

use crate::sparse::dense::{TILE, dot, factor_panel, tile};

/// A matrix to sum up: what is left of `values` after `eliminated` variables, in the layout of a front.
pub(crate) struct Source<'a> {
    pub(crate) values: &'a [f64],
    pub(crate) eliminated: usize,
}

/// Zeroes a front, with what the register tiles read past its end.
pub(crate) fn clear<const N: usize>(values: &mut Vec<f64>, variables: usize) {
    let width = variables * N;
    values.clear();
    values.resize((width + 1) * width + 2 * TILE, 0.0);
}

/// Adds a source whose variables stand at `rows` of the front.
#[inline(always)]
pub(crate) fn add<const N: usize>(front: &mut [f64], variables: usize, source: Source<'_>, rows: &[u32]) {
    let height = variables * N + 1;
    let source_height = (source.eliminated + rows.len()) * N + 1;
    let skip = source.eliminated * N;
    for (c, column) in rows.iter().enumerate() {
        let column = *column as usize * N;
        for j in 0..N {
            let from = &source.values[(skip + c * N + j) * source_height..][..source_height];
            let target = (column + j) * height;
            for (r, row) in rows.iter().enumerate().skip(c) {
                let row = *row as usize * N;
                let block = &from[skip + r * N..][..N];
                if row >= column {
                    for (x, y) in front[target + row..][..N].iter_mut().zip(block) {
                        *x += y;
                    }
                } else {
                    for (i, y) in block.iter().enumerate() {
                        front[(row + i) * height + column + j] += y;
                    }
                }
            }
            front[target + height - 1] += from[source_height - 1];
        }
    }
}

/// Factors the first `eliminated` variables and leaves the Schur complement on the others.
///
/// # Errors
/// The column whose pivot was not positive.
#[inline(always)]
pub(crate) fn eliminate<const N: usize>(
    front: &mut [f64],
    variables: usize,
    eliminated: usize,
) -> Result<(), usize> {
    let (height, depth) = (variables * N + 1, eliminated * N);
    factor_panel::<N>(front, height, depth)?;
    for column in (depth..variables * N).step_by(N) {
        let mut row = column;
        while row < height {
            let sum = tile::<TILE, N>(front, height, (row, column), depth);
            let count = TILE.min(height - row);
            for (j, sums) in sum.iter().enumerate() {
                let target = &mut front[(column + j) * height + row..][..count];
                for (x, y) in target.iter_mut().zip(sums) {
                    *x -= y;
                }
            }
            row += TILE;
        }
    }
    Ok(())
}

/// Solves for the eliminated variables, first in `x`, from the others, which follow there.
#[inline(always)]
pub(crate) fn back_substitute<const N: usize>(
    front: &[f64],
    variables: usize,
    eliminated: usize,
    x: &mut [f64],
) {
    let height = variables * N + 1;
    for c in (0..eliminated * N).rev() {
        let column = &front[c * height..(c + 1) * height];
        let known = dot(&column[c + 1..height - 1], &x[c + 1..]);
        x[c] = (column[height - 1] - known) / column[c];
    }
}

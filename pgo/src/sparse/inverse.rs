use nalgebra::{DMatrix, SMatrix};

use super::{Cholesky, Symbolic};

/// The blocks of an inverse that lie in the pattern of its matrix's Cholesky factor.
///
/// Takahashi's recurrence by supernodes: with `[L; B]` the panel of a supernode and `Z` the inverse on the rows
/// below it, `Y = B L⁻¹` gives `-Z Y` below and `L⁻ᵀ L⁻¹ + Yᵀ Z Y` on the diagonal.
///
/// **Source**: Takahashi, Fagan, Chen, *Formation of a sparse bus impedance matrix*, 1973; Erisman, Tinney,
/// *On computing certain elements of the inverse of a sparse matrix*, 1975.
#[derive(Debug, Clone)]
pub(crate) struct SelectedInverse<const N: usize> {
    values: Vec<f64>,
}

impl<const N: usize> SelectedInverse<N> {
    pub(crate) fn new(cholesky: &Cholesky<N>) -> Self {
        let symbolic = cholesky.symbolic();
        let mut values = vec![0.0; symbolic.panel_blocks() * N * N];
        for s in (0..symbolic.supernodes()).rev() {
            let (height, width) = (symbolic.rows(s).len() * N, symbolic.width(s) * N);
            let begin = symbolic.panel_start[s] * N * N;
            let panel = DMatrix::from_column_slice(height, width, cholesky.panel(s));
            let mut inverse = DMatrix::identity(width, width);
            // a factor has a positive diagonal, so this cannot fail
            panel.rows(0, width).solve_lower_triangular_mut(&mut inverse);
            let y = panel.rows(width, height - width) * &inverse;
            let below = -(gather::<N>(symbolic, &values, s) * &y);
            let diagonal = inverse.tr_mul(&inverse) - y.tr_mul(&below);
            for c in 0..width {
                let column = &mut values[begin + c * height..begin + (c + 1) * height];
                column[..width].copy_from_slice(diagonal.column(c).as_slice());
                column[width..].copy_from_slice(below.column(c).as_slice());
            }
        }
        Self { values }
    }

    /// Block of the inverse at columns before ordering; `None` outside the pattern.
    pub(crate) fn block(&self, symbolic: &Symbolic, row: u32, column: u32) -> Option<SMatrix<f64, N, N>> {
        let (r, c) = (symbolic.position[row as usize], symbolic.position[column as usize]);
        let (s, at, within) = symbolic.locate(r.max(c), r.min(c));
        if symbolic.rows(s).get(at) != Some(&r.max(c)) {
            return None;
        }
        let height = symbolic.rows(s).len() * N;
        let begin = symbolic.panel_start[s] * N * N + within * N * height + at * N;
        let block = SMatrix::from_fn(|i, j| self.values[begin + j * height + i]);
        Some(if r >= c { block } else { block.transpose() })
    }
}

/// The inverse on the rows below supernode `s`, all of which lie in panels that are done.
fn gather<const N: usize>(symbolic: &Symbolic, values: &[f64], s: usize) -> DMatrix<f64> {
    let (rows, width) = (symbolic.rows(s).len(), symbolic.width(s));
    let mut z = DMatrix::zeros((rows - width) * N, (rows - width) * N);
    for run in symbolic.runs(s) {
        let target = run.target as usize;
        let (begin, height) = (symbolic.panel_start[target] * N * N, symbolic.rows(target).len() * N);
        let (from, until) = (run.from as usize, run.until as usize);
        let map = &symbolic.map[run.map..run.map + rows - from];
        for column in from..until {
            for row in column..rows {
                for j in 0..N {
                    let place = begin + (map[column - from] as usize * N + j) * height;
                    for i in 0..N {
                        let value = values[place + map[row - from] as usize * N + i];
                        let (r, c) = ((row - width) * N + i, (column - width) * N + j);
                        z[(r, c)] = value;
                        z[(c, r)] = value;
                    }
                }
            }
        }
    }
    z
}

use nalgebra::SMatrix;

use crate::sparse::Cholesky;

/// The columns `L⁻¹ E_c` of one block column `c`: rows by supernode, on the path from the column to the root of the
/// elimination tree, outside of which they are zero.
#[derive(Debug, Clone)]
pub(crate) struct PathColumns<const N: usize> {
    /// Supernodes of the path, ascending, with the position of their first row in `rows`.
    supernodes: Vec<(u32, u32)>,
    /// `N` values a scalar row.
    rows: Vec<[f64; N]>,
}

/// Scratch memory of [`PathColumns::new`]: one row of values a scalar row of the matrix, all zero between calls.
pub(crate) struct PathWork<const N: usize>(Vec<[f64; N]>);

impl<const N: usize> PathWork<N> {
    pub(crate) fn new(cholesky: &Cholesky<N>) -> Self {
        Self(vec![[0.0; N]; cholesky.symbolic().columns() * N])
    }
}

impl<const N: usize> PathColumns<N> {
    /// Solves for block column `column`, in the order before ordering.
    pub(crate) fn new(cholesky: &Cholesky<N>, work: &mut PathWork<N>, column: u32) -> Self {
        let symbolic = cholesky.symbolic();
        let start = symbolic.position[column as usize] as usize;
        for k in 0..N {
            work.0[start * N + k][k] = 1.0;
        }
        let mut path = Self { supernodes: Vec::new(), rows: Vec::new() };
        let mut s = symbolic.owner[start] as usize;
        loop {
            let (rows, width) = (symbolic.rows(s), symbolic.width(s));
            let height = rows.len() * N;
            let (panel, first) = (cholesky.panel(s), symbolic.start[s] as usize * N);
            path.supernodes.push((s as u32, path.rows.len() as u32));
            // columns before the one asked for are zero
            let skip = (start * N).saturating_sub(first);
            path.rows.extend(std::iter::repeat_n([0.0; N], skip));
            for c in skip..width * N {
                let lower = &panel[c * height..(c + 1) * height];
                let value = std::mem::replace(&mut work.0[first + c], [0.0; N]).map(|x| x / lower[c]);
                path.rows.push(value);
                for (at, l) in lower[c + 1..width * N].iter().enumerate() {
                    subtract(&mut work.0[first + c + 1 + at], *l, &value);
                }
                for (row, l) in rows[width..].iter().zip(lower[width * N..].chunks_exact(N)) {
                    for (k, l) in l.iter().enumerate() {
                        subtract(&mut work.0[*row as usize * N + k], *l, &value);
                    }
                }
            }
            match rows.get(width) {
                Some(next) => s = symbolic.owner[*next as usize] as usize,
                None => return path,
            }
        }
    }

    /// `self - other · aᵀ`, on the union of both paths.
    pub(crate) fn minus(&self, other: &Self, a: &SMatrix<f64, N, N>) -> Self {
        let mut both = Self { supernodes: Vec::new(), rows: Vec::new() };
        let (mut i, mut j) = (0, 0);
        while i < self.supernodes.len() || j < other.supernodes.len() {
            let left = self.supernodes.get(i).map_or(u32::MAX, |s| s.0);
            let right = other.supernodes.get(j).map_or(u32::MAX, |s| s.0);
            both.supernodes.push((left.min(right), both.rows.len() as u32));
            let begin = both.rows.len();
            if left <= right {
                both.rows.extend_from_slice(self.span(i));
                i += 1;
            }
            if right <= left {
                let span = other.span(j);
                both.rows.resize(begin + span.len(), [0.0; N]);
                for (to, from) in both.rows[begin..].iter_mut().zip(span) {
                    for r in 0..N {
                        to[r] -= (0..N).map(|c| a[(r, c)] * from[c]).sum::<f64>();
                    }
                }
                j += 1;
            }
        }
        both
    }

    fn span(&self, index: usize) -> &[[f64; N]] {
        let begin = self.supernodes[index].1 as usize;
        let end = self.supernodes.get(index + 1).map_or(self.rows.len(), |s| s.1 as usize);
        &self.rows[begin..end]
    }

    /// The block `E_aᵀ (L Lᵀ)⁻¹ E_b` of the inverse, for `self` of column `a` and `other` of column `b`.
    pub(crate) fn product(&self, other: &Self) -> SMatrix<f64, N, N> {
        let mut sum = SMatrix::<f64, N, N>::zeros();
        let (mut i, mut j) = (0, 0);
        while let (Some((a, _)), Some((b, _))) = (self.supernodes.get(i), other.supernodes.get(j)) {
            if a == b {
                for (x, y) in self.span(i).iter().zip(other.span(j)) {
                    for c in 0..N {
                        for r in 0..N {
                            sum[(r, c)] += x[r] * y[c];
                        }
                    }
                }
            }
            (i, j) = (i + usize::from(a <= b), j + usize::from(b <= a));
        }
        sum
    }
}

#[inline(always)]
fn subtract<const N: usize>(target: &mut [f64; N], factor: f64, value: &[f64; N]) {
    for (t, v) in target.iter_mut().zip(value) {
        *t -= factor * v;
    }
}

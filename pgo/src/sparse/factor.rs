use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::dense::{TILE, dot, factor_panel, tile};
use super::symbolic::{Run, Symbolic};

/// A symmetric matrix of `N × N` blocks in the pattern of a [`Symbolic`]: all diagonal blocks, and the
/// off-diagonal blocks at a fixed list of places.
#[derive(Debug, Clone)]
pub(crate) struct BlockMatrix<const N: usize> {
    /// Diagonal blocks, by column before ordering.
    pub(crate) diagonal: Vec<SMatrix<f64, N, N>>,
    /// Off-diagonal blocks; block `k` stands at row `pairs[k].0`, column `pairs[k].1` before ordering.
    pub(crate) off_diagonal: Vec<SMatrix<f64, N, N>>,
}

impl<const N: usize> BlockMatrix<N> {
    /// `xᵀ M x`, with `pairs` the places of the off-diagonal blocks.
    pub(crate) fn quadratic(&self, pairs: &[(u32, u32)], x: &[SVector<f64, N>]) -> f64 {
        let diagonal: f64 = self.diagonal.iter().zip(x).map(|(block, x)| x.dot(&(block * x))).sum();
        let off: f64 = self
            .off_diagonal
            .iter()
            .zip(pairs)
            .map(|(block, (row, column))| x[*row as usize].dot(&(block * x[*column as usize])))
            .sum();
        diagonal + 2.0 * off
    }
}

/// Where a block goes in the panels, and whether it must be transposed on the way.
#[derive(Debug, Clone, Copy)]
struct Place {
    offset: usize,
    height: u32,
    transpose: bool,
}

/// Cholesky factor of a [`BlockMatrix`], with all the memory that refactoring and solving need.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky<const N: usize> {
    symbolic: Arc<Symbolic>,
    diagonal_places: Vec<Place>,
    off_diagonal_places: Vec<Place>,
    /// All panels, each with [`SPARE`] values behind it.
    values: Vec<f64>,
    /// For the run at hand: offset of each scalar row within a column of the target.
    row_offsets: Vec<u32>,
    #[cfg(feature = "rayon")]
    tree: super::parallel::Tree,
    work: Vec<f64>,
    arch: pulp::Arch,
}

impl<const N: usize> Cholesky<N> {
    /// Memory for factors of matrices with off-diagonal blocks at `pairs` = (row, column) before ordering.
    pub(crate) fn new(symbolic: Arc<Symbolic>, pairs: &[(u32, u32)]) -> Self {
        let place = |row: u32, column: u32| {
            let (row, column) = (symbolic.position[row as usize], symbolic.position[column as usize]);
            let (s, at, within) = symbolic.locate(row.max(column), row.min(column));
            let height = symbolic.rows(s).len() * N;
            Place {
                offset: panel_begin::<N>(&symbolic, s) + within * N * height + at * N,
                height: height as u32,
                transpose: row < column,
            }
        };
        let diagonal_places = (0..symbolic.columns() as u32).map(|c| place(c, c)).collect();
        let off_diagonal_places = pairs.iter().map(|(r, c)| place(*r, *c)).collect();
        let tallest = (0..symbolic.supernodes()).map(|s| symbolic.rows(s).len()).max().unwrap_or(0);
        Self {
            diagonal_places,
            off_diagonal_places,
            values: vec![0.0; symbolic.panel_blocks() * N * N + symbolic.supernodes() * SPARE],
            row_offsets: vec![0; tallest * N],
            #[cfg(feature = "rayon")]
            tree: super::parallel::Tree::new(&symbolic, N),
            work: vec![0.0; (symbolic.columns() + tallest) * N],
            arch: pulp::Arch::new(),
            symbolic,
        }
    }

    pub(crate) fn symbolic(&self) -> &Symbolic {
        &self.symbolic
    }

    /// The panel of supernode `s`, column-major.
    pub(crate) fn panel(&self, s: usize) -> &[f64] {
        let begin = panel_begin::<N>(&self.symbolic, s);
        &self.values[begin..begin + self.symbolic.rows(s).len() * self.symbolic.width(s) * N * N]
    }

    /// Factors `matrix + diag(damping)`; `damping` is in the order of the columns before ordering.
    ///
    /// # Errors
    /// The column, before ordering, at which a pivot was not positive.
    pub(crate) fn factor(
        &mut self,
        matrix: &BlockMatrix<N>,
        damping: Option<&[SVector<f64, N>]>,
    ) -> Result<(), usize> {
        let arch = self.arch;
        #[cfg(feature = "rayon")]
        if self.tree.is_worth_it() {
            self.scatter(matrix, damping);
            let Self { symbolic, values, tree, .. } = self;
            return tree.factor::<N>(symbolic, values, arch).map_err(|c| symbolic.order[c] as usize);
        }
        arch.dispatch(Refactor { cholesky: self, matrix, damping })
    }

    #[inline(always)]
    fn refactor(
        &mut self,
        matrix: &BlockMatrix<N>,
        damping: Option<&[SVector<f64, N>]>,
    ) -> Result<(), usize> {
        self.scatter(matrix, damping);
        let Self { symbolic, values, row_offsets, .. } = self;
        for s in 0..symbolic.supernodes() {
            let begin = panel_begin::<N>(symbolic, s);
            let (height, width) = (symbolic.rows(s).len() * N, symbolic.width(s) * N);
            factor_panel::<N>(&mut values[begin..], height, width)
                .map_err(|column| symbolic.order[symbolic.start[s] as usize + column / N] as usize)?;
            for run in symbolic.runs(s) {
                let (sources, targets) = values.split_at_mut(panel_begin::<N>(symbolic, run.target as usize));
                subtract::<N>(symbolic, s, *run, &sources[begin..], targets, row_offsets);
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn scatter(&mut self, matrix: &BlockMatrix<N>, damping: Option<&[SVector<f64, N>]>) {
        self.values.fill(0.0);
        for (column, (place, block)) in self.diagonal_places.iter().zip(&matrix.diagonal).enumerate() {
            let height = place.height as usize;
            for c in 0..N {
                for r in 0..N {
                    self.values[place.offset + c * height + r] = block[(r, c)];
                }
            }
            if let Some(extra) = damping.and_then(|d| d.get(column)) {
                for c in 0..N {
                    self.values[place.offset + c * height + c] += extra[c];
                }
            }
        }
        for (place, block) in self.off_diagonal_places.iter().zip(&matrix.off_diagonal) {
            let height = place.height as usize;
            for c in 0..N {
                for r in 0..N {
                    let value = if place.transpose { block[(c, r)] } else { block[(r, c)] };
                    self.values[place.offset + c * height + r] = value;
                }
            }
        }
    }

    /// Solves `L Lᵀ x = b` in place; `x` is in the order of the columns before ordering.
    pub(crate) fn solve(&mut self, x: &mut [SVector<f64, N>]) {
        let mut work = std::mem::take(&mut self.work);
        self.solve_with(&mut work, x);
        self.work = work;
    }

    /// The same without changing `self`; `work` is as long as [`Cholesky::work_length`] says.
    pub(crate) fn solve_with(&self, work: &mut [f64], x: &mut [SVector<f64, N>]) {
        self.arch.dispatch(Solve { cholesky: self, work, x });
    }

    /// Length of the scratch memory of [`Cholesky::solve_with`].
    pub(crate) fn work_length(&self) -> usize {
        self.work.len()
    }

    #[inline(always)]
    fn solve_in_place(&self, work: &mut [f64], x: &mut [SVector<f64, N>]) {
        let Self { symbolic, values, .. } = self;
        let (y, local) = work.split_at_mut(symbolic.columns() * N);
        for (new, old) in symbolic.order.iter().enumerate() {
            y[new * N..][..N].copy_from_slice(x[*old as usize].as_slice());
        }
        for s in 0..symbolic.supernodes() {
            forward::<N>(symbolic, values, s, y, local);
        }
        for s in (0..symbolic.supernodes()).rev() {
            backward::<N>(symbolic, values, s, y, local);
        }
        for (new, old) in symbolic.order.iter().enumerate() {
            x[*old as usize].copy_from_slice(&y[new * N..][..N]);
        }
    }
}

/// Values behind each panel that the register tiles may read.
const SPARE: usize = 2 * TILE;

/// Where the panel of a supernode begins.
pub(super) fn panel_begin<const N: usize>(symbolic: &Symbolic, s: usize) -> usize {
    symbolic.panel_start[s] * N * N + s * SPARE
}

/// Subtracts from the panel of one target what one run of rows of supernode `s` contributes to it.
///
/// * `row_offsets` – memory, a value for each scalar row of the source.
#[inline(always)]
pub(super) fn subtract<const N: usize>(
    symbolic: &Symbolic,
    s: usize,
    run: Run,
    source: &[f64],
    target: &mut [f64],
    row_offsets: &mut [u32],
) {
    let (from, until) = (run.from as usize, run.until as usize);
    let rows = symbolic.rows(s).len();
    let (height, depth) = (rows * N, symbolic.width(s) * N);
    let target_height = symbolic.rows(run.target as usize).len() * N;
    let map = &symbolic.map[run.map..run.map + rows - from];
    for (k, at) in map.iter().enumerate() {
        for i in 0..N {
            row_offsets[k * N + i] = at * N as u32 + i as u32;
        }
    }
    let piece = Piece { source, height, depth, from, map, row_offsets, target_height };
    let mut column = from;
    if N < 3 {
        // narrow blocks are taken together; what this adds above the diagonal is never read
        while column + 4 / N <= until {
            piece.subtract::<N, 4>(column, target);
            column += 4 / N;
        }
    }
    while column < until {
        piece.subtract::<N, N>(column, target);
        column += 1;
    }
}

/// One run of rows of a source on their way to a target.
struct Piece<'a> {
    source: &'a [f64],
    height: usize,
    depth: usize,
    from: usize,
    map: &'a [u32],
    row_offsets: &'a [u32],
    target_height: usize,
}

impl Piece<'_> {
    /// Subtracts what goes to `WIDTH` scalar columns, a multiple of `N`, from block column `column` of the source on.
    #[inline(always)]
    fn subtract<const N: usize, const WIDTH: usize>(&self, column: usize, target: &mut [f64]) {
        let mut row = column * N;
        while row < self.height {
            let sum = tile::<TILE, WIDTH>(self.source, self.height, (row, column * N), self.depth);
            let count = TILE.min(self.height - row);
            let offsets = &self.row_offsets[row - self.from * N..][..count];
            for (j, sums) in sum.iter().enumerate() {
                // rows `from..until` map to the target's own columns, so a row's place is also its column
                let at = self.map[column - self.from + j / N] as usize * N + j % N;
                let column = &mut target[at * self.target_height..][..self.target_height];
                for (offset, x) in offsets.iter().zip(sums) {
                    column[*offset as usize] -= x;
                }
            }
            row += TILE;
        }
    }
}

#[inline(always)]
fn forward<const N: usize>(symbolic: &Symbolic, values: &[f64], s: usize, y: &mut [f64], below: &mut [f64]) {
    let rows = symbolic.rows(s);
    let (height, width) = (rows.len() * N, symbolic.width(s) * N);
    let first = symbolic.start[s] as usize * N;
    let panel = &values[panel_begin::<N>(symbolic, s)..];
    let own = &mut y[first..first + width];
    let below = &mut below[..height - width];
    below.fill(0.0);
    for c in 0..width {
        let column = &panel[c * height..(c + 1) * height];
        let value = own[c] / column[c];
        own[c] = value;
        for (x, l) in own[c + 1..].iter_mut().zip(&column[c + 1..width]) {
            *x -= l * value;
        }
        for (x, l) in below.iter_mut().zip(&column[width..]) {
            *x += l * value;
        }
    }
    for (row, sums) in rows[symbolic.width(s)..].iter().zip(below.chunks_exact(N)) {
        for (x, sum) in y[*row as usize * N..][..N].iter_mut().zip(sums) {
            *x -= sum;
        }
    }
}

#[inline(always)]
fn backward<const N: usize>(symbolic: &Symbolic, values: &[f64], s: usize, y: &mut [f64], below: &mut [f64]) {
    let rows = symbolic.rows(s);
    let (height, width) = (rows.len() * N, symbolic.width(s) * N);
    let first = symbolic.start[s] as usize * N;
    let panel = &values[panel_begin::<N>(symbolic, s)..];
    let below = &mut below[..height - width];
    for (row, to) in rows[symbolic.width(s)..].iter().zip(below.chunks_exact_mut(N)) {
        to.copy_from_slice(&y[*row as usize * N..][..N]);
    }
    let own = &mut y[first..first + width];
    for c in (0..width).rev() {
        let column = &panel[c * height..(c + 1) * height];
        let known = dot(&column[c + 1..width], &own[c + 1..]) + dot(&column[width..], below);
        own[c] = (own[c] - known) / column[c];
    }
}

struct Refactor<'a, const N: usize> {
    cholesky: &'a mut Cholesky<N>,
    matrix: &'a BlockMatrix<N>,
    damping: Option<&'a [SVector<f64, N>]>,
}

impl<const N: usize> pulp::NullaryFnOnce for Refactor<'_, N> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.cholesky.refactor(self.matrix, self.damping)
    }
}

struct Solve<'a, const N: usize> {
    cholesky: &'a Cholesky<N>,
    work: &'a mut [f64],
    x: &'a mut [SVector<f64, N>],
}

impl<const N: usize> pulp::NullaryFnOnce for Solve<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.cholesky.solve_in_place(self.work, self.x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};

    fn random_spd<const N: usize>(n: usize, pairs: &[(u32, u32)], seed: u64) -> BlockMatrix<N> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut degree = vec![1.0; n];
        let mut off = Vec::new();
        for (a, b) in pairs {
            off.push(SMatrix::<f64, N, N>::from_fn(|_, _| rng.random_range(-1.0..1.0)));
            degree[*a as usize] += N as f64;
            degree[*b as usize] += N as f64;
        }
        let diagonal = degree.iter().map(|d| SMatrix::identity() * *d).collect();
        BlockMatrix { diagonal, off_diagonal: off }
    }

    fn check<const N: usize>(n: usize, extra: usize, seed: u64) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut pairs: Vec<(u32, u32)> = (1..n as u32).map(|i| (i, i - 1)).collect();
        for _ in 0..extra {
            let (a, b) = (rng.random_range(0..n as u32), rng.random_range(0..n as u32));
            if a != b && !pairs.contains(&(a, b)) && !pairs.contains(&(b, a)) {
                pairs.push((a, b));
            }
        }
        let matrix = random_spd::<N>(n, &pairs, seed);
        let mut dense = DMatrix::zeros(n * N, n * N);
        for (i, block) in matrix.diagonal.iter().enumerate() {
            dense.view_mut((i * N, i * N), (N, N)).copy_from(block);
        }
        for ((r, c), block) in pairs.iter().zip(&matrix.off_diagonal) {
            let (r, c) = (*r as usize * N, *c as usize * N);
            dense.view_mut((r, c), (N, N)).copy_from(block);
            dense.view_mut((c, r), (N, N)).copy_from(&block.transpose());
        }
        let b = DVector::from_fn(n * N, |_, _| rng.random_range(-1.0..1.0));
        let expected = dense.lu().solve(&b).unwrap();
        let symbolic = Arc::new(Symbolic::new(n, &pairs, N));
        let mut cholesky = Cholesky::<N>::new(symbolic, &pairs);
        cholesky.factor(&matrix, None).unwrap();
        let mut x: Vec<SVector<f64, N>> = (0..n).map(|i| b.fixed_rows::<N>(i * N).into_owned()).collect();
        cholesky.solve(&mut x);
        for (i, x) in x.iter().enumerate() {
            assert!((x - expected.fixed_rows::<N>(i * N)).amax() < 1e-11, "n {n}, extra {extra}, block {i}");
        }
    }

    #[test]
    fn solves_agree_with_dense_elimination() {
        for (n, extra) in [(1, 0), (2, 0), (5, 3), (30, 10), (60, 60), (60, 300)] {
            for seed in 0..3 {
                check::<3>(n, extra, seed);
                check::<6>(n, extra, seed);
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_names_its_column() {
        let pairs = [(0, 1), (1, 2)];
        let mut matrix = random_spd::<3>(3, &pairs, 1);
        matrix.diagonal[2][(1, 1)] = -4.0;
        let mut cholesky = Cholesky::<3>::new(Arc::new(Symbolic::new(3, &pairs, 3)), &pairs);
        assert!(cholesky.factor(&matrix, None).is_err());
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn threads_leave_the_same_bits() {
        let side = 40u32;
        let mut pairs = Vec::new();
        for i in 0..side * side {
            pairs.extend((i % side != 0).then(|| (i, i - 1)));
            pairs.extend((i >= side).then(|| (i, i - side)));
        }
        let n = (side * side) as usize;
        let matrix = random_spd::<6>(n, &pairs, 5);
        let symbolic = Arc::new(Symbolic::new(n, &pairs, 6));
        let mut parallel = Cholesky::<6>::new(symbolic, &pairs);
        assert!(parallel.tree.is_worth_it());
        let mut serial = parallel.clone();
        parallel.factor(&matrix, None).unwrap();
        serial.refactor(&matrix, None).unwrap();
        assert!(parallel.values.iter().zip(&serial.values).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

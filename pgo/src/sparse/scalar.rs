use nalgebra::SVector;

use super::Cholesky;

impl Cholesky<1> {
    /// Solves `L Lᵀ x = b` in place for `D` right-hand sides at once: row `i` of each is in `x[i]`, in the order before
    /// ordering.
    pub(crate) fn solve_together<const D: usize>(&self, x: &mut [SVector<f64, D>]) {
        let symbolic = self.symbolic();
        let mut y: Vec<SVector<f64, D>> = symbolic.order.iter().map(|old| x[*old as usize]).collect();
        for s in 0..symbolic.supernodes() {
            let (rows, panel) = (symbolic.rows(s), self.panel(s));
            for (c, column) in panel.chunks_exact(rows.len()).enumerate() {
                let value = y[rows[c] as usize] / column[c];
                y[rows[c] as usize] = value;
                for (row, l) in rows[c + 1..].iter().zip(&column[c + 1..]) {
                    y[*row as usize] -= value * *l;
                }
            }
        }
        for s in (0..symbolic.supernodes()).rev() {
            let (rows, panel) = (symbolic.rows(s), self.panel(s));
            for (c, column) in panel.chunks_exact(rows.len()).enumerate().rev() {
                let mut value = y[rows[c] as usize];
                for (row, l) in rows[c + 1..].iter().zip(&column[c + 1..]) {
                    value -= y[*row as usize] * *l;
                }
                y[rows[c] as usize] = value / column[c];
            }
        }
        for (y, old) in y.iter().zip(&symbolic.order) {
            x[*old as usize] = *y;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::SMatrix;
    use rand::{RngExt, SeedableRng};

    use super::super::{BlockMatrix, Symbolic};
    use super::*;

    #[test]
    fn the_residual_vanishes() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        let n = 40u32;
        let mut pairs: Vec<(u32, u32)> = (1..n).map(|i| (i, i - 1)).collect();
        pairs.extend((7..n).step_by(3).map(|i| (i, i - 7)));
        let off_diagonal: Vec<SMatrix<f64, 1, 1>> =
            pairs.iter().map(|_| SMatrix::from_element(rng.random_range(-1.0..1.0))).collect();
        let matrix = BlockMatrix { diagonal: vec![SMatrix::from_element(6.0); n as usize], off_diagonal };
        let mut cholesky = Cholesky::<1>::new(Arc::new(Symbolic::new(n as usize, &pairs, 1)), &pairs);
        cholesky.factor(&matrix, None).unwrap();
        let b: Vec<SVector<f64, 2>> =
            (0..n).map(|_| SVector::from_fn(|_, _| rng.random_range(-1.0..1.0))).collect();
        let mut x = b.clone();
        cholesky.solve_together(&mut x);
        let mut product: Vec<SVector<f64, 2>> = x.iter().map(|x| x * 6.0).collect();
        for ((r, c), block) in pairs.iter().zip(&matrix.off_diagonal) {
            product[*r as usize] += x[*c as usize] * block[0];
            product[*c as usize] += x[*r as usize] * block[0];
        }
        assert!(product.iter().zip(&b).all(|(p, b)| (p - b).amax() < 1e-13));
    }
}

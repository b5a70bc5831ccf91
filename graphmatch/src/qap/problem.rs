use nalgebra::DMatrix;

use crate::Error;

/// Minimise `Σ_ij a[i,j] b[p(i), p(j)]` over permutations `p`.
#[derive(Debug, Clone, PartialEq)]
pub struct Qap {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
}

/// A permutation and what it costs.
#[derive(Debug, Clone, PartialEq)]
pub struct Permutation {
    /// `p(i)`, counted from 0.
    pub image: Vec<usize>,
    /// Its cost.
    pub cost: f64,
}

impl Qap {
    /// A problem of two square matrices of one size.
    ///
    /// # Errors
    /// Not square, not of one size, or an entry that is not finite.
    pub fn new(a: DMatrix<f64>, b: DMatrix<f64>) -> Result<Self, Error> {
        let n = a.nrows();
        for (what, found) in
            [("the columns of a", a.ncols()), ("the rows of b", b.nrows()), ("the columns of b", b.ncols())]
        {
            if found != n {
                return Err(Error::WrongLength { what, expected: n, found });
            }
        }
        for matrix in [&a, &b] {
            for row in 0..n {
                for column in 0..n {
                    let value = matrix[(row, column)];
                    if !value.is_finite() {
                        return Err(Error::BadCost { row, column, value });
                    }
                }
            }
        }
        Ok(Self { a, b })
    }

    /// Reads the QAPLIB format: n, then the n² numbers of a, then those of b, row by row.
    ///
    /// # Errors
    /// Too few or too many numbers, or something that is none.
    pub fn from_qaplib(text: &str) -> Result<Self, Error> {
        let wrong = |reason: String| Error::Parse { what: "QAPLIB instance", reason };
        let mut words = text.split_whitespace();
        let first = words.next().ok_or_else(|| wrong("it is empty".into()))?;
        let n: usize = first.parse().map_err(|_| wrong(format!("size {first:?} is no whole number")))?;
        let numbers: Vec<f64> = words
            .map(|w| w.parse().map_err(|_| wrong(format!("{w:?} is no number"))))
            .collect::<Result<_, _>>()?;
        let expected = n.checked_mul(n).and_then(|x| x.checked_mul(2));
        if expected != Some(numbers.len()) {
            return Err(wrong(format!("{} numbers follow size {n}, which needs 2 n²", numbers.len())));
        }
        let (a, b) = numbers.split_at(n * n);
        Self::new(DMatrix::from_row_slice(n, n, a), DMatrix::from_row_slice(n, n, b))
    }

    /// Rows of either matrix.
    pub fn size(&self) -> usize {
        self.a.nrows()
    }

    /// The first matrix.
    pub fn a(&self) -> &DMatrix<f64> {
        &self.a
    }

    /// The second matrix.
    pub fn b(&self) -> &DMatrix<f64> {
        &self.b
    }

    /// Cost of a permutation, or `None` if `image` is none of this size.
    pub fn cost(&self, image: &[usize]) -> Option<f64> {
        let n = self.size();
        let mut seen = vec![false; n];
        for &k in image {
            if k >= n || std::mem::replace(&mut seen[k], true) {
                return None;
            }
        }
        (image.len() == n).then(|| self.cost_of(image))
    }

    pub(super) fn cost_of(&self, image: &[usize]) -> f64 {
        let n = self.size();
        let row = |i: usize| (0..n).map(|j| self.a[(i, j)] * self.b[(image[i], image[j])]).sum::<f64>();
        (0..n).map(row).sum()
    }
}

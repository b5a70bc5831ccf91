//! How well pairs of pairs agree: `S[(i,a),(j,b)]`, large where edge `i–j` of map 1 is as long as edge `a–b` of map 2.

mod banded;
mod params;
mod rows;
mod sparse;

use nalgebra::{DMatrix, Point2};
use pulp::{Arch, NullaryFnOnce};

pub use params::{AffinityParams, Attributes, Kernel};

use crate::object::{centroids, check_map};
use crate::{Error, Object};
use banded::Banded;
use rows::Rows;
use sparse::Sparse;

/// The symmetric matrix of agreements between pairs, index `i * columns + a`, with zero diagonal and zeros where two
/// pairs share an object.
///
/// ```text
/// S[(i,a),(j,b)] = kernel(d¹_ij − d²_ab) · w(i,a) · w(j,b),   i ≠ j, a ≠ b
/// ```
///
/// Never stored as a whole: edges are sorted by length, so the partners of an edge of map 1 are one run of edges of
/// map 2 and only the kernel's values along these runs are kept. Where the attributes rule most pairs out, the
/// rows of the remaining pairs are stored instead. Memory O(edge pairs within the kernel's reach).
#[derive(Debug, Clone)]
pub struct Affinity {
    rows: usize,
    columns: usize,
    weights: Vec<f64>,
    form: Form,
    lengths1: DMatrix<f64>,
    lengths2: DMatrix<f64>,
    kernel: Kernel,
    min_edge: f64,
    no_exact_ones: bool,
}

#[derive(Debug, Clone)]
enum Form {
    /// With rows where the matrix is small.
    Banded(Banded, Option<Rows>),
    Sparse(Sparse),
}

impl Affinity {
    /// The affinity of two maps.
    ///
    /// # Errors
    /// An object that is not finite; a parameter out of range.
    pub fn new(map1: &[Object], map2: &[Object], params: &AffinityParams) -> Result<Self, Error> {
        params.check()?;
        check_map(map1, "map1")?;
        check_map(map2, "map2")?;
        let (lengths1, lengths2) = (lengths(&centroids(map1)), lengths(&centroids(map2)));
        let weights: Vec<f64> =
            map1.iter().flat_map(|a| map2.iter().map(move |b| params.attributes.weight(a, b))).collect();
        let admissible = weights.iter().filter(|w| **w > 0.0).count();
        let form = if 4 * admissible < weights.len() {
            Form::Sparse(Sparse::new(&lengths1, &lengths2, &weights, params))
        } else {
            let banded = Banded::new(&lengths1, &lengths2, params);
            let rows = Rows::new(&banded, map2.len(), &weights);
            Form::Banded(banded, rows)
        };
        Ok(Self {
            rows: map1.len(),
            columns: map2.len(),
            weights,
            form,
            lengths1,
            lengths2,
            kernel: params.kernel,
            min_edge: params.min_edge,
            no_exact_ones: false,
        })
    }

    /// Objects of map 1.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Objects of map 2.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Weight of every pair by its attributes, `rows × columns`, row-major; 0 where ruled out.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// One entry, of pairs `p = (i, a)` and `q = (j, b)`.
    pub fn entry(&self, p: (usize, usize), q: (usize, usize)) -> f64 {
        if p.0 == q.0 || p.1 == q.1 {
            return 0.0;
        }
        let (d1, d2) = (self.lengths1[(p.0, q.0)], self.lengths2[(p.1, q.1)]);
        if d1 < self.min_edge || d2 < self.min_edge {
            return 0.0;
        }
        let value = self.kernel.value(d1 - d2);
        if self.no_exact_ones && d1 == d2 {
            return 0.0;
        }
        value * self.weights[p.0 * self.columns + p.1] * self.weights[q.0 * self.columns + q.1]
    }

    /// Sets to zero every entry whose edges are exactly equally long, as the published code does by mistake.
    pub(crate) fn drop_exact_ones(&mut self) {
        self.no_exact_ones = true;
        match &mut self.form {
            Form::Banded(banded, rows) => {
                banded.drop_exact_ones();
                *rows = Rows::new(banded, self.columns, &self.weights);
            }
            Form::Sparse(sparse) => sparse.drop_exact_ones(&self.lengths1, &self.lengths2, self.columns),
        }
    }

    /// `y = S x`; both `rows × columns`, row-major.
    ///
    /// # Errors
    /// A vector of another length.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) -> Result<(), Error> {
        for found in [x.len(), y.len()] {
            if found != self.weights.len() {
                return Err(Error::WrongLength {
                    what: "a pair vector",
                    expected: self.weights.len(),
                    found,
                });
            }
        }
        self.apply(x, y);
        Ok(())
    }

    /// [`Affinity::multiply`] for vectors known to fit.
    pub(crate) fn apply(&self, x: &[f64], y: &mut [f64]) {
        Arch::new().dispatch(Product { affinity: self, x, y });
    }

    #[inline(always)]
    fn product(&self, x: &[f64], y: &mut [f64]) {
        match &self.form {
            Form::Banded(_, Some(rows)) => rows.multiply(x, y),
            Form::Banded(banded, None) => {
                let weighted: Vec<f64> = x.iter().zip(&self.weights).map(|(x, w)| x * w).collect();
                banded.multiply(self.columns, &weighted, y);
                for (y, w) in y.iter_mut().zip(&self.weights) {
                    *y *= w;
                }
            }
            Form::Sparse(sparse) => sparse.multiply(x, y),
        }
    }

    /// Entries that are stored: pairs of pairs within the kernel's reach, each once.
    pub fn stored(&self) -> usize {
        match &self.form {
            Form::Banded(banded, _) => 2 * banded.stored(),
            Form::Sparse(sparse) => sparse.stored(),
        }
    }
}

struct Product<'a> {
    affinity: &'a Affinity,
    x: &'a [f64],
    y: &'a mut [f64],
}

impl NullaryFnOnce for Product<'_> {
    type Output = ();

    /// What is inlined here is compiled for the machine: three-operand instructions save a third of the loops.
    #[inline(always)]
    fn call(self) {
        self.affinity.product(self.x, self.y);
    }
}

fn lengths(points: &[Point2<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(points.len(), points.len(), |i, j| (points[i] - points[j]).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::split_mix::SplitMix;

    #[test]
    fn rows_and_runs_give_the_product_of_the_entries() {
        let mut random = SplitMix::new(3);
        let mut map = |n: usize| -> Vec<Object> {
            (0..n)
                .map(|_| {
                    let mut draw = || (random.next() >> 11) as f64 / (1_u64 << 53) as f64;
                    Object::new(Point2::new(30.0 * draw(), 30.0 * draw()), 3.0 + draw(), 2.0 + draw())
                })
                .collect()
        };
        let (map1, map2) = (map(7), map(9));
        let attributes = Attributes::Laplacian { mu: 0.5 };
        let affinity =
            Affinity::new(&map1, &map2, &AffinityParams { attributes, ..AffinityParams::default() }).unwrap();
        let Form::Banded(banded, Some(rows)) = &affinity.form else { panic!("not small") };
        let pairs: Vec<(usize, usize)> = (0..7).flat_map(|i| (0..9).map(move |a| (i, a))).collect();
        let x: Vec<f64> = (0..63).map(|k| 1.0 + f64::from(k % 5)).collect();
        let runs = Affinity { form: Form::Banded(banded.clone(), None), ..affinity.clone() };
        let (mut of_rows, mut of_runs) = (vec![0.0; 63], vec![0.0; 63]);
        rows.multiply(&x, &mut of_rows);
        runs.apply(&x, &mut of_runs);
        for (k, &p) in pairs.iter().enumerate() {
            let expected: f64 = pairs.iter().zip(&x).map(|(&q, x)| affinity.entry(p, q) * x).sum();
            assert!((of_rows[k] - expected).abs() < 1e-12 * (1.0 + expected));
            assert!((of_runs[k] - expected).abs() < 1e-12 * (1.0 + expected));
        }
        assert!(of_rows.iter().any(|y| *y > 0.0));
    }
}

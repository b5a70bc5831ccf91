use pulp::{Arch, NullaryFnOnce};

use crate::Affinity;
use crate::lanes;
use crate::tridiagonal::largest_eigenpair;

/// A principal eigenvector of an affinity.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenvector {
    /// Entry of every pair, row-major, not negative, of norm 1; all zero if the affinity is.
    pub vector: Vec<f64>,
    /// Its eigenvalue.
    pub value: f64,
    /// Products with the affinity.
    pub iterations: usize,
    /// `‖S x − λ x‖ / λ`.
    pub residual: f64,
}

const TOLERANCE: f64 = 1e-7;
const STEPS: usize = 24;
const RESTARTS: usize = 12;

/// The eigenvector of the largest eigenvalue, by Lanczos with full reorthogonalisation, restarted with its best
/// vector until the residual falls below 10⁻⁷ λ or after 288 products.
///
/// * `start` – where to begin, such as the answer for slightly other maps; `None` or a vector of another length
///   begins with ones.
///
/// **Source**: Leordeanu, Hebert, "A spectral technique for correspondence problems using pairwise constraints",
/// 2005; Lanczos as in Golub, Van Loan, "Matrix Computations", ch. 10.
pub fn principal_eigenvector(affinity: &Affinity, start: Option<&[f64]>) -> Eigenvector {
    let size = affinity.rows() * affinity.columns();
    let ones = || vec![1.0; size];
    let mut x = start.filter(|s| s.len() == size).map_or_else(ones, <[f64]>::to_vec);
    // A start with a negative or NaN entry could be orthogonal to the answer.
    if !x.iter().all(|v| *v >= 0.0 && v.is_finite()) || normalize(&mut x) == 0.0 {
        x = ones();
        normalize(&mut x);
    }
    let mut found = largest_eigenvector(|x, y| affinity.apply(x, y), x);
    for v in &mut found.vector {
        *v = v.abs();
    }
    found
}

/// The same under the constraint that all rows (of the smaller side; of both if equal) have the same sum, as the
/// rows of an assignment have; entries may be negative.
///
/// **Source**: Cour, Srinivasan, Shi, "Balanced graph matching" (SMAC), 2006.
pub fn smac(affinity: &Affinity) -> Eigenvector {
    let (n, m) = (affinity.rows(), affinity.columns());
    let mut x = vec![1.0; n * m];
    normalize(&mut x);
    let mut found = largest_eigenvector(
        |x, y| {
            affinity.apply(x, y);
            balance(y, n, m);
        },
        x,
    );
    if found.vector.iter().sum::<f64>() < 0.0 {
        found.vector.iter_mut().for_each(|v| *v = -*v);
    }
    found
}

/// Projects onto matrices whose row sums (if n ≤ m) and whose column sums (if n ≥ m) are all equal.
fn balance(x: &mut [f64], n: usize, m: usize) {
    if n == 0 || m == 0 {
        return;
    }
    let rows: Vec<f64> = x.chunks_exact(m).map(|row| row.iter().sum()).collect();
    let mut columns = vec![0.0; m];
    for row in x.chunks_exact(m) {
        columns.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
    let total: f64 = rows.iter().sum();
    for (row, sum) in x.chunks_exact_mut(m).zip(rows) {
        for (x, column) in row.iter_mut().zip(&columns) {
            if n <= m {
                *x -= (sum - total / n as f64) / m as f64;
            }
            if n >= m {
                *x -= (column - total / m as f64) / n as f64;
            }
        }
    }
}

/// Restarted Lanczos for a symmetric operator; `start` has norm 1.
fn largest_eigenvector(apply: impl Fn(&[f64], &mut [f64]), start: Vec<f64>) -> Eigenvector {
    let mut best = Eigenvector { vector: start, value: 0.0, iterations: 0, residual: 0.0 };
    for _ in 0..RESTARTS {
        best = lanczos(&apply, best);
        if best.residual <= TOLERANCE {
            break;
        }
    }
    best
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    Arch::new().dispatch(|| lanes::dot(a, b))
}

/// Takes from a vector its shares of orthonormal ones.
struct Orthogonalise<'a> {
    vector: &'a mut [f64],
    basis: &'a [Vec<f64>],
}

impl NullaryFnOnce for Orthogonalise<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        // Twice is enough: the second pass removes what rounding left of the first.
        for _ in 0..2 {
            for b in self.basis {
                let share = lanes::dot(self.vector, b);
                self.vector.iter_mut().zip(b).for_each(|(x, b)| *x -= share * b);
            }
        }
    }
}

/// Scales to norm 1 and returns the norm it had.
fn normalize(x: &mut [f64]) -> f64 {
    let norm = dot(x, x).sqrt();
    if norm > 0.0 {
        x.iter_mut().for_each(|v| *v /= norm);
    }
    norm
}

fn lanczos(apply: &impl Fn(&[f64], &mut [f64]), from: Eigenvector) -> Eigenvector {
    let mut basis = vec![from.vector];
    let (mut diagonal, mut off) = (Vec::new(), Vec::new());
    loop {
        let k = diagonal.len();
        let mut next = vec![0.0; basis[k].len()];
        apply(&basis[k], &mut next);
        diagonal.push(dot(&next, &basis[k]));
        Arch::new().dispatch(Orthogonalise { vector: &mut next, basis: &basis });
        let beta = normalize(&mut next);
        let (value, ritz) = largest_eigenpair(&diagonal, &off);
        let residual = if value > 0.0 { beta * ritz[k].abs() / value } else { 0.0 };
        if residual <= TOLERANCE || k + 1 == STEPS || beta == 0.0 {
            let mut vector = vec![0.0; next.len()];
            for (b, r) in basis.iter().zip(&ritz) {
                vector.iter_mut().zip(b).for_each(|(x, b)| *x += r * b);
            }
            normalize(&mut vector);
            if value <= 0.0 {
                vector.fill(0.0);
            }
            return Eigenvector {
                vector,
                value: value.max(0.0),
                iterations: from.iterations + k + 1,
                residual,
            };
        }
        off.push(beta);
        basis.push(next);
    }
}

use nalgebra::DMatrix;

use super::{Permutation, Qap};
use crate::{Costs, Error, assign};

/// Knobs of [`faq`].
#[derive(Debug, Clone, PartialEq)]
pub struct FaqParams {
    /// Most steps. Default 30.
    pub iterations: usize,
    /// Step (Frobenius norm over √n) below which to stop. Default 0.03.
    pub tolerance: f64,
}

impl Default for FaqParams {
    fn default() -> Self {
        Self { iterations: 30, tolerance: 0.03 }
    }
}

/// A permutation of low cost by Frank-Wolfe steps over doubly stochastic matrices, from their middle.
///
/// # Errors
/// A cost that overflows.
///
/// **Source**: Vogelstein et al., "Fast approximate quadratic programming for graph matching", 2015.
pub fn faq(problem: &Qap, params: &FaqParams) -> Result<Permutation, Error> {
    let n = problem.size();
    if n == 0 {
        return Ok(Permutation { image: Vec::new(), cost: 0.0 });
    }
    let (a, b) = (problem.a(), problem.b());
    // f(P) = Σ a_ij (P b Pᵀ)_ij, so its gradient is a P bᵀ + aᵀ P b.
    let gradient = |p: &DMatrix<f64>| a * p * b.transpose() + a.transpose() * p * b;
    let mut p = DMatrix::from_element(n, n, 1.0 / n as f64);
    for _ in 0..params.iterations {
        let g = gradient(&p);
        let direction = permutation_matrix(&least(&g)?) - &p;
        let curvature = a.dot(&(&direction * b * direction.transpose()));
        let slope = g.dot(&direction);
        let length = if curvature > 0.0 {
            (-0.5 * slope / curvature).clamp(0.0, 1.0)
        } else if curvature + slope < 0.0 {
            1.0
        } else {
            0.0
        };
        p += length * &direction;
        if length * direction.norm() < params.tolerance * (n as f64).sqrt() {
            break;
        }
    }
    let image = least(&-p)?;
    Ok(Permutation { cost: problem.cost_of(&image), image })
}

fn least(costs: &DMatrix<f64>) -> Result<Vec<usize>, Error> {
    let n = costs.nrows();
    let row_major = costs.transpose();
    let found = assign(Costs::new(n, n, row_major.as_slice())?)?;
    Ok(found.column_of_row.into_iter().flatten().collect())
}

fn permutation_matrix(image: &[usize]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(image.len(), image.len());
    for (i, &j) in image.iter().enumerate() {
        matrix[(i, j)] = 1.0;
    }
    matrix
}

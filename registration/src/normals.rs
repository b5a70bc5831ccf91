use nalgebra::{SMatrix, SVector};
use pulp::{Arch, NullaryFnOnce};

use crate::Error;
use crate::error::check;
use crate::kd_tree::{KdTree, Neighbor};
use crate::linalg::symmetric_eigen;
use crate::parallel;

/// Raises an upper bound of a distance above its rounding.
const ROUNDING: f64 = 1.0 + 1e-9;

/// Unit normals from the `neighbors` nearest points, turned towards `viewpoint`.
pub(crate) fn estimate<const D: usize>(
    points: &[SVector<f64, D>],
    tree: &KdTree<D>,
    neighbors: usize,
    viewpoint: &SVector<f64, D>,
) -> Result<Vec<SVector<f64, D>>, Error> {
    check("neighbors", neighbors as f64, neighbors >= D, "D or more")?;
    Ok(for_each_neighborhood(points, tree, neighbors, |point, found| {
        towards(&normal_of(&scatter(points, point, found), viewpoint - point), &(viewpoint - point))
    }))
}

/// Scatter of the `neighbors` nearest points about their mean, plus `noise`² along every axis.
pub(crate) fn covariances<const D: usize>(
    points: &[SVector<f64, D>],
    tree: &KdTree<D>,
    neighbors: usize,
    noise: f64,
) -> Result<Vec<SMatrix<f64, D, D>>, Error> {
    check("neighbors", neighbors as f64, neighbors >= 2, "2 or more")?;
    check("noise", noise, noise > 0.0 && noise.is_finite(), "more than 0")?;
    Ok(for_each_neighborhood(points, tree, neighbors, |point, found| {
        let freedom = found.len().saturating_sub(1).max(1) as f64;
        scatter(points, point, found) / freedom + SMatrix::identity() * (noise * noise)
    }))
}

/// What `local` makes of each point and its nearest points, in the order of the points.
fn for_each_neighborhood<const D: usize, T: Clone + Send>(
    points: &[SVector<f64, D>],
    tree: &KdTree<D>,
    neighbors: usize,
    local: impl Fn(&SVector<f64, D>, &[Neighbor]) -> T + Sync,
) -> Vec<T> {
    let positions: Vec<u32> = (0..points.len() as u32).collect();
    // in tree order, so that consecutive queries touch the same leaves
    let in_order =
        |positions: &[u32]| Arch::new().dispatch(Neighborhoods { tree, neighbors, positions, local: &local });
    let found = parallel::map_chunks(&positions, in_order);
    let mut results = found.clone();
    for (index, result) in tree.order().iter().zip(found) {
        results[*index as usize] = result;
    }
    results
}

/// The neighbourhoods of a run of tree positions, as one piece of work that is compiled for the processor's vectors.
struct Neighborhoods<'a, const D: usize, F> {
    tree: &'a KdTree<D>,
    neighbors: usize,
    positions: &'a [u32],
    local: &'a F,
}

impl<const D: usize, T, F: Fn(&SVector<f64, D>, &[Neighbor]) -> T> NullaryFnOnce for Neighborhoods<'_, D, F> {
    type Output = Vec<T>;

    #[inline(always)]
    fn call(self) -> Vec<T> {
        let mut results = Vec::with_capacity(self.positions.len());
        let mut found: Vec<Neighbor> = Vec::with_capacity(self.neighbors + 1);
        let (mut previous, mut farthest) = (SVector::repeat(f64::INFINITY), 0.0);
        for &position in self.positions {
            let point = self.tree.point_at(position as usize);
            // the neighbours of the point before are at most this far, so those of this one are not farther
            let reach: f64 = (farthest + (point - previous).norm()) * ROUNDING;
            self.tree.k_nearest_at(position, self.neighbors, reach * reach, &mut found);
            (previous, farthest) = (*point, found.last().map_or(f64::INFINITY, |n| n.distance_sq.sqrt()));
            results.push((self.local)(point, &found));
        }
        results
    }
}

/// Scatter matrix of the neighbours, summed about `point` so that large coordinates lose no digits.
fn scatter<const D: usize>(
    points: &[SVector<f64, D>],
    point: &SVector<f64, D>,
    neighbors: &[Neighbor],
) -> SMatrix<f64, D, D> {
    let (mut sum, mut squares) = (SVector::<f64, D>::zeros(), SMatrix::<f64, D, D>::zeros());
    for neighbor in neighbors {
        let d = points[neighbor.index] - point;
        sum += d;
        squares += d * d.transpose();
    }
    squares - sum * sum.transpose() / neighbors.len().max(1) as f64
}

fn normal_of<const D: usize>(scatter: &SMatrix<f64, D, D>, fallback: SVector<f64, D>) -> SVector<f64, D> {
    let (axis, values) = smallest_axis(scatter);
    // rank below D - 1: no line (plane) is defined, so the direction of sight serves
    if values[1.min(D - 1)] > 1e-12 * values[D - 1] && values[D - 1] > 0.0 {
        axis
    } else {
        let along = fallback.try_normalize(0.0);
        along.unwrap_or_else(|| SVector::from_fn(|i, _| f64::from(u8::from(i == 0))))
    }
}

fn towards<const D: usize>(normal: &SVector<f64, D>, view: &SVector<f64, D>) -> SVector<f64, D> {
    if normal.dot(view) < 0.0 { -normal } else { *normal }
}

/// Unit eigenvector of the smallest eigenvalue of a symmetric matrix, and all eigenvalues in ascending order,
/// negative ones from rounding set to zero.
pub(crate) fn smallest_axis<const D: usize>(m: &SMatrix<f64, D, D>) -> (SVector<f64, D>, SVector<f64, D>) {
    if D == 2 {
        let mean = 0.5 * (m[(0, 0)] + m[(1, 1)]);
        let (half, off) = (0.5 * (m[(0, 0)] - m[(1, 1)]), m[(0, 1)]);
        let radius = (half * half + off * off).sqrt();
        // the long axis: of its two forms the one that subtracts nothing
        let (x, y) = if half >= 0.0 { (half + radius, off) } else { (off, radius - half) };
        let length = (x * x + y * y).sqrt();
        let (cos, sin) = if length > 0.0 { (x / length, y / length) } else { (1.0, 0.0) };
        let axis = SVector::from_fn(|i, _| if i == 0 { -sin } else { cos });
        let values = SVector::from_fn(|i, _| if i == 0 { (mean - radius).max(0.0) } else { mean + radius });
        return (axis, values);
    }
    if D == 3
        && let Some(found) = smallest_axis_of_three(m)
    {
        return found;
    }
    let (values, vectors) = symmetric_eigen(m);
    (vectors.column(0).into_owned(), values.map(|v| v.max(0.0)))
}

/// The closed form for three dimensions (trigonometric roots of the characteristic polynomial); `None` when the
/// two smaller eigenvalues are too close for it to tell the axis.
fn smallest_axis_of_three<const D: usize>(
    m: &SMatrix<f64, D, D>,
) -> Option<(SVector<f64, D>, SVector<f64, D>)> {
    let mean = (m[(0, 0)] + m[(1, 1)] + m[(2, 2)]) / 3.0;
    let (a, b, c) = (m[(0, 0)] - mean, m[(1, 1)] - mean, m[(2, 2)] - mean);
    let (d, e, f) = (m[(0, 1)], m[(0, 2)], m[(1, 2)]);
    let p = ((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0).sqrt();
    if p <= 1e-9 * mean {
        return None;
    }
    let determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e);
    let phi = (0.5 * determinant / (p * p * p)).clamp(-1.0, 1.0).acos() / 3.0;
    let high = mean + 2.0 * p * phi.cos();
    let low = mean + 2.0 * p * (phi + 2.0 * std::f64::consts::FRAC_PI_3).cos();
    let rows = [[m[(0, 0)] - low, d, e], [d, m[(1, 1)] - low, f], [e, f, m[(2, 2)] - low]];
    // the axis is normal to all rows: the longest cross product is the best conditioned
    let (mut axis, mut longest) = ([0.0; 3], 0.0);
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let (u, v) = (rows[i], rows[j]);
        let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = cross.iter().map(|x| x * x).sum::<f64>();
        if length > longest {
            (axis, longest) = (cross, length);
        }
    }
    if longest.sqrt() <= 1e-4 * p * p {
        return None;
    }
    let length = longest.sqrt();
    let values = [low.max(0.0), 3.0 * mean - low - high, high];
    Some((SVector::from_fn(|i, _| axis[i] / length), SVector::from_fn(|i, _| values[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn closed_form_agrees_with_jacobi(
            entries in prop::array::uniform9(-1.0..1.0f64),
            flat in prop_oneof![Just(0.0), Just(1e-6), Just(1e-2), Just(1.0)],
        ) {
            let basis = Matrix3::from_row_slice(&entries);
            let m = basis * Matrix3::from_diagonal(&Vector3::new(flat, 1.0, 2.0)) * basis.transpose();
            let (axis, values) = smallest_axis(&m);
            let (expected, vectors) = symmetric_eigen(&m);
            prop_assume!(expected[1] - expected[0] > 1e-6 * expected[2] && expected[2] > 1e-6);
            prop_assert!((values - expected.map(|v| v.max(0.0))).norm() < 1e-7 * expected[2]);
            let sine = axis.cross(&vectors.column(0)).norm();
            prop_assert!(sine < 1e-8 * expected[2] / (expected[1] - expected[0]), "{sine:e}");
        }
    }
}

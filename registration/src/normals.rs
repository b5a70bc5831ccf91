use nalgebra::{SMatrix, SVector};

use crate::Error;
use crate::error::check;
use crate::kd_tree::{KdTree, Neighbor};
use crate::linalg::symmetric_eigen;

/// Unit normals from the `neighbors` nearest points, turned towards `viewpoint`.
pub(crate) fn estimate<const D: usize>(
    points: &[SVector<f64, D>],
    tree: &KdTree<D>,
    neighbors: usize,
    viewpoint: &SVector<f64, D>,
) -> Result<Vec<SVector<f64, D>>, Error> {
    check("neighbors", neighbors as f64, neighbors >= D, "D or more")?;
    let mut found: Vec<Neighbor> = Vec::with_capacity(neighbors + 1);
    let mut normals = vec![SVector::zeros(); points.len()];
    // in tree order, so that consecutive queries touch the same leaves
    for &index in tree.order() {
        let point = &points[index as usize];
        tree.k_nearest_into(point, neighbors, &mut found);
        let scatter = scatter(points, point, &found);
        normals[index as usize] = towards(&normal_of(&scatter, viewpoint - point), &(viewpoint - point));
    }
    Ok(normals)
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
        fallback.try_normalize(0.0).unwrap_or_else(|| SVector::from_fn(|i, _| f64::from(u8::from(i == 0))))
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
        let half = 0.5 * (m[(0, 0)] - m[(1, 1)]);
        let radius = half.hypot(m[(0, 1)]);
        // the long axis has the angle ½ atan2(2 m01, m00 - m11)
        let (sin, cos) = (0.5 * m[(0, 1)].atan2(half)).sin_cos();
        let axis = SVector::from_fn(|i, _| if i == 0 { -sin } else { cos });
        let values = SVector::from_fn(|i, _| if i == 0 { (mean - radius).max(0.0) } else { mean + radius });
        return (axis, values);
    }
    let (values, vectors) = symmetric_eigen(m);
    (vectors.column(0).into_owned(), values.map(|v| v.max(0.0)))
}

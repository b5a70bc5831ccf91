use nalgebra::SMatrix;

use super::lifted::Point;
use crate::jacobi::eigenvectors;
use crate::nearest_rotation::{determinant, nearest_rotation};

/// The nearest poses: the `D` directions that hold most of the rotations, turned so that most are proper, and each
/// block projected onto the rotations.
pub(super) fn round<const D: usize, const M: usize>(point: &Point) -> Point {
    let r = point.rank;
    let (mut gram, mut directions) = (vec![0.0; r * r], vec![0.0; r * r]);
    for node in point.x.chunks_exact(M * r) {
        for row in node[..D * r].chunks_exact(r) {
            for (sums, x) in gram.chunks_exact_mut(r).zip(row) {
                sums.iter_mut().zip(row).for_each(|(sum, y)| *sum += x * y);
            }
        }
    }
    eigenvectors(&mut gram, &mut directions, r);
    let mut nodes: Vec<SMatrix<f64, M, D>> = Vec::with_capacity(point.x.len() / (M * r));
    for node in point.x.chunks_exact(M * r) {
        nodes
            .push(SMatrix::from_fn(|row, k| (0..r).map(|c| node[row * r + c] * directions[k * r + c]).sum()));
    }
    let rotation = |m: &SMatrix<f64, M, D>| m.fixed_view::<D, D>(0, 0).into_owned();
    let proper = |m: &SMatrix<f64, M, D>| determinant(&rotation(m)) > 0.0;
    if 2 * nodes.iter().filter(|m| proper(m)).count() < nodes.len() {
        nodes.iter_mut().for_each(|m| m.column_mut(0).neg_mut());
    }
    let mut x = Vec::with_capacity(nodes.len() * M * D);
    for node in &nodes {
        let rotation = nearest_rotation(&rotation(node));
        for row in 0..D {
            x.extend((0..D).map(|c| rotation[(row, c)]));
        }
        x.extend((0..D).map(|c| node[(D, c)]));
    }
    Point { x, rank: D }
}

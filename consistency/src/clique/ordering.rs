use super::rows::BitMatrix;
use crate::graph::degeneracy;

/// Vertices for a search that colours from the front and branches at the back: densest core first.
pub(super) fn core_first(matrix: &BitMatrix) -> Vec<usize> {
    let mut order = degeneracy(matrix).order;
    order.reverse();
    order
}

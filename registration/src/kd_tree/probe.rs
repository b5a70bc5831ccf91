use nalgebra::SVector;

use super::bounds::Bounds;
use super::leaf::{LEAF, Leaf};
use super::visitor::Visitor;

/// What is looked for on a walk through the tree.
pub(super) trait Probe<const D: usize> {
    /// The walk goes to its side of a cut first.
    fn guide(&self) -> &SVector<f64, D>;

    /// Whether a point inside may be wanted.
    fn may_want(&self, bounds: &Bounds<D>) -> bool;

    /// Whether nothing outside is wanted.
    fn is_settled_in(&self, cell: &Bounds<D>) -> bool;

    /// Takes what is wanted of a leaf.
    ///
    /// * `indices` – original indices of all points in tree order.
    fn scan(&mut self, leaf: &Leaf<D>, indices: &[u32]);
}

/// One query and its visitor.
pub(super) struct Single<'a, V, const D: usize> {
    pub(super) query: &'a SVector<f64, D>,
    pub(super) visitor: &'a mut V,
}

impl<V: Visitor, const D: usize> Probe<D> for Single<'_, V, D> {
    #[inline(always)]
    fn guide(&self) -> &SVector<f64, D> {
        self.query
    }

    #[inline(always)]
    fn may_want(&self, bounds: &Bounds<D>) -> bool {
        bounds.distance_sq(self.query) <= self.visitor.limit_sq()
    }

    #[inline(always)]
    fn is_settled_in(&self, cell: &Bounds<D>) -> bool {
        cell.encloses(self.query, self.visitor.limit_sq())
    }

    #[inline(always)]
    fn scan(&mut self, leaf: &Leaf<D>, indices: &[u32]) {
        let mut squares = [0.0; LEAF];
        for axis in 0..D {
            for (square, value) in squares.iter_mut().zip(&leaf.coordinates[axis]) {
                let d = value - self.query[axis];
                *square += d * d;
            }
        }
        let limit = self.visitor.limit_sq();
        if !squares.iter().fold(false, |any, square| any | (*square <= limit)) {
            return;
        }
        for (slot, &distance_sq) in squares.iter().enumerate() {
            if distance_sq <= self.visitor.limit_sq() {
                let position = leaf.begin as usize + slot;
                self.visitor.visit(position, indices[position], distance_sq);
            }
        }
    }
}

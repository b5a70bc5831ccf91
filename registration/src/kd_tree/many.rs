use nalgebra::SVector;
use pulp::{Arch, Simd, WithSimd};

use super::group::Group;
use super::tree::KdTree;

/// Raises an upper bound of a distance above its rounding.
const ROUNDING: f64 = 1.0 + 1e-9;

impl<const D: usize> KdTree<D> {
    /// Position and squared distance of the nearest point to each place, of equally near ones that of the lowest index.
    ///
    /// Fast when places that follow one another lie close together. The tree must not be empty.
    pub(crate) fn nearest_to_each(&self, places: &[SVector<f64, D>]) -> Vec<(u32, f64)> {
        Arch::new().dispatch(Many { tree: self, places })
    }
}

/// The places as one piece of work that is compiled for the processor's vectors.
struct Many<'a, const D: usize> {
    tree: &'a KdTree<D>,
    places: &'a [SVector<f64, D>],
}

/// The nearest and the next, which tells whether there is a tie.
type NearestTwo<S, const D: usize> = Group<S, D, 2>;

impl<const D: usize> WithSimd for Many<'_, D> {
    type Output = Vec<(u32, f64)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<(u32, f64)> {
        let mut found = Vec::with_capacity(self.places.len());
        let (mut place, mut reach, mut position) = (SVector::zeros(), f64::INFINITY, None);
        let mut limits = Vec::new();
        for places in self.places.chunks(NearestTwo::<S, D>::LANES) {
            limits.clear();
            // two points are known within `reach` of the last place
            limits.extend(places.iter().map(|p| ROUNDING * ((p - place).norm() + reach)));
            let mut group = NearestTwo::new(simd, places, &limits);
            self.tree.search_group(&mut group, position);
            for (lane, query) in places.iter().enumerate() {
                let ranks = group.ranks(lane);
                let [first, second] = ranks.squares;
                let nearest = if ranks.positions[1] != u32::MAX && first < second {
                    (ranks.positions[0], first)
                } else {
                    // a tie, one point alone, or far coordinates whose rounding made the limit too small
                    self.tree.nearest_from(query, 0)
                };
                found.push(nearest);
                (place, reach, position) = (*query, second.sqrt(), Some(nearest.0));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    /// Few values a coordinate, so that many points are equal or equally near.
    fn places(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        let value = prop_oneof![(-3..4i32).prop_map(f64::from), -3.0..3.0f64, Just(1e6)];
        prop::collection::vec([value.clone(), value.clone(), value].prop_map(Vector3::from), count)
    }

    proptest! {
        #[test]
        fn each_gets_its_nearest_by_brute_force(points in places(1..200), queries in places(0..60)) {
            let tree = KdTree::new(&points).unwrap();
            let found = tree.nearest_to_each(&queries);
            prop_assert_eq!(found.len(), queries.len());
            for (query, (position, distance_sq)) in queries.iter().zip(found) {
                let distance_to = |p: &Vector3<f64>| (p - query).norm_squared();
                let least = points.iter().map(distance_to).fold(f64::INFINITY, f64::min);
                let first = points.iter().position(|p| distance_to(p) == least).unwrap();
                prop_assert_eq!(tree.order()[position as usize] as usize, first);
                prop_assert_eq!(distance_sq, least);
            }
        }
    }
}

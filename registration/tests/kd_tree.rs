//! The tree against brute force, on inputs that trees are known to dislike.

use draco_registration::{KdTree, Neighbor};
use nalgebra::{SVector, Vector2, Vector3};
use proptest::prelude::*;

fn brute<const D: usize>(points: &[SVector<f64, D>], query: &SVector<f64, D>) -> Vec<Neighbor> {
    let mut all: Vec<_> = points
        .iter()
        .enumerate()
        .map(|(index, p)| Neighbor { index, distance_sq: (p - query).norm_squared() })
        .collect();
    all.sort_by(|a, b| a.distance_sq.total_cmp(&b.distance_sq).then(a.index.cmp(&b.index)));
    all
}

fn agrees<const D: usize>(points: &[SVector<f64, D>], query: &SVector<f64, D>, k: usize, radius: f64) {
    let tree = KdTree::new(points).unwrap();
    let expected = brute(points, query);
    assert_eq!(tree.nearest(query), expected.first().copied());
    assert_eq!(tree.k_nearest(query, k), expected[..k.min(points.len())]);
    let mut inside: Vec<_> = expected.iter().filter(|n| n.distance_sq <= radius * radius).copied().collect();
    inside.sort_by_key(|n| n.index);
    assert_eq!(tree.within(query, radius), inside);
    assert_eq!(tree.count_within(query, radius, usize::MAX), inside.len());
    let within = expected.first().filter(|n| n.distance_sq <= radius * radius);
    assert_eq!(tree.nearest_within(query, radius), within.copied());
}

/// Coordinates on a coarse grid (ties and duplicates), on a line, or anywhere.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![(-4i32..4).prop_map(f64::from), Just(2.5), -100.0..100.0f64]
}

proptest! {
    #[test]
    fn tree_agrees_with_brute_force_2d(
        points in prop::collection::vec((coordinate(), coordinate()), 0..200),
        query in (coordinate(), coordinate()),
        k in 0usize..20,
        radius in 0.0..50.0f64,
    ) {
        let points: Vec<_> = points.into_iter().map(|(x, y)| Vector2::new(x, y)).collect();
        agrees(&points, &Vector2::new(query.0, query.1), k, radius);
    }

    #[test]
    fn tree_agrees_with_brute_force_3d(
        points in prop::collection::vec((coordinate(), coordinate(), coordinate()), 0..200),
        query in (coordinate(), coordinate(), coordinate()),
        k in 0usize..20,
        radius in 0.0..50.0f64,
    ) {
        let points: Vec<_> = points.into_iter().map(|(x, y, z)| Vector3::new(x, y, z)).collect();
        agrees(&points, &Vector3::new(query.0, query.1, query.2), k, radius);
    }
}

#[test]
fn many_equal_points_are_fine() {
    let points = vec![Vector2::new(1.0, 1.0); 1000];
    agrees(&points, &Vector2::new(1.0, 1.0), 5, 0.0);
}

#[test]
fn not_a_number_is_an_error_that_names_the_point() {
    let error = KdTree::new(&[Vector2::zeros(), Vector2::new(0.0, f64::NAN)]).unwrap_err();
    assert_eq!(error.to_string(), "point 1 has a coordinate that is not a finite number");
}

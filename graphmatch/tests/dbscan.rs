//! DBSCAN against its definition, searched by brute force.

use draco_graphmatch::{Dbscan, Error, dbscan};
use nalgebra::Point2;
use proptest::prelude::*;

/// Cluster by cluster, from the smallest unlabelled core point, over an all-pairs neighbourhood.
fn by_definition(points: &[Point2<f64>], eps: f64, min_samples: usize) -> Vec<Option<usize>> {
    let near: Vec<Vec<usize>> = points
        .iter()
        .map(|a| {
            (0..points.len())
                .filter(|&j| {
                    let b = points[j];
                    (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) <= eps * eps
                })
                .collect()
        })
        .collect();
    let mut labels = vec![None; points.len()];
    let mut next = 0;
    for start in 0..points.len() {
        if labels[start].is_some() || near[start].len() < min_samples {
            continue;
        }
        let mut stack = vec![start];
        while let Some(p) = stack.pop() {
            if labels[p].is_none() {
                labels[p] = Some(next);
                if near[p].len() >= min_samples {
                    stack.extend(&near[p]);
                }
            }
        }
        next += 1;
    }
    labels
}

/// Free points, and points on a lattice of pitch `eps / 2` so that many distances equal `eps` exactly.
fn clouds() -> impl Strategy<Value = Vec<Point2<f64>>> {
    let free = (-4.0..4.0, -4.0..4.0).prop_map(|(x, y)| Point2::new(x, y));
    let lattice =
        (-8..8_i32, -8..8_i32).prop_map(|(x, y)| Point2::new(0.25 * f64::from(x), 0.25 * f64::from(y)));
    prop_oneof![prop::collection::vec(free, 0..120), prop::collection::vec(lattice, 0..120),]
}

proptest! {
    #[test]
    fn batch_labels_follow_the_definition(points in clouds(), min_samples in 1_usize..8) {
        prop_assert_eq!(dbscan(&points, 0.5, min_samples).unwrap(), by_definition(&points, 0.5, min_samples));
    }

    #[test]
    fn growing_cloud_has_the_labels_of_the_whole(points in clouds(), min_samples in 1_usize..8, step in 1_usize..40) {
        let mut clusters = Dbscan::new(0.5, min_samples).unwrap();
        for (k, chunk) in points.chunks(step).enumerate() {
            clusters.insert(chunk).unwrap();
            let seen = (k * step + chunk.len()).min(points.len());
            prop_assert_eq!(clusters.labels(), by_definition(&points[..seen], 0.5, min_samples));
        }
    }
}

#[test]
fn border_point_between_two_clusters_joins_the_smaller_number() {
    // The point at 2.6 reaches one end of either side: three neighbours with itself, so it is no core point.
    let x = [5.0, 5.1, 5.2, 5.3, 0.2, 0.1, 0.0, -0.1, 2.6];
    let points: Vec<_> = x.iter().map(|&x| Point2::new(x, 0.0)).collect();
    let labels = dbscan(&points, 2.41, 4).unwrap();
    assert_eq!(labels, [0, 0, 0, 0, 1, 1, 1, 1, 0].map(Some));
}

#[test]
fn wrong_input_is_named() {
    let nan = [Point2::origin(), Point2::new(f64::NAN, 0.0)];
    assert_eq!(dbscan(&nan, 1.0, 2), Err(Error::NonFinitePoint { what: "points", index: 1 }));
    assert!(matches!(dbscan(&[], 0.0, 2), Err(Error::BadParameter { name: "eps", .. })));
    assert!(matches!(dbscan(&[], 1.0, 0), Err(Error::BadParameter { name: "min_samples", .. })));
    let far = [Point2::new(1e300, 0.0)];
    assert!(matches!(dbscan(&far, 1e-3, 2), Err(Error::BadParameter { name: "eps", .. })));
    let mut clusters = Dbscan::new(1.0, 2).unwrap();
    assert!(clusters.insert(&nan).is_err());
    assert!(clusters.points().is_empty());
}

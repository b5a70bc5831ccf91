//! The matcher's promises: copies match whole, frames and orders do not matter, repeated structure is not trusted.

mod support;

use draco_graphmatch::{
    AsCodedParams, ConsensusParams, Method, NoSimilarity, Object, Pair, Verdict, as_coded, consensus,
    match_objects,
};
use nalgebra::{Isometry2, Point2, Vector2};
use proptest::prelude::*;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use support::{objects, scatter, seen_from};

fn frames() -> impl Strategy<Value = Isometry2<f64>> {
    let angle = prop_oneof![
        Just(0.0),
        Just(std::f64::consts::PI),
        Just(-std::f64::consts::PI),
        -3.2..3.2,
        -1e-6..1e-6,
    ];
    (-60.0..60.0, -60.0..60.0, angle).prop_map(|(x, y, angle)| Isometry2::new(Vector2::new(x, y), angle))
}

fn difference(a: &Isometry2<f64>, b: &Isometry2<f64>) -> f64 {
    (a.inverse() * b).translation.vector.norm() + a.rotation.angle_to(&b.rotation).abs()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn noise_free_copies_match_whole(n in 5..40_usize, seed in any::<u64>(), frame in frames()) {
        let map1 = objects(&scatter(n, seed), seed);
        let map2 = seen_from(&map1, &frame, 0.0, 0);
        let whole: Vec<Pair> = (0..n).map(|k| Pair { first: k, second: k }).collect();
        for found in [
            match_objects(&map1, &map2, &Method::default()).unwrap(),
            consensus(&map1, &map2, &NoSimilarity, &ConsensusParams::default()).unwrap(),
        ] {
            prop_assert_eq!(&found.pairs, &whole);
            prop_assert_eq!(found.verdict, Verdict::Unique);
            prop_assert!(difference(found.map1_from_map2.unwrap().mean(), &frame) < 1e-9);
        }
        let mended = AsCodedParams {
            zero_difference_flaw: false, scaled_translation_flaw: false, ..AsCodedParams::default()
        };
        let found = as_coded(&map1, &map2, &mended).unwrap();
        prop_assert_eq!(&found.pairs, &whole);
    }

    /// Moving map 2 moves the transform with it, and nothing else.
    #[test]
    fn moving_a_map_moves_the_transform(n in 6..25_usize, seed in any::<u64>(), by in frames()) {
        let points = scatter(n + 6, seed);
        let map1 = objects(&points[..n], seed);
        let map2 = seen_from(&objects(&points[..n], seed)[2..], &Isometry2::identity(), 0.2, seed);
        let moved = seen_from(&map2, &by, 0.0, 0);
        let params = ConsensusParams::default();
        let first = consensus(&map1, &map2, &NoSimilarity, &params).unwrap();
        let second = consensus(&map1, &moved, &NoSimilarity, &params).unwrap();
        prop_assert_eq!(&first.pairs, &second.pairs);
        prop_assert_eq!(first.verdict, second.verdict);
        let expected = first.map1_from_map2.unwrap().mean() * by;
        prop_assert!(difference(second.map1_from_map2.unwrap().mean(), &expected) < 1e-6);
    }

    #[test]
    fn order_of_objects_does_not_matter(n in 6..25_usize, seed in any::<u64>()) {
        let map1 = objects(&scatter(n, seed), seed);
        let map2 = seen_from(&map1[..n - 1], &Isometry2::new(Vector2::new(3.0, -4.0), 1.0), 0.2, seed);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut shuffle = |map: &[Object]| -> (Vec<usize>, Vec<Object>) {
            let mut order: Vec<usize> = (0..map.len()).collect();
            order.shuffle(&mut rng);
            let shuffled = order.iter().map(|&k| map[k]).collect();
            (order, shuffled)
        };
        let ((order1, shuffled1), (order2, shuffled2)) = (shuffle(&map1), shuffle(&map2));
        let first = match_objects(&map1, &map2, &Method::default()).unwrap();
        let second = match_objects(&shuffled1, &shuffled2, &Method::default()).unwrap();
        let mut back: Vec<Pair> = second
            .pairs
            .iter()
            .map(|p| Pair { first: order1[p.first], second: order2[p.second] })
            .collect();
        back.sort();
        prop_assert_eq!(&first.pairs, &back);
        prop_assert_eq!(first.verdict, second.verdict);
    }

    /// Metres are as good as feet: lengths, noise and the mode's size scale together.
    #[test]
    fn scaling_everything_changes_nothing(n in 6..25_usize, seed in any::<u64>(), power in -3..4_i32) {
        let scale = 2_f64.powi(power);
        let map1 = objects(&scatter(n, seed), seed);
        let map2 = seen_from(&map1[2..], &Isometry2::new(Vector2::new(3.0, -4.0), 1.0), 0.3, seed);
        let scaled = |map: &[Object]| -> Vec<Object> {
            map.iter()
                .map(|o| Object::new(Point2::from(o.centroid.coords * scale), o.length * scale, o.breadth * scale))
                .collect()
        };
        let params = ConsensusParams::default();
        let larger = ConsensusParams {
            position_sigma: params.position_sigma * scale,
            shape_sigma: params.shape_sigma * scale,
            min_edge: params.min_edge * scale,
            mode_distance: params.mode_distance * scale,
            ..params.clone()
        };
        let first = match_objects(&map1, &map2, &Method::Consensus(params)).unwrap();
        let second = match_objects(&scaled(&map1), &scaled(&map2), &Method::Consensus(larger)).unwrap();
        prop_assert_eq!(&first.pairs, &second.pairs);
        prop_assert_eq!(first.verdict, second.verdict);
    }

    #[test]
    fn any_maps_give_an_answer_and_twice_the_same(
        map1 in prop::collection::vec((-9.0..9.0, -9.0..9.0), 0..12),
        map2 in prop::collection::vec((-9..9_i32, 0..2_i32), 0..12),
    ) {
        let map1: Vec<_> = map1.iter().map(|&(x, y)| Object::new(Point2::new(x, y), 1.0, 1.0)).collect();
        let map2: Vec<_> =
            map2.iter().map(|&(x, y)| Object::new(Point2::new(f64::from(x), f64::from(y)), 1.0, 1.0)).collect();
        let answer = || match_objects(&map1, &map2, &Method::default()).unwrap();
        prop_assert_eq!(answer(), answer());
        as_coded(&map1, &map2, &AsCodedParams::default()).unwrap();
    }
}

#[test]
fn flaw_of_the_published_code_spoils_identical_maps() {
    let map = objects(&scatter(12, 4), 4);
    let right = |params: &AsCodedParams| {
        as_coded(&map, &map, params).unwrap().pairs.iter().filter(|p| p.first == p.second).count()
    };
    let places_only = AsCodedParams { mu_shape: 0.0, ..AsCodedParams::default() };
    assert_eq!(right(&AsCodedParams { zero_difference_flaw: false, ..places_only.clone() }), 12);
    let flawed = right(&places_only);
    assert!(flawed < 12, "{flawed} of 12 right in spite of the flaw");
}

#[test]
fn unrelated_maps_are_seldom_called_unique() {
    let params = ConsensusParams::default();
    let trials = 60;
    let unique = (0..trials)
        .filter(|&seed| {
            let map1 = objects(&scatter(15, seed), 1);
            let map2 = objects(&scatter(15, 1000 + seed), 2);
            consensus(&map1, &map2, &NoSimilarity, &params).unwrap().verdict == Verdict::Unique
        })
        .count();
    assert!(unique * 20 <= trials as usize * 3, "{unique} of {trials} unrelated maps called unique");
}

#[test]
fn rows_of_equal_pilings_are_ambiguous() {
    let lattice = |from: usize| -> Vec<Object> {
        (from..from + 5)
            .flat_map(|x| (0..3).map(move |y| Point2::new(6.0 * x as f64, 6.0 * y as f64)))
            .map(|p| Object::new(p, 3.0, 3.0))
            .collect()
    };
    let map2 = seen_from(&lattice(1), &Isometry2::new(Vector2::new(9.0, 2.0), -2.0), 0.1, 3);
    let found = match_objects(&lattice(0), &map2, &Method::default()).unwrap();
    assert_eq!(found.verdict, Verdict::Ambiguous);
    assert!(found.modes.len() >= 3, "{} modes", found.modes.len());
}

/// Two pilings and a buoy in common fix the transform, but other turns about the buoy bring two pilings together as well:
/// that the rows go on from map to map decides.
#[test]
fn rows_of_pilings_go_on_beyond_the_maps() {
    use rand::RngExt;
    use rand_distr::{Distribution, Normal};
    let noise = Normal::new(0.0, 0.2).unwrap();
    let truth = Isometry2::new(Vector2::new(12.0, -7.0), 2.5);
    let trials = 100;
    let right = (0..trials).filter(|&seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let buoy = Point2::new(rng.random_range(18.0..24.0), rng.random_range(14.0..24.0));
        let mut map = |from: usize, sigma: f64| -> Vec<Object> {
            let pilings = (from..from + 4).flat_map(|x| [0.0, 6.0].map(|y| Point2::new(6.0 * x as f64, y)));
            let mut seen: Vec<Object> = pilings.map(|p| Object::new(p, 3.0, 3.0)).collect();
            seen.push(Object::new(buoy, 7.0, 4.0));
            for o in &mut seen {
                let mut jitter = || sigma / 0.2 * noise.sample(&mut rng);
                o.centroid += Vector2::new(jitter(), jitter());
                (o.length, o.breadth) = (o.length + jitter(), o.breadth + jitter());
            }
            seen
        };
        let map1 = map(0, 0.0);
        let map2 = seen_from(&map(3, 0.2), &truth, 0.0, 0);
        let found = match_objects(&map1, &map2, &Method::default()).unwrap();
        found.map1_from_map2.is_some_and(|found| {
            let off = |p: Point2<f64>| (found.mean() * truth.inverse_transform_point(&p) - p).norm();
            [Point2::new(18.0, 0.0), Point2::new(18.0, 6.0), buoy].into_iter().all(|p| off(p) < 1.0)
        })
    });
    let right = right.count();
    assert!(right >= 96, "{right} of {trials} right");
}

/// Both maps cover one area of 25 m; four of the ten objects of each are the same.
#[test]
fn four_of_ten_in_common_are_found_or_doubted() {
    use rand_distr::{Distribution, Normal};
    let noise = Normal::new(0.0, 0.2).unwrap();
    let truth = Isometry2::new(Vector2::new(12.0, -7.0), 2.5);
    let params = ConsensusParams::default();
    let (trials, mut right, mut trusted_wrongly) = (400, 0, 0);
    for seed in 0..trials {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let places1 = scatter(10, seed);
        let common = &places1[..4];
        let others = scatter(10, 1_000_000 + seed).into_iter();
        let free = others.filter(|p| common.iter().all(|q| (p - q).norm() >= 3.0));
        let places2: Vec<_> = common.iter().copied().chain(free.take(6)).collect();
        let mut map2 = seen_from(&objects(&places2, 2), &truth, 0.0, 0);
        for o in &mut map2 {
            o.centroid += Vector2::new(noise.sample(&mut rng), noise.sample(&mut rng));
        }
        let found = consensus(&objects(&places1, 1), &map2, &NoSimilarity, &params).unwrap();
        let off =
            |p: &Point2<f64>, t: &Isometry2<f64>| (t * truth.inverse_transform_point(p) - p).norm_squared();
        let is_right = found
            .map1_from_map2
            .is_some_and(|t| (common.iter().map(|p| off(p, t.mean())).sum::<f64>() / 4.0).sqrt() < 1.0);
        right += u64::from(is_right);
        trusted_wrongly += u64::from(!is_right && found.verdict == Verdict::Unique);
    }
    // Measured on 2,400 other problems: 0.96 and 0.007, each with a standard deviation below 0.01 in 400.
    assert!(right * 100 >= trials * 93, "{right} of {trials} right");
    assert!(trusted_wrongly * 100 <= trials * 2, "{trusted_wrongly} of {trials} wrong but Unique");
}

#[test]
fn covariance_of_the_transform_matches_repeated_noise() {
    use rand_distr::{Distribution, Normal};
    let map1 = objects(&scatter(14, 8), 8);
    let truth = Isometry2::new(Vector2::new(12.0, -7.0), 2.5);
    let noise = Normal::new(0.0, 0.2).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let trials = 400;
    let mut sum = 0.0;
    for _ in 0..trials {
        let map2: Vec<Object> = seen_from(&map1, &truth, 0.0, 0)
            .into_iter()
            .map(|o| Object {
                centroid: Point2::new(
                    o.centroid.x + noise.sample(&mut rng),
                    o.centroid.y + noise.sample(&mut rng),
                ),
                ..o
            })
            .collect();
        let found = match_objects(&map1, &map2, &Method::default()).unwrap().map1_from_map2.unwrap();
        sum += found.mahalanobis_sq(&truth).unwrap();
    }
    // The mean of a χ² of 3 degrees over 400 trials has a deviation of 0.12.
    let mean = sum / f64::from(trials);
    assert!((2.4..3.6).contains(&mean), "mean squared Mahalanobis distance {mean}");
}

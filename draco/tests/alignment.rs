//! Map-to-map alignment: what is there is found, what cannot be told apart is left open.

use std::collections::BTreeSet;

use draco::alignment::{AlignmentParams, Opinion, OwnMap, Verdict, align, consensus};
use draco::message::CellMap;
use nalgebra::{Isometry2, Point2, Vector2};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Metres; the persistent cells of a mission have this size.
const CELL: f64 = 2.0;

fn cell(point: &Point2<f64>) -> [i32; 2] {
    [(point.x / CELL).floor() as i32, (point.y / CELL).floor() as i32]
}

/// The map that a robot with this frame makes of points of the world.
fn map(world: &[Point2<f64>], world_from_map: &Isometry2<f64>) -> CellMap {
    let cells: BTreeSet<[i32; 2]> = world.iter().map(|p| cell(&(world_from_map.inverse() * p))).collect();
    CellMap { size: CELL, keyframes: 20, cells: cells.into_iter().collect() }
}

fn own(cells: CellMap) -> OwnMap {
    OwnMap { cells, free: BTreeSet::new() }
}

/// Straight walls of random place, length and heading in a square of `2 half` metres.
fn walls(count: usize, half: f64, rng: &mut impl Rng) -> Vec<Point2<f64>> {
    let mut points = Vec::new();
    for _ in 0..count {
        let start = Point2::new(rng.random_range(-half..half), rng.random_range(-half..half));
        let heading: f64 = rng.random_range(-3.1..3.1);
        let length: f64 = rng.random_range(6.0..25.0);
        let direction = Vector2::new(heading.cos(), heading.sin());
        points.extend((0..(length / 0.5) as usize).map(|k| start + direction * (0.5 * k as f64)));
    }
    points
}

fn frame(rng: &mut impl Rng) -> Isometry2<f64> {
    let offset = Vector2::new(rng.random_range(-80.0..80.0), rng.random_range(-80.0..80.0));
    Isometry2::new(offset, rng.random_range(-3.1..3.1))
}

fn noisy(points: &[Point2<f64>], rng: &mut impl Rng) -> Vec<Point2<f64>> {
    let mut shifted =
        |p: &Point2<f64>| p + Vector2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
    points.iter().map(&mut shifted).collect()
}

/// Row `r` of the piles at the given columns, 8 m apart in both directions.
fn piles(rows: std::ops::Range<i32>, columns: impl Fn(i32) -> std::ops::Range<i32>) -> Vec<Point2<f64>> {
    let at = |r: i32, c: i32| Point2::new(8.0 * f64::from(c) + 1.0, 8.0 * f64::from(r) + 1.0);
    rows.flat_map(|r| columns(r).map(move |c| at(r, c)).collect::<Vec<_>>()).collect()
}

#[test]
fn known_transforms_are_found_from_any_frame() {
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let world = walls(16, 40.0, &mut rng);
        // Each robot has seen a part of its own: the east and the west of the site, the middle third shared.
        let part = |keep: fn(f64) -> bool| world.iter().filter(|p| keep(p.x)).copied().collect::<Vec<_>>();
        let (east, west) = (part(|x| x > -25.0), part(|x| x < 25.0));
        let (world_from_own, world_from_partner) = (frame(&mut rng), frame(&mut rng));
        let mine = own(map(&noisy(&east, &mut rng), &world_from_own));
        let theirs = map(&noisy(&west, &mut rng), &world_from_partner);
        let truth = world_from_own.inv_mul(&world_from_partner);
        let verdict = align(&mine, &theirs, &AlignmentParams::default()).expect("valid maps");
        let Verdict::Clear(mode) = verdict else { panic!("seed {seed}: {verdict:?}") };
        let middle = theirs.middle();
        let distance = (mode.target_from_source * middle - truth * middle).norm();
        let turn = mode.target_from_source.rotation.angle_to(&truth.rotation).abs().to_degrees();
        println!("seed {seed}: {distance:.2} m, {turn:.2} deg, score {:.2}", mode.score);
        assert!(distance < 1.5 && turn < 3.0, "seed {seed}: {distance} m, {turn} deg");
    }
}

#[test]
fn regular_piles_are_never_a_clear_fit() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for trial in 0..8 {
        let all = piles(0..9, |_| 0..14);
        let seen = piles(1..8, |_| 3..11);
        let theirs = map(&noisy(&seen, &mut rng), &frame(&mut rng));
        let mine = own(map(&noisy(&all, &mut rng), &Isometry2::identity()));
        let verdict = align(&mine, &theirs, &AlignmentParams::default()).expect("valid maps");
        println!("trial {trial}: {verdict:?}");
        assert!(!matches!(verdict, Verdict::Clear(_)), "trial {trial}: {verdict:?}");
    }
}

#[test]
fn free_space_breaks_a_lattice_tie() {
    // The own robot knows the western seven columns and that there is open water west of them. The partner knows
    // columns that go on to the east, further in each row, so that only a turned map could take their place.
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for trial in 0..6 {
        let known = piles(0..6, |_| 0..7);
        let longer = piles(0..6, |r| 0..7 + r);
        let truth = frame(&mut rng);
        let theirs = map(&noisy(&longer, &mut rng), &truth);
        let mut mine = own(map(&noisy(&known, &mut rng), &Isometry2::identity()));
        let without = align(&mine, &theirs, &AlignmentParams::default()).expect("valid maps");
        assert!(!matches!(without, Verdict::Clear(_)), "trial {trial}, without free space: {without:?}");
        mine.free = (-30..-1).flat_map(|i| (-20..44).map(move |j| [i, j])).collect();
        let with = align(&mine, &theirs, &AlignmentParams::default()).expect("valid maps");
        let Verdict::Clear(mode) = with else { panic!("trial {trial}, with free space: {with:?}") };
        let middle = theirs.middle();
        let distance = (mode.target_from_source * middle - truth * middle).norm();
        assert!(distance < 2.0, "trial {trial}: {distance} m");
    }
}

#[test]
fn maps_of_different_places_do_not_fit_three_times_running() {
    let params = AlignmentParams::default();
    let (mut clear, mut lasting, trials) = (0, 0, 24);
    for seed in 0..trials {
        let mut rng = ChaCha8Rng::seed_from_u64(100 + seed);
        let (here, there) = (walls(24, 45.0, &mut rng), walls(24, 45.0, &mut rng));
        let (mine, theirs) = (frame(&mut rng), frame(&mut rng));
        let mut answers = Vec::new();
        for share in [0.6, 0.8, 1.0] {
            let part = |world: &[Point2<f64>]| world[..(share * world.len() as f64) as usize].to_vec();
            let partner = map(&part(&there), &theirs);
            let verdict = align(&own(map(&part(&here), &mine)), &partner, &params).expect("valid maps");
            if let Verdict::Clear(mode) = verdict {
                answers.push((mode.target_from_source, partner.middle()));
            }
        }
        clear += answers.len();
        let same = answers.windows(2).all(|pair| params.same(&pair[0].0, &pair[1].0, &pair[1].1));
        lasting += usize::from(answers.len() >= params.min_streak && same);
    }
    println!("{clear} of {} attempts clear, {lasting} of {trials} pairs three times the same", 3 * trials);
    assert_eq!(lasting, 0);
}

#[test]
fn too_small_maps_are_not_compared() {
    let few = map(&piles(0..3, |_| 0..13), &Isometry2::identity());
    assert_eq!(few.cells.len(), 39);
    let many = map(&piles(0..6, |_| 0..13), &Isometry2::identity());
    for (mine, theirs) in [(&few, &many), (&many, &few)] {
        let verdict = align(&own(mine.clone()), theirs, &AlignmentParams::default()).expect("valid maps");
        assert_eq!(verdict, Verdict::None);
    }
}

#[test]
fn a_wrong_opinion_is_outvoted_whoever_holds_it() {
    // Four maps at random places; every ordered pair of robots has an opinion, one of which is wrong by 20 m.
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let world_from: Vec<_> = (0..4).map(|_| frame(&mut rng)).collect();
    let mut opinions = Vec::new();
    for a in 0..4_u32 {
        for b in (0..4_u32).filter(|&b| b != a) {
            let a_from_b = world_from[a as usize].inv_mul(&world_from[b as usize]);
            opinions.push(Opinion { holder: a, a, b, a_from_b, middle: Point2::new(10.0, -5.0) });
        }
    }
    let params = AlignmentParams::default();
    assert!(consensus(&opinions, &params).iter().all(|&kept| kept), "all of them are right");
    for wrong in 0..opinions.len() {
        let mut disturbed = opinions.clone();
        disturbed[wrong].a_from_b.translation.x += 20.0;
        let kept = consensus(&disturbed, &params);
        let expected: Vec<bool> = (0..opinions.len()).map(|index| index != wrong).collect();
        assert_eq!(kept, expected, "opinion {wrong}");
    }
}

#[test]
fn a_lattice_that_half_a_turn_maps_onto_itself_is_never_a_clear_fit() {
    // three rows of eight groups of four piles, as in the harbor: seen whole by both robots, and by nothing else
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let corners = [(-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8)];
    let group = |r: i32, c: i32| {
        corners.map(|(x, y)| Point2::new(6.0 * f64::from(c) - 21.0 + x, 8.0 * f64::from(r) - 8.0 + y))
    };
    let world: Vec<_> = (0..3).flat_map(|r| (0..8).flat_map(move |c| group(r, c))).collect();
    for trial in 0..8 {
        let mine = own(map(&noisy(&world, &mut rng), &frame(&mut rng)));
        let theirs = map(&noisy(&world, &mut rng), &frame(&mut rng));
        let verdict = align(&mine, &theirs, &AlignmentParams::default()).expect("valid maps");
        println!("trial {trial}: {verdict:?}");
        assert!(!matches!(verdict, Verdict::Clear(_)), "trial {trial}: {verdict:?}");
    }
}

//! Objects found in simulated maps are the ones that stand there.

use std::collections::BTreeMap;

use draco::objects::{Object, ObjectParams, ObjectTracks, extract};
use draco::simulate::{Scenario, SimulationParams, simulate};
use nalgebra::Point2;

/// Objects of robot 1's map drawn at its true poses, after `keyframes` keyframes.
fn objects(scenario: Scenario, keyframes: usize, params: &ObjectParams) -> Vec<Object> {
    let mission = simulate(&SimulationParams { scenario, keyframes: Some(keyframes), ..Default::default() });
    let recording = mission.expect("defaults are valid").recordings.remove(0);
    let poses: Vec<_> = recording.truth.iter().flatten().copied().collect();
    extract(&recording.keyframes, &poses, params).expect("valid")
}

#[test]
fn pilings_and_hulls_of_the_harbor_are_found_where_they_stand() {
    let found = objects(Scenario::Harbor, 61, &ObjectParams::default());
    println!("{:?}", found.iter().map(|o| (o.length * 10.0).round() / 10.0).collect::<Vec<_>>());
    let world = Scenario::Harbor.world(0);
    // The eastern half of the pilings stands well inside robot 1's path.
    for row in [-8.0, 0.0, 8.0] {
        for column in [3.0, 9.0, 15.0, 21.0] {
            let middle = Point2::new(column, row);
            let nearest = found.iter().map(|object| (object.centroid - middle).norm());
            assert!(nearest.fold(f64::INFINITY, f64::min) < 0.8, "no object near {middle}");
        }
    }
    for object in &found {
        assert!(world.clearance(&object.centroid) < 2.5, "nothing stands near {}", object.centroid);
        assert!(object.length <= 10.0 + 1e-9 && object.keyframes.len() >= 2);
        assert!(object.covariance.cholesky().is_some());
    }
}

#[test]
fn the_published_setting_keeps_the_quay_whole() {
    let whole = objects(Scenario::Harbor, 61, &ObjectParams::published());
    let longest = whole.iter().map(|object| object.length).fold(0.0, f64::max);
    assert!(longest > 20.0, "longest is {longest} m");
}

#[test]
fn numbers_of_objects_last_as_the_map_grows() {
    let mut tracks = ObjectTracks::default();
    let mut where_is: BTreeMap<u32, Point2<f64>> = BTreeMap::new();
    let (mut kept, mut seen) = (0, 0);
    for keyframes in 20..61 {
        let mut found = objects(Scenario::Harbor, keyframes, &ObjectParams::default());
        tracks.update(&mut found);
        let mut ids: Vec<_> = found.iter().map(|object| object.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), found.len(), "numbers are unique");
        for object in &found {
            if let Some(before) = where_is.insert(object.id, object.centroid) {
                assert!((before - object.centroid).norm() <= 3.0);
                kept += 1;
            }
            seen += 1;
        }
    }
    assert!(f64::from(kept) > 0.9 * f64::from(seen), "{kept} of {seen}");
}

#[test]
fn what_moves_is_no_object() {
    let params = SimulationParams { movers: 8, seed: 3, ..SimulationParams::default() };
    let (mut ghosts, mut kept) = ([0, 0], [0, 0]);
    let mission = simulate(&params).expect("valid");
    let world = params.scenario.world(params.seed);
    for recording in &mission.recordings {
        let poses: Vec<_> = recording.truth.iter().flatten().copied().collect();
        for (at, drop_moving) in [false, true].into_iter().enumerate() {
            let params = ObjectParams { drop_moving, ..ObjectParams::default() };
            let found = extract(&recording.keyframes, &poses, &params).expect("valid");
            let stands = |object: &&Object| world.clearance(&object.centroid) < 2.5;
            kept[at] += found.iter().filter(stands).count();
            ghosts[at] += found.len() - found.iter().filter(stands).count();
        }
    }
    println!("{ghosts:?} ghosts, {kept:?} that stand");
    assert!(ghosts[0] >= 4, "too few vehicles were seen to tell: {ghosts:?}");
    assert!(3 * ghosts[1] <= ghosts[0], "{ghosts:?}");
    assert!(10 * kept[1] >= 9 * kept[0], "{kept:?}");
}

//! Simulated missions keep the promises of their scenarios.

use draco::evaluate::absolute_trajectory_error;
use draco::keyframe::MissionData;
use draco::simulate::{Scenario, SimulationParams, simulate, visited_overlap};
use nalgebra::Point2;

fn mission(scenario: Scenario, seed: u64) -> MissionData {
    simulate(&SimulationParams { scenario, seed, ..SimulationParams::default() }).expect("defaults are valid")
}

#[test]
fn equal_seeds_give_equal_missions_and_others_do_not() {
    for scenario in Scenario::ALL {
        let first = mission(scenario, 3);
        assert_eq!(first, mission(scenario, 3));
        assert_ne!(first, mission(scenario, 4));
    }
}

#[test]
fn robots_record_the_keyframes_their_scenario_promises() {
    for scenario in Scenario::ALL {
        for recording in mission(scenario, 0).recordings {
            assert_eq!(recording.keyframes.len(), scenario.keyframes(), "robot {}", recording.robot);
            assert_eq!(recording.truth.iter().flatten().count(), scenario.keyframes());
            assert!(recording.keyframes.windows(2).all(|pair| pair[1].time > pair[0].time));
        }
    }
}

#[test]
fn no_vehicle_comes_within_a_metre_of_a_surface() {
    for scenario in Scenario::ALL {
        for seed in 0..5 {
            let world = scenario.world(seed);
            for recording in mission(scenario, seed).recordings {
                for (index, pose) in recording.truth.iter().flatten().enumerate() {
                    let clearance = world.clearance(&Point2::from(pose.translation.vector));
                    assert!(
                        clearance > 1.0,
                        "{scenario:?} robot {} keyframe {index}: {clearance} m",
                        recording.robot
                    );
                }
            }
        }
    }
}

#[test]
fn any_two_robots_share_a_third_to_a_half_of_the_ground_they_see() {
    for scenario in Scenario::ALL {
        let recordings = mission(scenario, 0).recordings;
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let overlap = visited_overlap(&recordings[a], &recordings[b], 15.0, 120.0_f64.to_radians());
            println!("{scenario:?} {a}{b} {overlap}");
            assert!((0.35..=0.50).contains(&overlap), "{scenario:?}, robots {a} and {b}: {overlap}");
        }
    }
}

#[test]
fn scans_drawn_at_true_poses_lie_on_the_world() {
    for scenario in Scenario::ALL {
        let world = scenario.world(1);
        let (mut near, mut all) = (0_usize, 0_usize);
        for recording in mission(scenario, 1).recordings {
            for (keyframe, truth) in recording.keyframes.iter().zip(recording.truth.iter().flatten()) {
                all += keyframe.points.len();
                near +=
                    keyframe.points.iter().filter(|point| world.clearance(&(truth * **point)) < 0.3).count();
            }
        }
        println!("{scenario:?}: {all} points, {near} near");
        assert!(near as f64 > 0.9 * all as f64, "{near} of {all} points are within 0.3 m of a surface");
    }
}

/// Marginals of the published system's logs: about 0.6 m and 0.043 rad after ten keyframes.
#[test]
fn dead_reckoning_drifts_as_the_published_logs_do() {
    let (mut position_sq, mut heading_sq, mut count, mut whole) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..20 {
        let params = SimulationParams { seed, ..SimulationParams::default() };
        for recording in simulate(&params).expect("defaults are valid").recordings {
            let (first, tenth) = (recording.truth[0].expect("known"), recording.truth[10].expect("known"));
            let error = first.inv_mul(&tenth).inv_mul(&recording.keyframes[10].odometry);
            position_sq += error.translation.vector.norm_squared() / 2.0;
            heading_sq += error.rotation.angle().powi(2);
            count += 1.0;
            let odometry = recording.keyframes.iter().map(|keyframe| &keyframe.odometry);
            whole += absolute_trajectory_error(odometry, &recording.truth).expect("truth").rmse_m;
        }
    }
    let (position, heading) = ((position_sq / count).sqrt(), f64::sqrt(heading_sq / count));
    println!("{position} m, {heading} rad, ATE {}", whole / count);
    assert!((0.4..0.8).contains(&position), "{position} m an axis");
    assert!((0.035..0.055).contains(&heading), "{heading} rad");
}

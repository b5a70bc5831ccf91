//! Each robot's own map, keyframe by keyframe and without the others, on the real recording and in the scenarios.

use std::path::PathBuf;

use draco::dataset::read_keyframe_folder;
use draco::evaluate::absolute_trajectory_error;
use draco::keyframe::MissionData;
use draco::local_slam::{FactorKind, LocalSlam, LocalSlamParams};
use draco::simulate::{Scenario, SimulationParams, simulate};
use draco_lie::LieGroup;

/// Metres, of every robot alone.
const BAR: f64 = 2.0;

fn recording() -> Option<MissionData> {
    let data = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let folder = data.join("sonar/aracati2017");
    if folder.is_dir() {
        return Some(read_keyframe_folder(&folder).expect("the recording is well formed"));
    }
    let required = std::env::var_os("DRACO_REQUIRE_DATA").is_some_and(|value| value == "1");
    assert!(!required, "no data at {}", folder.display());
    println!("skipped: no data at {}", folder.display());
    None
}

#[test]
fn every_robot_alone_stays_below_the_bar_on_the_real_recording() {
    let Some(data) = recording() else { return };
    for recording in data.recordings {
        let mut slam = LocalSlam::new(LocalSlamParams::default());
        for keyframe in &recording.keyframes {
            slam.add(keyframe.clone()).expect("the recording is in order");
        }
        assert_eq!(slam.poses().len(), recording.keyframes.len(), "robot {}", recording.robot);
        let odometry = recording.keyframes.iter().map(|keyframe| &keyframe.odometry);
        let drift = absolute_trajectory_error(odometry, &recording.truth).expect("truth").rmse_m;
        let error = absolute_trajectory_error(slam.poses(), &recording.truth).expect("truth");
        let loops = slam
            .factors()
            .expect("a sound map")
            .iter()
            .filter(|factor| factor.kind == FactorKind::Loop)
            .count();
        println!(
            "robot {}: {:.2} m (dead reckoning {drift:.2} m), {loops} loops, odometry scale {:.3}",
            recording.robot,
            error.rmse_m,
            slam.odometry_scale()
        );
        assert!(error.count > 50, "robot {}: only {} keyframes have a truth", recording.robot, error.count);
        assert!(error.rmse_m < BAR, "robot {}: {} m", recording.robot, error.rmse_m);
        assert!(error.rmse_m < drift, "robot {}: dead reckoning alone has {drift} m", recording.robot);
    }
}

/// Root mean square of how far a robot's keyframes are turned from the one eight before, beyond the truth, radians.
fn bend(data: &MissionData, params: &LocalSlamParams) -> f64 {
    const APART: usize = 8;
    let (mut sum, mut count) = (0.0, 0.0);
    for recording in &data.recordings {
        let mut slam = LocalSlam::new(params.clone());
        for keyframe in &recording.keyframes {
            slam.add(keyframe.clone()).expect("the scenario is in order");
        }
        for (k, pose) in slam.poses().iter().enumerate().skip(APART) {
            let (Some(from), Some(to)) = (recording.truth[k - APART], recording.truth[k]) else { continue };
            let found = slam.poses()[k - APART].between(pose);
            sum += from.between(&to).between(&found).rotation.angle().powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

#[test]
fn submaps_held_to_the_ones_before_bend_a_map_less() {
    let plain = {
        let mut params = LocalSlamParams::default();
        params.loops.submaps_before = 0;
        params
    };
    let (mut with, mut without) = (0.0, 0.0);
    for seed in 0..3 {
        let simulation = SimulationParams { scenario: Scenario::Wreck, seed, ..Default::default() };
        let data = simulate(&simulation).expect("the defaults are valid");
        with += bend(&data, &LocalSlamParams::default());
        without += bend(&data, &plain);
    }
    println!("{:.2} degrees, without {:.2}", with.to_degrees() / 3.0, without.to_degrees() / 3.0);
    assert!(with < 0.95 * without, "{with} against {without}");
}

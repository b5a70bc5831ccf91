//! Missions at another scale: the unit of length in which the defaults make sense.
//!
//! All defaults are for keyframes some 3 m apart seen with 30 to 50 m of range. A small vehicle in a building takes a
//! keyframe every half metre and sees 10 m: the same picture, smaller. Such a mission is run in a unit of length in
//! which its keyframes are 3 m apart, and its results are turned back into metres.

use nalgebra::{Isometry2, Matrix3, Vector3};

use crate::keyframe::{MissionData, Recording};
use crate::report::RunReport;

/// Distance between keyframes that the defaults are made for, metres.
const KEYFRAME_STEP_M: f64 = 3.0;

/// Factor between that and a mission's own median up to which the defaults are kept as they are: they hold over about
/// this range by themselves, and all sonar missions at hand lie well inside it.
const TOLERATED: f64 = 2.0;

/// The unit of length for `data`, metres: 1 unless the keyframes come much closer, or much farther apart, than the
/// defaults are made for. Odometry alone decides, so every robot of a team could find it before it starts.
pub fn unit_of(data: &MissionData) -> f64 {
    let step = |pair: &[crate::keyframe::Keyframe]| {
        (pair[1].odometry.translation.vector - pair[0].odometry.translation.vector).norm()
    };
    let mut steps: Vec<f64> = data.recordings.iter().flat_map(|r| r.keyframes.windows(2).map(step)).collect();
    // a vehicle that turns on the spot moves nothing; such steps tell nothing of the scale
    steps.retain(|step| *step > 0.0 && step.is_finite());
    steps.sort_by(f64::total_cmp);
    let Some(median) = steps.get(steps.len() / 2) else { return 1.0 };
    let ratio = median / KEYFRAME_STEP_M;
    if (1.0 / TOLERATED..=TOLERATED).contains(&ratio) { 1.0 } else { ratio }
}

/// The same mission with all lengths in units of `unit` metres.
pub fn in_units_of(data: &MissionData, unit: f64) -> MissionData {
    let scaled = |recording: &Recording| {
        let mut recording = recording.clone();
        for keyframe in &mut recording.keyframes {
            keyframe.odometry = times(&keyframe.odometry, 1.0 / unit);
            keyframe.points.iter_mut().for_each(|point| *point /= unit);
        }
        for pose in recording.truth.iter_mut().flatten() {
            *pose = times(pose, 1.0 / unit);
        }
        recording
    };
    MissionData { recordings: data.recordings.iter().map(scaled).collect(), ..data.clone() }
}

/// Turns a report in units of `unit` metres into one in metres.
pub(crate) fn into_metres(report: &mut RunReport, unit: f64) {
    for robot in &mut report.robots {
        let poses = robot.dead_reckoning.iter_mut().chain(&mut robot.local).chain(&mut robot.trajectory);
        poses.chain(robot.truth.iter_mut().flatten()).for_each(|pose| *pose = times(pose, unit));
        robot.points.iter_mut().flatten().for_each(|point| *point *= unit);
        for object in &mut robot.objects {
            object.centroid *= unit;
            object.corners.iter_mut().for_each(|corner| *corner *= unit);
        }
    }
    let scale = Matrix3::from_diagonal(&Vector3::new(unit, unit, 1.0));
    for closure in &mut report.closures {
        closure.a_from_b = times(&closure.a_from_b, unit);
        closure.covariance = closure.covariance.map(|covariance| scale * covariance * scale);
    }
    report.graph_g2o = g2o_in_metres(&report.graph_g2o, unit);
    report.settings.push(("unit of length, m".into(), format!("{unit:.4}")));
}

fn times(pose: &Isometry2<f64>, factor: f64) -> Isometry2<f64> {
    Isometry2::from_parts((pose.translation.vector * factor).into(), pose.rotation)
}

/// g2o text with lengths multiplied by `unit` and informations to match.
fn g2o_in_metres(text: &str, unit: f64) -> String {
    let factors: [f64; 9] = {
        let (l, i) = (unit, 1.0 / unit);
        [l, l, 1.0, i * i, i * i, i, i * i, i, 1.0]
    };
    let mut scaled = String::new();
    for line in text.lines() {
        let skipped = match line.split(' ').next() {
            Some("EDGE_SE2") => 3,
            Some("VERTEX_SE2") => 2,
            _ => usize::MAX,
        };
        for (at, token) in line.split(' ').enumerate() {
            scaled += if at == 0 { "" } else { " " };
            let factor = at.checked_sub(skipped).and_then(|k| factors.get(k));
            match factor.zip(token.parse::<f64>().ok()) {
                Some((factor, value)) => scaled += &(value * factor).to_string(),
                None => scaled += token,
            }
        }
        scaled.push('\n');
    }
    scaled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Scenario, SimulationParams, simulate};

    #[test]
    fn the_scenarios_keep_their_metres_and_a_small_copy_finds_its_unit() {
        for scenario in Scenario::ALL {
            let params = SimulationParams { scenario, keyframes: Some(20), ..SimulationParams::default() };
            let data = simulate(&params).unwrap();
            assert_eq!(unit_of(&data), 1.0);
            let small = in_units_of(&data, 5.0);
            let unit = unit_of(&small);
            assert!((0.1..0.25).contains(&unit), "{unit}");
            let back = in_units_of(&in_units_of(&small, unit), 1.0 / unit);
            let (a, b) = (&back.recordings[1].keyframes[9], &small.recordings[1].keyframes[9]);
            assert!((a.points[3] - b.points[3]).norm() < 1e-12);
            assert!((a.odometry.translation.vector - b.odometry.translation.vector).norm() < 1e-12);
        }
    }

    #[test]
    fn a_graph_in_metres_has_the_same_cost() {
        let text = "VERTEX_SE2 7 1 2 0.5\nEDGE_SE2 7 8 3 4 0.1 16 8 2 4 6 1\n";
        assert_eq!(g2o_in_metres(text, 2.0), "VERTEX_SE2 7 2 4 0.5\nEDGE_SE2 7 8 6 8 0.1 4 2 1 1 3 1\n");
    }
}

//! The keyframe folder reader on real data, on damaged tables and against the writer.

use std::path::PathBuf;

use draco::Error;
use draco::dataset::{
    read_keyframe_folder, read_keyframe_tables, write_keyframe_folder, write_keyframe_tables,
};
use draco::evaluate::absolute_trajectory_error;
use draco::keyframe::MissionData;
use proptest::prelude::*;

const KEYFRAMES: &str = "robot,kf,time,dr_x,dr_y,dr_theta,gt_x,gt_y,gt_theta,n_points
1,0,0.0,0,0,0,5,6,0.1,2
1,1,2.5,3,0,0.3,8,6,0.2,1
4,2,0.5,0,0,0,,,,1
";
const POINTS: &str = "kf,x,y\n0,1.5,-2.0\n0,2,2\n1,3,3\n2,4,4\n";

fn read(keyframes: &str, points: &str) -> Result<MissionData, Error> {
    read_keyframe_tables(keyframes.as_bytes(), points.as_bytes())
}

fn message(keyframes: &str, points: &str) -> String {
    let text = read(keyframes, points).expect_err("the tables are damaged").to_string();
    assert_eq!(text.lines().count(), 1, "one line: {text}");
    text
}

/// A folder of the shared data; `None`, with a note, when it is not there and need not be.
fn shared_data(folder: &str) -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let path = std::env::var_os("DRACO_DATA").map_or_else(|| default.into(), PathBuf::from).join(folder);
    if path.is_dir() {
        return Some(path);
    }
    assert!(std::env::var_os("DRACO_REQUIRE_DATA").is_none(), "{} is missing", path.display());
    eprintln!("skipped: {} is missing (set DRACO_DATA)", path.display());
    None
}

#[test]
fn small_tables_are_read_as_written() {
    let mission = read(KEYFRAMES, POINTS).expect("whole tables");
    let robots: Vec<_> = mission.recordings.iter().map(|recording| recording.robot).collect();
    assert_eq!(robots, [1, 4]);
    let first = &mission.recordings[0];
    assert_eq!(first.keyframes[1].index, 1);
    assert_eq!(first.keyframes[1].time, 2.5);
    assert_eq!(first.keyframes[0].points[0], nalgebra::Point2::new(1.5, -2.0));
    assert!((first.truth[1].expect("known").rotation.angle() - 0.2).abs() < 1e-15);
    assert!(mission.recordings[1].truth[0].is_none());
    assert!(mission.truth_has_heading, "0.3 rad by dead reckoning against 0.1 rad by truth");
}

#[test]
fn columns_are_found_by_name_and_keyframes_by_robot_where_points_name_it() {
    let keyframes = "dr_theta,time,kf,dr_y,dr_x,robot,extra\n0,1,7,2,3,9,x\n0,1,7,4,5,8,y\n";
    let points = "y,robot,x,kf\n1,9,2,7\n3,8,4,7\n";
    let mission = read(keyframes, points).expect("whole tables");
    assert_eq!(mission.recordings[0].robot, 8);
    assert_eq!(mission.recordings[0].keyframes[0].points[0], nalgebra::Point2::new(4.0, 3.0));
    assert_eq!(mission.recordings[1].keyframes[0].odometry.translation.x, 3.0);
}

#[test]
fn every_fault_names_file_line_column_and_reason() {
    let cases = [
        (KEYFRAMES.replace("dr_y", "y"), POINTS.to_owned(), "keyframes.csv:1: column `dr_y` is missing"),
        (KEYFRAMES.replace("gt_y", "y"), POINTS.to_owned(), "keyframes.csv:1: column `gt_y` is missing"),
        (KEYFRAMES.to_owned(), POINTS.replace("kf,x", "kf,u"), "points.csv:1: column `x` is missing"),
        (
            KEYFRAMES.replace("3,0,0.3", "3,NaN,0.3"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `dr_y`: `NaN` is not finite",
        ),
        (
            KEYFRAMES.replace("8,6", "inf,6"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `gt_x`: `inf` is not finite",
        ),
        (
            KEYFRAMES.replace("8,6", ",6"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `gt_x`: `` is not a number",
        ),
        (
            KEYFRAMES.replace("2.5", "1e12"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `time`: `1e12` is too large",
        ),
        (KEYFRAMES.to_owned(), POINTS.replace("3,3", "3,x"), "points.csv:4: column `y`: `x` is not a number"),
        (
            KEYFRAMES.to_owned(),
            POINTS.replace("2,4,4\n", "2,4"),
            "points.csv:5: the line has 2 cells where the header has 3",
        ),
        (
            KEYFRAMES[..KEYFRAMES.len() - 4].to_owned(),
            POINTS.to_owned(),
            "keyframes.csv:4: the line has 8 cells",
        ),
        (
            KEYFRAMES.to_owned(),
            POINTS.replace("2,4,4", "5,4,4"),
            "points.csv:5: column `kf`: keyframe 5 is not in keyframes.csv",
        ),
        (
            KEYFRAMES.replace("1,1,2.5", "1,0,2.5"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `kf`: keyframe 0 is already on line 2",
        ),
        (
            KEYFRAMES.replace("2.5", "-2.5"),
            POINTS.to_owned(),
            "keyframes.csv:3: column `time`: -2.5 s is before 0 s",
        ),
        (
            KEYFRAMES.replace("4,2,0.5", "-4,2,0.5"),
            POINTS.to_owned(),
            "keyframes.csv:4: column `robot`: `-4` is not a robot's number",
        ),
        (
            KEYFRAMES.to_owned(),
            POINTS.replace("2,2\n", "2,2\n1,0,0\n"),
            "keyframes.csv:3: column `n_points`: keyframe 1 promises 1 points, points.csv has 2",
        ),
        (
            KEYFRAMES.to_owned(),
            POINTS.replace("2,4,4\n", ""),
            "keyframes.csv:4: robot 4 has no point in points.csv",
        ),
        (
            KEYFRAMES.lines().next().unwrap().to_owned(),
            POINTS.to_owned(),
            "keyframes.csv:1: there is no keyframe",
        ),
        (String::new(), POINTS.to_owned(), "keyframes.csv:1: column `robot` is missing"),
    ];
    for (keyframes, points, expected) in cases {
        let text = message(&keyframes, &points);
        assert!(text.starts_with(expected), "wanted `{expected}`, got `{text}`");
    }
}

#[test]
fn a_line_that_is_not_text_is_named() {
    let error = read_keyframe_tables(KEYFRAMES.as_bytes(), &b"kf,x,y\n0,1,2\n0,\xff,2\n"[..]).unwrap_err();
    assert!(error.to_string().starts_with("points.csv:3: the line is not UTF-8"), "{error}");
}

#[test]
fn a_missing_folder_or_table_is_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let missing = folder.path().join("nowhere");
    let text = read_keyframe_folder(&missing).expect_err("no folder").to_string();
    assert!(text.contains("nowhere"), "{text}");
    std::fs::write(folder.path().join("keyframes.csv"), KEYFRAMES).expect("write");
    let text = read_keyframe_folder(folder.path()).expect_err("no points").to_string();
    assert!(text.contains("points.csv"), "{text}");
}

/// Largest change of a heading by way through cosine and sine.
const HEADING_TOLERANCE: f64 = 1e-15;

fn assert_same(a: &MissionData, b: &MissionData) {
    assert_eq!(a.truth_has_heading, b.truth_has_heading);
    assert_eq!(a.recordings.len(), b.recordings.len());
    for (a, b) in a.recordings.iter().zip(&b.recordings) {
        assert_eq!((a.robot, a.keyframes.len()), (b.robot, b.keyframes.len()));
        for (a, b) in a.keyframes.iter().zip(&b.keyframes) {
            assert_eq!((a.index, a.time, &a.points), (b.index, b.time, &b.points));
            assert_eq!(a.odometry.translation, b.odometry.translation);
            assert!(a.odometry.rotation.angle_to(&b.odometry.rotation).abs() < HEADING_TOLERANCE);
        }
        for (a, b) in a.truth.iter().zip(&b.truth) {
            assert_eq!(a.map(|pose| pose.translation), b.map(|pose| pose.translation));
        }
    }
}

#[test]
fn a_real_recording_survives_writing_and_reading() {
    let Some(folder) = shared_data("sonar/aracati2017") else { return };
    let mission = read_keyframe_folder(&folder).expect("the recording is whole");
    assert_eq!(mission.name, "aracati2017");
    assert!(!mission.truth_has_heading, "its compass feeds truth and dead reckoning alike");
    let keyframes: usize = mission.recordings.iter().map(|recording| recording.keyframes.len()).sum();
    let points: usize =
        mission.recordings.iter().flat_map(|r| &r.keyframes).map(|keyframe| keyframe.points.len()).sum();
    assert_eq!((mission.recordings.len(), keyframes, points), (3, 255, 87_365));

    let copy = tempfile::tempdir().expect("temporary folder");
    write_keyframe_folder(&mission, copy.path()).expect("writable");
    assert_same(&mission, &read_keyframe_folder(copy.path()).expect("just written"));
}

/// Dead-reckoning errors as the READMEs of the data state them, made with other programs.
#[test]
fn dead_reckoning_errors_are_those_published_with_the_data() {
    let sets = [
        ("sonar/aracati2017", [8.51, 2.78, 4.13], 0.005),
        ("multirobot-real/intel3", [11.08, 9.65, 25.43], 0.005),
    ];
    for (folder, published, rounding) in sets {
        let Some(folder) = shared_data(folder) else { return };
        let mission = read_keyframe_folder(&folder).expect("the recording is whole");
        for (recording, published) in mission.recordings.iter().zip(published) {
            let odometry = recording.keyframes.iter().map(|keyframe| &keyframe.odometry);
            let error = absolute_trajectory_error(odometry, &recording.truth).expect("there is truth");
            assert!(
                (error.rmse_m - published).abs() <= rounding + 1e-9,
                "{} against {published}",
                error.rmse_m
            );
        }
    }
}

#[test]
fn intel3_has_truth_for_174_keyframes_and_headings_of_its_own() {
    let Some(folder) = shared_data("multirobot-real/intel3") else { return };
    let mission = read_keyframe_folder(&folder).expect("the recording is whole");
    assert_eq!(mission.recordings.iter().flat_map(|r| &r.truth).flatten().count(), 174);
    assert!(mission.truth_has_heading);
}

/// One change of a table: cut, overwrite, insert, swap.
fn mutate(text: &str, (kind, place, byte): (u8, prop::sample::Index, u8)) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    let at = place.index(bytes.len());
    match kind % 4 {
        0 => bytes.truncate(at),
        1 => bytes[at] = byte,
        2 => bytes.insert(at, byte),
        _ => drop(bytes.remove(at)),
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    #[test]
    fn mutated_tables_are_read_or_refused_in_one_line(change: (u8, prop::sample::Index, u8), in_points: bool) {
        let (mut keyframes, mut points) = (KEYFRAMES.as_bytes().to_vec(), POINTS.as_bytes().to_vec());
        let target = if in_points { &mut points } else { &mut keyframes };
        *target = mutate(std::str::from_utf8(target).expect("text"), change);
        match read_keyframe_tables(&keyframes[..], &points[..]) {
            Ok(mission) => {
                for recording in &mission.recordings {
                    prop_assert!(!recording.keyframes.is_empty());
                    prop_assert_eq!(recording.keyframes.len(), recording.truth.len());
                    for keyframe in &recording.keyframes {
                        prop_assert!(keyframe.time.is_finite() && keyframe.odometry.translation.vector.norm().is_finite());
                        prop_assert!(keyframe.points.iter().all(|p| p.x.is_finite() && p.y.is_finite()));
                    }
                }
                let (mut again, mut again_points) = (Vec::new(), Vec::new());
                write_keyframe_tables(&mission, &mut again, &mut again_points).expect("memory");
                assert_same(&mission, &read_keyframe_tables(&again[..], &again_points[..]).expect("just written"));
            }
            Err(error) => prop_assert_eq!(error.to_string().lines().count(), 1),
        }
    }
}

//! The program on bad input: one clear line, the right exit status, no result left behind.

use std::path::Path;
use std::process::{Command, Output};

const KEYFRAMES: &str = "robot,kf,time,dr_x,dr_y,dr_theta\n1,0,0,0,0,0\n1,1,6,3,0,0\n2,2,0,0,0,0\n";
const POINTS: &str = "kf,x,y\n0,5,1\n1,2,1\n2,4,0\n";

fn draco(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_draco")).args(arguments).output().expect("the program starts")
}

fn fails_with(data: &Path, expected: &str) {
    let out = data.with_extension("out");
    let paths = (data.to_string_lossy(), out.to_string_lossy());
    let output = draco(&["run", "--data", &paths.0, "--out", &paths.1]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.contains(expected), "wanted `{expected}` in `{message}`");
    assert!(output.stdout.is_empty() && !out.exists(), "no result may be left");
}

#[test]
fn damaged_data_are_refused_by_file_and_line() {
    let cases = [
        (
            "column",
            KEYFRAMES.replace("dr_y", "y"),
            POINTS.to_owned(),
            "keyframes.csv:1: column `dr_y` is missing",
        ),
        (
            "nan",
            KEYFRAMES.to_owned(),
            POINTS.replace("2,1\n", "nan,1\n"),
            "points.csv:3: column `x`: `nan` is not finite",
        ),
        ("cut", KEYFRAMES.to_owned(), POINTS.replace("2,4,0\n", "2,4"), "points.csv:4: the line has 2 cells"),
        (
            "empty",
            KEYFRAMES.to_owned(),
            POINTS.replace("2,4,0\n", ""),
            "keyframes.csv:4: robot 2 has no point",
        ),
        (
            "stranger",
            KEYFRAMES.to_owned(),
            POINTS.replace("2,4", "8,4"),
            "points.csv:4: column `kf`: keyframe 8",
        ),
    ];
    let folder = tempfile::tempdir().expect("temporary folder");
    for (name, keyframes, points, expected) in cases {
        let data = folder.path().join(name);
        std::fs::create_dir(&data).expect("made");
        std::fs::write(data.join("keyframes.csv"), keyframes).expect("written");
        std::fs::write(data.join("points.csv"), points).expect("written");
        fails_with(&data, expected);
    }
    fails_with(&folder.path().join("nowhere"), "nowhere");
}

#[test]
fn an_unknown_scenario_is_a_failed_run_and_an_unknown_option_wrong_usage() {
    let output = draco(&["run", "lagoon"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), message.lines().count()), (Some(1), 1), "{message}");
    assert!(message.contains("lagoon") && message.contains("harbor"), "{message}");
    assert_eq!(draco(&["run", "--no-such-option"]).status.code(), Some(2));
    assert_eq!(draco(&["run", "--consistency", "faith"]).status.code(), Some(2));
    assert_eq!(draco(&["--help"]).status.code(), Some(0));
}

#[test]
fn a_robot_that_cannot_fly_says_why_in_one_line() {
    let fails = |arguments: &[&str], status: i32, expected: &str| {
        let output = draco(&[&["robot"][..], arguments].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{message}");
        assert!(message.contains(expected), "wanted `{expected}` in `{message}`");
        assert!(status == 2 || message.lines().count() == 1, "{message}");
    };
    fails(&["--id", "9", "--listen", "127.0.0.1:0"], 1, "robot 9 is not on this link");
    fails(&["--id", "1", "--listen", "nowhere"], 1, "endpoint `nowhere`");
    fails(&["--id", "1", "--listen", "192.0.2.1:7"], 1, "192.0.2.1:7");
    fails(&["--id", "1", "--listen", "127.0.0.1:0", "--key-file", "no.key"], 1, "no.key");
    fails(&["--id", "1"], 2, "--listen");
    fails(&["--id", "1", "--listen", "127.0.0.1:0", "--patience", "long"], 2, "--patience");
    #[cfg(not(feature = "zenoh"))]
    fails(&["--id", "1", "--listen", "tcp/127.0.0.1:0", "--link", "zenoh"], 1, "without the feature `zenoh`");
}

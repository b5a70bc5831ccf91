//! What a run leaves behind is whole, true to the run, and safe to open.

use draco::evaluate::Decision;
use draco::report::{
    ClosureReport, KeyframeRef, RobotReport, RunReport, Traffic, check_output_folder, write_run,
};
use nalgebra::{Isometry2, Point2, Vector2};

fn pose(x: f64, y: f64, theta: f64) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(x, y), theta)
}

/// Two robots on parallel lines, perfectly estimated in a frame turned by 90°; one right and one wrong closure.
fn run() -> RunReport {
    let turned = pose(3.0, -2.0, std::f64::consts::FRAC_PI_2);
    let robot = |id: u32, y: f64| {
        let truth: Vec<_> = (0..5).map(|index| pose(3.0 * f64::from(index), y, 0.0)).collect();
        RobotReport {
            id,
            merged: true,
            times: (0..5).map(f64::from).collect(),
            dead_reckoning: (0..5).map(|index| pose(2.0 * f64::from(index), 0.0, 0.0)).collect(),
            trajectory: truth.iter().map(|pose| turned * pose).collect(),
            truth: truth.into_iter().map(Some).collect(),
            points: vec![vec![Point2::new(4.0, 1.0)]; 5],
            ..RobotReport::default()
        }
    };
    let closure = |dx: f64, decision| ClosureReport {
        a: KeyframeRef { robot: 7, index: 1 },
        b: KeyframeRef { robot: 9, index: 1 },
        a_from_b: pose(dx, 5.0, 0.0),
        covariance: None,
        time: 1.0,
        decision,
        reason: "<script>alert(1)</script>".to_owned(),
    };
    let traffic = |robot, kind: &str, bits| Traffic { time: 1.0, robot, kind: kind.to_owned(), bits };
    RunReport {
        scenario: "a <b> & c".to_owned(),
        consistency: "gcm".to_owned(),
        truth_has_heading: true,
        robots: vec![robot(7, 0.0), robot(9, 5.0)],
        closures: vec![
            closure(0.1, Decision::Accepted),
            closure(4.0, Decision::Accepted),
            closure(0.2, Decision::Rejected),
            closure(9.0, Decision::Undecided),
        ],
        traffic: vec![traffic(7, "scan", 1000), traffic(7, "scan", 24), traffic(9, "objects", 8)],
        graph_g2o: "VERTEX_SE2 0 0 0 0\n".to_owned(),
        ..RunReport::default()
    }
}

#[test]
fn the_summary_counts_by_hand() {
    let summary = run().summary();
    assert_eq!((summary.schema, summary.team.merged_robots), (1, 2));
    assert!(summary.team.ate_m.expect("truth") < 1e-12);
    // Steps of 2 m for 3 m: errors -2, -1, 0, 1, 2 about the middle.
    assert!((summary.robots[0].ate_dead_reckoning_m.expect("truth") - 2.0_f64.sqrt()).abs() < 1e-12);
    assert_eq!((summary.team.precision, summary.team.recall), (Some(0.5), Some(0.5)));
    let closures = &summary.robots[0].closures;
    assert_eq!((closures.proposed, closures.accepted, closures.undecided), (4, 2, 1));
    assert_eq!((closures.true_accepted, closures.true_proposed), (Some(1), Some(2)));
    assert_eq!(summary.robots[1].closures.proposed, 0);
    assert_eq!(summary.robots[0].sent_bits["scan"], 1024);
    assert_eq!(summary.team.bits_per_accepted_closure, Some(516.0));
    let correct: Vec<_> = summary.closures.iter().map(|closure| closure.correct).collect();
    assert_eq!(correct, [Some(true), Some(false), Some(true), Some(false)]);
}

#[test]
fn without_truth_nothing_is_graded() {
    let mut report = run();
    for robot in &mut report.robots {
        robot.truth = vec![None; 5];
    }
    let json = serde_json::to_value(report.summary()).expect("plain data");
    assert!(json["team"]["ate_m"].is_null() && json["team"]["precision"].is_null());
    assert!(json["robots"][0]["closures"]["true_accepted"].is_null());
    assert!(report.html().contains("</html>") && report.map_svg().ends_with("</svg>"));
}

#[test]
fn a_written_run_is_whole_and_replaces_an_older_one() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("deep").join("out");
    write_run(&run(), &out).expect("writable");
    std::fs::write(out.join("trajectory_1.tum"), "old").expect("write");
    write_run(&run(), &out).expect("writable");
    let mut names: Vec<_> = std::fs::read_dir(&out)
        .expect("there")
        .map(|e| e.expect("entry").file_name().into_string().expect("text"))
        .collect();
    names.sort();
    let expected = [
        "graph.g2o",
        "map.svg",
        "points.ply",
        "report.html",
        "summary.json",
        "traffic.csv",
        "trajectory_7.tum",
        "trajectory_9.tum",
    ];
    assert_eq!(names, expected);
    let text = |name: &str| std::fs::read_to_string(out.join(name)).expect("written");
    let ply = text("points.ply");
    assert!(ply.contains("element vertex 10\n"), "{ply}");
    // the point 4 m ahead and 1 m to port of the robot's first pose, which is at (3, -2) and looks along y
    assert!(ply.contains("end_header\n2.000 2.000 0 7 0\n"), "{ply}");
    assert_eq!(text("traffic.csv"), "time,robot,kind,bits\n1,7,scan,1000\n1,7,scan,24\n1,9,objects,8\n");
    let beside = std::fs::read_dir(folder.path().join("deep")).expect("there").count();
    assert_eq!(beside, 1, "no staging folder is left");
    let tum = std::fs::read_to_string(out.join("trajectory_9.tum")).expect("there");
    let first: Vec<f64> =
        tum.lines().next().expect("a line").split(' ').map(|v| v.parse().expect("number")).collect();
    let half = std::f64::consts::FRAC_PI_4;
    let expected = [0.0, -2.0, -2.0, 0.0, 0.0, 0.0, half.sin(), half.cos()];
    assert!(first.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{tum}");
}

#[test]
fn a_folder_with_other_files_is_left_as_it_is() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for (name, with_result) in [("notes.txt", true), ("trajectory_groundtruth.tum", false)] {
        let out = folder.path().join(name);
        std::fs::create_dir(&out).expect("writable");
        if with_result {
            write_run(&run(), &out).expect("an empty folder is fine");
        }
        std::fs::write(out.join(name), "mine").expect("write");
        let before = std::fs::read_dir(&out).expect("there").count();
        let error = write_run(&run(), &out).expect_err("holds a file of the user's").to_string();
        assert!(error.contains(name), "{error}");
        assert_eq!(std::fs::read_to_string(out.join(name)).expect("there"), "mine");
        assert_eq!(std::fs::read_dir(&out).expect("there").count(), before);
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 2);
}

#[test]
fn two_equal_runs_give_equal_bytes() {
    let text = |report: RunReport| serde_json::to_string(&report.summary()).expect("plain data");
    assert_eq!(text(run()), text(run()));
    assert_eq!(run().html(), run().html());
}

#[test]
fn a_file_in_the_way_is_an_error_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("file");
    std::fs::write(&file, "mine").expect("write");
    assert!(check_output_folder(&file.join("out")).is_err());
    assert!(write_run(&run(), &file.join("out")).is_err());
    assert!(write_run(&run(), &file).is_err());
    assert!(check_output_folder(&folder.path().join("out")).is_ok());
    assert_eq!(std::fs::read_to_string(&file).expect("there"), "mine");
    assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 1);
}

#[test]
fn names_and_reasons_from_data_stay_text() {
    let html = run().html();
    assert!(!html.contains("<script>alert") && html.contains("&lt;script&gt;alert"));
    assert!(html.contains("a &lt;b&gt; &amp; c"));
    for forbidden in ["http://", "https://", "url(", "@import"] {
        assert!(!html.contains(forbidden), "the page loads nothing, yet holds {forbidden}");
    }
}

#[test]
fn an_empty_run_still_makes_a_page() {
    let empty = RunReport::default();
    assert!(empty.html().contains("</html>"));
    assert!(empty.table().contains("0 of 0 merged"));
}

//! Bad graphs are refused by errors that name the line, the key and the reason.

use draco_lie::LieGroup;
use draco_pgo::io::g2o;
use draco_pgo::{
    Error, Gauge, GncParams, Kernel, Key, Marginals, PoseGraph2, SolveParams, StaircaseParams, certify,
    chordal, gnc, solve, spanning_tree, staircase,
};
use nalgebra::{Isometry2, Matrix3};

fn parse(text: &str) -> Result<PoseGraph2, Error> {
    g2o::parse::<3, Isometry2<f64>>(text)
}

const EDGE: &str = "1 0 0 1 0 0 1 0 1";

#[test]
fn every_bad_line_names_itself_its_key_and_the_reason() {
    let good = format!("VERTEX_SE2 4 0 0 0\nVERTEX_SE2 5 1 0 0\nEDGE_SE2 4 5 {EDGE}\n");
    let letter = Key::new(97, 3).to_id().unwrap();
    for (line, says) in [
        (
            "EDGE_SE2 4 5 1 0 0 1 0 0 1 0 0".into(),
            "edge 4 -> 5: the information matrix of the factor at 4 is not symmetric positive definite",
        ),
        (
            "EDGE_SE2 4 5 1 0 0 0 0 0 0 0 0".into(),
            "edge 4 -> 5: the information matrix of the factor at 4 is not symmetric positive definite",
        ),
        ("EDGE_SE2 4 5 1 NaN 0 1 0 0 1 0 1".into(), "edge 4 -> 5: \"NaN\" is not finite"),
        ("EDGE_SE2 4 5 1 0 0 1 0 0 inf 0 1".into(), "edge 4 -> 5: \"inf\" is not finite"),
        ("VERTEX_SE2 5 1 0 0".into(), "pose 5 is declared twice, first in line 2"),
        (format!("VERTEX_SE2 {letter} 1 x 0"), "pose a3: \"x\" is not a number"),
        (format!("EDGE_SE2 4 4 {EDGE}"), "the edge joins pose 4 to itself"),
        (
            format!("EDGE_SE2 4 18446744073709551616 {EDGE}"),
            "\"18446744073709551616\" is not an id (a whole number from 0 to 2^64 - 1)",
        ),
        ("VERTEX_SE2 6 1e400 0 0".into(), "pose 6: \"1e400\" is not finite"),
        ("FIX 99".into(), "FIX: pose 99 is not in the graph"),
        ("EDGE_SE2 4".into(), "the line ends where an id is due"),
    ] {
        let error = parse(&format!("{good}{line}\n")).unwrap_err();
        assert_eq!(error, Error::Parse { line: 4, reason: says.into() }, "{line}");
    }
    assert_eq!(parse("").unwrap_err(), Error::EmptyGraph);
}

#[test]
fn huge_ids_are_fine() {
    let huge = u64::MAX;
    let mut graph =
        parse(&format!("EDGE_SE2 0 {huge} {EDGE}\nEDGE_SE2 {} {huge} {EDGE}\n", huge - 1)).unwrap();
    assert_eq!(graph.pose_count(), 3);
    let solution = solve(&graph, &SolveParams::default()).unwrap();
    graph.update(&solution);
    assert!(solution.final_cost < 1e-20);
    chordal(&mut graph).unwrap();
    certify(&graph).unwrap();
}

#[test]
fn loose_parts_are_named_and_can_be_solved_all_the_same() {
    let graph = parse(&format!("EDGE_SE2 0 1 {EDGE}\nEDGE_SE2 7 8 {EDGE}\nEDGE_SE2 8 9 {EDGE}\n")).unwrap();
    let loose = Error::Disconnected { key: Key::new(0, 7), size: 3, root: Key::new(0, 0) };
    assert_eq!(graph.check_connected().unwrap_err(), loose);
    assert_eq!(loose.to_string(), "pose 7 (3 poses) hangs loose: no factor joins it to pose 0");
    let strict = SolveParams { gauge: Gauge::Require, ..SolveParams::default() };
    let unanchored = Error::NoGauge { key: Key::new(0, 0), size: 2 };
    assert_eq!(solve(&graph, &strict).unwrap_err(), unanchored);
    assert_eq!(Marginals::new(&graph, Gauge::Require).unwrap_err(), unanchored);
    assert_eq!(solve(&graph, &SolveParams::default()).unwrap().held, [Key::new(0, 0), Key::new(0, 7)]);
    let found = staircase(&graph, &StaircaseParams::default()).unwrap();
    assert!(found.certificate.objective < 1e-18 && found.certificate.slack.is_some());
    let mut relaxed = graph.clone();
    chordal(&mut relaxed).unwrap();
    assert!(relaxed.cost() < 1e-20);
    assert!(gnc(&graph, &GncParams::default()).unwrap().outliers.is_empty());
}

#[test]
fn every_entry_point_refuses_an_empty_graph() {
    let mut empty = PoseGraph2::new();
    assert_eq!(solve(&empty, &SolveParams::default()).unwrap_err(), Error::EmptyGraph);
    assert_eq!(certify(&empty).unwrap_err(), Error::EmptyGraph);
    assert_eq!(staircase(&empty, &StaircaseParams::default()).unwrap_err(), Error::EmptyGraph);
    assert_eq!(gnc(&empty, &GncParams::default()).unwrap_err(), Error::EmptyGraph);
    assert_eq!(Marginals::new(&empty, Gauge::HoldFirst).unwrap_err(), Error::EmptyGraph);
    assert_eq!(chordal(&mut empty).unwrap_err(), Error::EmptyGraph);
    assert_eq!(spanning_tree(&mut empty).unwrap_err(), Error::EmptyGraph);
    assert_eq!(empty.check_connected().unwrap_err(), Error::EmptyGraph);
}

#[test]
fn bad_parameters_are_named() {
    let graph = parse(&format!("EDGE_SE2 0 1 {EDGE}\n")).unwrap();
    for (name, params) in [
        ("inlier_probability", GncParams { inlier_probability: 1.0, ..GncParams::default() }),
        ("inlier_probability", GncParams { inlier_probability: f64::NAN, ..GncParams::default() }),
        ("control_step", GncParams { control_step: 1.0, ..GncParams::default() }),
    ] {
        match gnc(&graph, &params) {
            Err(Error::Parameter { name: named, .. }) => assert_eq!(named, name),
            other => panic!("{other:?}"),
        }
    }
    let params = StaircaseParams { gap_tolerance: -1.0, ..StaircaseParams::default() };
    assert_eq!(
        staircase(&graph, &params).unwrap_err(),
        Error::Parameter { name: "gap_tolerance", value: -1.0 }
    );
    let unknown = Marginals::new(&graph, Gauge::HoldFirst).unwrap().covariance(Key::new(3, 1));
    assert_eq!(unknown.unwrap_err(), Error::UnknownKey { key: Key::new(3, 1) });
}

#[test]
fn a_pose_no_factor_determines_is_named() {
    // a prior with next to no information on one direction is no anchor
    let mut graph = PoseGraph2::new();
    let (a, b) = (Key::new(0, 0), Key::new(0, 1));
    graph.add_pose(a, Isometry2::identity()).unwrap();
    graph.add_pose(b, Isometry2::identity()).unwrap();
    let tiny = Matrix3::from_diagonal_element(1e-320);
    let added = graph.add_prior(a, LieGroup::identity(), tiny, Kernel::None);
    assert!(added.is_ok() || added == Err(Error::Information { key: a }));
    graph.add_between(a, b, LieGroup::identity(), Matrix3::identity(), Kernel::None).unwrap();
    if graph.check_gauge().is_ok() {
        match Marginals::new(&graph, Gauge::Require) {
            Err(Error::Indefinite { key }) => assert!(key == a || key == b),
            other => panic!("{other:?}"),
        }
    }
}

//! The g2o reader and writer.

mod common;

use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{Error, Key, PoseGraph2};
use nalgebra::Isometry2;
use rand::{RngExt, SeedableRng};

const SMALL: &str = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1.1 0.1 0.7\nFIX 0\n\
                     EDGE_SE2 0 1 1 0 0.5 10 0 0 10 0 100\nEDGE_SE2 1 2 1 0 0.5 10 1 0 10 0 100\n";

fn parse2(text: &str) -> Result<PoseGraph2, Error> {
    g2o::parse::<3, Isometry2<f64>>(text)
}

#[test]
fn poses_that_only_edges_name_are_composed() {
    let graph = parse2(SMALL).unwrap();
    assert_eq!((graph.pose_count(), graph.factor_count()), (3, 2));
    assert!(graph.is_fixed(Key::new(0, 0)));
    let last = graph.pose(Key::new(0, 2)).unwrap();
    assert!((last.rotation.angle() - 1.2).abs() < 1e-12);
    assert!((last.translation.x - (1.1 + 0.7f64.cos())).abs() < 1e-12);
}

#[test]
fn bad_lines_are_named() {
    for (text, line, says) in [
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\n", 2, "twice"),
        ("VERTEX_SE2 0 0 zero 0\n", 1, "not a number"),
        ("VERTEX_SE2 0 0 0 NaN\n", 1, "not finite"),
        ("VERTEX_SE2 -1 0 0 0\n", 1, "not an id"),
        ("VERTEX_SE2 99999999999999999999 0 0 0\n", 1, "not an id"),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n", 2, "itself"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 0\n", 1, "positive definite"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1\n", 1, "ends"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1 7\n", 1, "unexpected"),
        ("\nEDGE_SE9 0 1\n", 2, "unknown tag"),
        ("VERTEX_SE2 0 0 0 0\nFIX 7\n", 2, "not in the graph"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n", 2, "unknown tag"),
    ] {
        match g2o::parse_any(text) {
            Err(Error::Parse { line: at, reason }) => {
                assert!(at == line && reason.contains(says), "{text:?} gave line {at}: {reason}");
            }
            other => panic!("{text:?} gave {other:?}"),
        }
    }
    for (text, says) in [
        ("EDGE_SE2 3 4 1 0 0 1 0 0 1 0 nan\n", "3 -> 4"),
        ("EDGE_SE2 3 4 1 0 0 1 0 0 1 0 -1\n", "3 -> 4"),
        ("VERTEX_SE2 5 0 inf 0\n", "pose 5"),
        ("VERTEX_SE2 5 0 0 0\nFIX 6\n", "pose 6"),
        ("EDGE_PRIOR_SE2 8 0 0 0 1 0 0 1 0 0\n", "pose 8"),
    ] {
        let error = g2o::parse_any(text).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
    let twice = g2o::parse_any("VERTEX_SE2 0 0 0 0\n\nVERTEX_SE2 0 0 0 0\n").unwrap_err();
    assert_eq!(twice.to_string(), "line 3: pose 0 is declared twice, first in line 1");
    assert!(matches!(g2o::parse_any("# nothing\n"), Err(Error::EmptyGraph)));
    assert!(matches!(g2o::parse_any("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n"), Err(Error::Parse { line: 1, .. })));
    assert!(matches!(g2o::read("no/such/file.g2o"), Err(Error::File { .. })));
}

#[test]
fn ids_may_be_sparse_symbols_and_huge() {
    let text = "VERTEX_SE2 6989586621679009792 0 0 0\nVERTEX_SE2 18446744073709551615 1 0 0\n\
                EDGE_SE2 6989586621679009792 18446744073709551615 1 0 0 1 0 0 1 0 1\n\
                EDGE_SE2 7 18446744073709551615 1 0 0 1 0 0 1 0 1\n";
    let graph = parse2(text).unwrap();
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    assert_eq!(keys, [Key::new(0, 7), Key::new(97, 0), Key::new(255, (1 << 56) - 1)]);
    assert!(graph.pose(keys[0]).unwrap().translation.vector.norm() < 1e-12);
    let again = parse2(&g2o::to_text(&graph).unwrap()).unwrap();
    assert!(graph.poses().eq(again.poses()));
}

#[test]
fn priors_of_a_sensor_become_priors_of_the_body() {
    use draco_lie::LieGroup;
    let offset = nalgebra::Isometry3::new(
        nalgebra::Vector3::new(0.3, -0.2, 1.0),
        nalgebra::Vector3::new(0.1, 0.5, -0.7),
    );
    let q = offset.rotation;
    let t = offset.translation;
    let body = "VERTEX_SE3:QUAT 4 1 2 3 0.5 -0.5 0.5 0.5\n";
    let upper = "2 0.1 0 0 0 0 3 0 0.2 0 0 4 0 0 0.3 5 0 0 6 0.4 7";
    let text = format!(
        "PARAMS_SE3OFFSET 3 {} {} {} {} {} {} {}\n{body}EDGE_SE3_PRIOR 4 3 1.1 2 3.1 0.5 -0.5 0.5 0.5 {upper}\n",
        t.x, t.y, t.z, q.i, q.j, q.k, q.w
    );
    let AnyGraph::Three(graph) = g2o::parse_any(&text).unwrap() else { panic!("not in space") };
    // by hand: half the squared residual of the sensor's pose
    let plain = text.replace(
        &format!("PARAMS_SE3OFFSET 3 {} {} {} {} {} {} {}", t.x, t.y, t.z, q.i, q.j, q.k, q.w),
        "PARAMS_SE3OFFSET 3 0 0 0 0 0 0 1",
    );
    let AnyGraph::Three(plain) = g2o::parse_any(&plain).unwrap() else { panic!("not in space") };
    let (_, factor) = plain.factors().next().unwrap();
    let draco_pgo::Measurement::Prior { measured, .. } = &factor.measurement else { panic!("not a prior") };
    let e = measured.between(&(plain.pose(Key::new(0, 4)).unwrap() * offset)).log();
    let expected = 0.5 * e.dot(&(factor.information * e));
    assert!((graph.cost() - expected).abs() < 1e-10 * expected, "{} instead of {expected}", graph.cost());
    let again = g2o::to_text(&graph).unwrap();
    assert!(again.starts_with("PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n"));
    let AnyGraph::Three(again) = g2o::parse_any(&again).unwrap() else { panic!("not in space") };
    assert_eq!(again.cost().to_bits(), graph.cost().to_bits());
    let error = g2o::parse_any(&text.replace("EDGE_SE3_PRIOR 4 3", "EDGE_SE3_PRIOR 4 9")).unwrap_err();
    assert!(error.to_string().contains("offset 9"), "{error}");
}

#[test]
fn writing_and_reading_again_gives_the_same_bits() {
    for name in ["intel", "MIT", "sphere2500", "multi/dm4/0"] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => same_bits(&graph),
            AnyGraph::Three(graph) => same_bits(&graph),
        }
    }
}

fn same_bits<const N: usize, G: g2o::G2oPose<N>>(graph: &draco_pgo::PoseGraph<G, N>) {
    let text = g2o::to_text(graph).unwrap();
    let again = g2o::parse::<N, G>(&text).unwrap();
    assert!(graph.poses().eq(again.poses()));
    assert_eq!(graph.cost().to_bits(), again.cost().to_bits());
    assert_eq!(text, g2o::to_text(&again).unwrap());
}

#[test]
fn mutated_files_never_panic() {
    mutate(40_000);
}

#[test]
#[ignore = "the long version of the test above"]
fn a_million_mutated_files_never_panic() {
    mutate(1_000_000);
}

fn mutate(rounds: usize) {
    let space = "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nFIX 0\nEDGE_SE3:QUAT 0 1 1 0 0 0 0 0.6 0.8 \
                 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n";
    let pieces: [&[u8]; 10] =
        [b"NaN", b"inf", b"-", b"1e999", b"\n", b" ", b"\xff", b"18446744073709551616", b"FIX 1", b"0"];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut accepted = 0;
    for round in 0..rounds {
        let mut bytes = if round % 2 == 0 { SMALL } else { space }.as_bytes().to_vec();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            let until = (at + rng.random_range(0..4)).min(bytes.len());
            match rng.random_range(0..3) {
                0 => bytes[at] = rng.random_range(0..=255),
                1 => drop(bytes.drain(at..until)),
                _ => drop(bytes.splice(at..until, pieces[rng.random_range(0..pieces.len())].iter().copied())),
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        if let Ok(graph) = g2o::parse_any(&text) {
            accepted += 1;
            let cost = match graph {
                AnyGraph::Two(graph) => graph.cost(),
                AnyGraph::Three(graph) => graph.cost(),
            };
            assert!(cost >= 0.0, "{text}");
        }
    }
    assert!(accepted > 1000, "the mutations leave too little intact to test anything: {accepted}");
}

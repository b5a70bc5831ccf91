//! The TUM and KITTI readers and writers, and the reader of teams.

mod common;

use draco_pgo::io::{g2o, kitti, team, tum};
use draco_pgo::{Error, Key};
use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};

fn poses() -> Vec<Isometry3<f64>> {
    (0..50)
        .map(|i| {
            let s = f64::from(i) * 0.37;
            Isometry3::new(Vector3::new(s, -s * s, 1e-7 * s), Vector3::new(s.sin(), 0.3 * s, -1.0))
        })
        .collect()
}

#[test]
fn tum_trajectories_come_back_to_the_bit() {
    let trajectory: Vec<tum::StampedPose> = poses()
        .into_iter()
        .enumerate()
        .map(|(i, pose)| tum::StampedPose { time: 1.3e9 + 0.1 * i as f64, pose })
        .collect();
    let file = tempfile::NamedTempFile::new().unwrap();
    tum::write(&trajectory, file.path()).unwrap();
    let once = tum::read(file.path()).unwrap();
    // unit quaternions that drifted by a rounding error may be normalised once
    assert!(
        once.iter()
            .zip(&trajectory)
            .all(|(a, b)| a.time == b.time && (a.pose.inv_mul(&b.pose)).translation.vector.norm() < 1e-9)
    );
    assert_eq!(tum::parse(&tum::to_text(&once)).unwrap(), once);
}

#[test]
fn kitti_trajectories_come_back() {
    let trajectory = poses();
    let again = kitti::parse(&kitti::to_text(&trajectory)).unwrap();
    assert_eq!(again.len(), trajectory.len());
    for (a, b) in again.iter().zip(&trajectory) {
        assert_eq!(a.translation, b.translation);
        assert!(a.rotation.angle_to(&b.rotation) < 1e-14);
    }
    let six_digits = "1.000000e+00 9.043680e-12 2.326809e-11 5.551115e-17 9.043683e-12 1.000000e+00 2.392370e-10 \
                      3.330669e-16 2.326810e-11 2.392370e-10 9.999999e-01 -4.440892e-16\n";
    assert!(kitti::parse(six_digits).unwrap()[0].rotation.angle() < 1e-6);
}

#[test]
fn bad_lines_of_trajectories_are_named() {
    let good = "# time x y z qx qy qz qw\n\n1 0 0 0 0 0 0 1\n";
    for (line, says) in [
        ("2 0 0 0 0 0 0", "ends"),
        ("2 0 0 0 0 0 0 1 0", "unexpected"),
        ("2 0 0 0 0 0 0 0", "quaternion"),
        ("2 0 0 0 3e176 0 0 1", "quaternion"),
        ("2 0 0 nan 0 0 0 1", "not finite"),
        ("2 0 0 x 0 0 0 1", "not a number"),
    ] {
        match tum::parse(&format!("{good}{line}\n")) {
            Err(Error::Parse { line: 4, reason }) => assert!(reason.contains(says), "{line}: {reason}"),
            other => panic!("{line:?} gave {other:?}"),
        }
    }
    for (line, says) in [
        ("1 0 0 0 0 1 0 0 0 0 1", "ends"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "rotation"),
        ("1 0 0 0 0 1 0.001 0 0 0 1 0", "rotation"),
        ("1e300 0 0 0 0 1 0 0 0 0 1 0", "rotation"),
        ("0 0 0 0 0 0 0 0 0 0 0 0", "rotation"),
    ] {
        match kitti::parse(&format!("1 0 0 0 0 1 0 0 0 0 1 0\n{line}\n")) {
            Err(Error::Parse { line: 2, reason }) => assert!(reason.contains(says), "{line}: {reason}"),
            other => panic!("{line:?} gave {other:?}"),
        }
    }
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), "1 0 0 0 0 0 0 1\n2 \u{e9}").unwrap();
    std::fs::write(file.path(), [b"1 0 0 0 0 0 0 1\n2 ".as_slice(), &[0xff, 0xfe]].concat()).unwrap();
    let Err(Error::InFile { path, error }) = tum::read(file.path()) else { panic!("read what is not text") };
    assert_eq!(path, file.path().display().to_string());
    assert!(matches!(*error, Error::Parse { line: 2, .. }), "{error}");
    assert!(matches!(kitti::read("no/such/file"), Err(Error::File { .. })));
}

#[test]
fn mutated_trajectories_never_panic() {
    mutate(20_000, 5);
}

#[test]
#[ignore = "a million inputs, a minute in the dev profile"]
fn a_million_mutated_trajectories_never_panic() {
    mutate(1_000_000, 6);
}

/// Reads mutated files of either format; what is accepted must be finite and a rigid motion.
fn mutate(rounds: usize, seed: u64) {
    let seeds = [tum_seed(), kitti::to_text(&poses()[..3])];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut accepted = 0;
    for round in 0..rounds {
        let mut bytes = seeds[round % 2].as_bytes().to_vec();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..3) {
                0 => bytes[at] = rng.random_range(0..=255),
                1 => drop(bytes.remove(at)),
                _ => drop(bytes.splice(at..at, b"1e999 nan -".iter().copied())),
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        let poses = if round % 2 == 0 {
            tum::parse(&text).map(|t| t.iter().map(|x| x.pose).collect())
        } else {
            kitti::parse(&text)
        };
        for pose in poses.iter().flatten() {
            accepted += 1;
            assert!((pose.rotation.norm() - 1.0).abs() < 1e-9, "{text}");
            assert!(pose.translation.vector.iter().all(|x| x.is_finite()), "{text}");
        }
    }
    println!("{accepted} poses accepted from {rounds} inputs");
    assert!(accepted > rounds / 20, "{accepted}");
}

fn tum_seed() -> String {
    let stamped: Vec<_> =
        poses()[..3].iter().map(|pose| tum::StampedPose { time: 1.5, pose: *pose }).collect();
    tum::to_text(&stamped)
}

#[test]
fn teams_are_one_graph_with_each_shared_edge_once() {
    // of the simulated team 13 edges between robots stand in one file only
    for (folder, robots, nodes, edges, across, repeated) in
        [("dm4", 4, 64, 144, 32, 32), ("dm9", 9, 72, 156, 48, 48), ("argos4_clean", 4, 440, 523, 87, 74)]
    {
        let Some(folder) = common::data(&format!("pgo/multi/{folder}")) else { return };
        let team = team::read(folder).unwrap();
        let g2o::AnyGraph::Three(graph) = &team.graph else { panic!("not in space") };
        assert_eq!((team.files.len(), graph.pose_count(), graph.factor_count()), (robots, nodes, edges));
        let joining = graph.factors().filter(|(_, f)| f.keys()[0].robot != f.keys()[1].robot).count();
        assert_eq!((joining, team.repeated_edges), (across, repeated));
        graph.check_connected().unwrap();
    }
}

#[test]
fn a_team_whose_files_disagree_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("10.g2o", "VERTEX_SE2 1 0 0 0\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n");
    write("9.g2o", "VERTEX_SE2 2 1 0 0\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\nFIX 2\n");
    write("notes.txt", "not a graph");
    let team = team::read_as::<3, nalgebra::Isometry2<f64>>(folder.path()).unwrap();
    assert!(team.files[0].ends_with("9.g2o") && team.repeated_edges == 1);
    assert_eq!((team.graph.pose_count(), team.graph.factor_count()), (2, 1));
    assert!(team.graph.is_fixed(Key::new(0, 2)));
    write("11.g2o", "VERTEX_SE2 2 1 0.5 0\n");
    match team::read(folder.path()) {
        Err(Error::Contradiction { key, first, second }) => {
            assert!(key == Key::new(0, 2) && first.ends_with("9.g2o") && second.ends_with("11.g2o"));
        }
        other => panic!("{other:?}"),
    }
    write("11.g2o", "\nFIX 77\n");
    match team::read(folder.path()) {
        Err(Error::InFile { path, error }) => {
            assert!(path.ends_with("11.g2o") && matches!(*error, Error::Parse { line: 2, .. }), "{error}");
        }
        other => panic!("{other:?}"),
    }
    assert!(matches!(team::read(folder.path().join("none")), Err(Error::File { .. })));
}

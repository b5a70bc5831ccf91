//! Trajectory errors against figures of the evo package (`tests/evo_fixture.py` writes them).

use draco_pgo::Error;
use draco_pgo::evaluation::{
    Alignment, Delta, Pairs, PoseErrors, PoseRelation, RpeParams, TrajectoryPose, align, ate, rpe,
};
use draco_pgo::io::tum;
use nalgebra::{Isometry2, Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};

/// The figures agree to this, relative to the largest error.
const TOLERANCE: f64 = 1e-9;

const FIXTURE: &str = include_str!("evo_fixture.txt");

/// A path with turns, and an estimate of it that drifts; no random numbers, so that the script that asks evo makes
/// the same one.
fn trajectories() -> (Vec<Isometry3<f64>>, Vec<Isometry3<f64>>) {
    let pose = |t: [f64; 3], r: [f64; 3]| {
        Isometry3::from_parts(
            Translation3::new(t[0], t[1], t[2]),
            UnitQuaternion::from_scaled_axis(Vector3::from(r)),
        )
    };
    (0..60)
        .map(|i| {
            let s = 0.1 * f64::from(i);
            let reference =
                pose([5.0 * s.cos(), 3.0 * s.sin(), 0.3 * s], [0.1 * s.sin(), 0.2 * s.cos(), 0.9 * s]);
            let drift = pose(
                [0.02 * s * s, 0.3 * (1.7 * s).sin(), 0.1 * (0.9 * s).cos() + 1.0],
                [0.05 * (2.1 * s).sin(), 0.04 * s, 0.03 * (1.3 * s).cos() + 0.4],
            );
            let mut estimate = drift * reference;
            estimate.translation.vector *= 0.8;
            (estimate, reference)
        })
        .unzip()
}

fn planar(poses: &[Isometry3<f64>]) -> Vec<Isometry2<f64>> {
    poses
        .iter()
        .map(|x| {
            let forward = x.rotation * Vector3::x();
            Isometry2::new(Vector2::new(x.translation.x, x.translation.y), forward.y.atan2(forward.x))
        })
        .collect()
}

fn check_line<const N: usize, G: TrajectoryPose<N>>(estimate: &[G], reference: &[G], fields: &[&str]) {
    let relation = match fields[2] {
        "translation" => PoseRelation::Translation,
        "angle" => PoseRelation::RotationAngle,
        "rotation" => PoseRelation::RotationPart,
        "full" => PoseRelation::FullTransformation,
        "distance" => PoseRelation::PointDistance,
        other => panic!("{other}"),
    };
    let alignment = match fields[3] {
        "none" => Alignment::None,
        "rigid" => Alignment::Rigid,
        "similarity" => Alignment::Similarity,
        "scale" => Alignment::Scale,
        "origin" => Alignment::Origin,
        other => panic!("{other}"),
    };
    let found: PoseErrors = if fields[1] == "ate" {
        ate(estimate, reference, relation, alignment).unwrap()
    } else {
        let (kind, which) = fields[1].split_once(':').unwrap();
        let (unit, size) = which.split_at(1);
        let delta = match unit {
            "f" => Delta::Frames(size.parse().unwrap()),
            "m" => Delta::Metres(size.parse().unwrap()),
            _ => Delta::Radians(size.parse().unwrap()),
        };
        let pairs = if kind == "rpe" { Pairs::Consecutive } else { Pairs::All { tolerance: 0.1 } };
        rpe(estimate, reference, &RpeParams { relation, delta, pairs, alignment }).unwrap()
    };
    let count: usize = fields[4].parse().unwrap();
    let expected: Vec<f64> = fields[5..].iter().map(|x| x.parse().unwrap()).collect();
    let s = found.statistics();
    assert_eq!(found.errors.len(), count, "{fields:?}");
    let got = [s.rmse, s.mean, s.median, s.std, s.min, s.max, s.sse];
    for (got, expected) in got.iter().zip(&expected) {
        let scale = expected.abs().max(s.max).max(1.0);
        assert!((got - expected).abs() <= TOLERANCE * scale, "{fields:?}: {got} instead of {expected}");
    }
}

#[test]
fn errors_are_those_of_evo() {
    let (estimate, reference) = trajectories();
    let (flat_estimate, flat_reference) = (planar(&estimate), planar(&reference));
    let mut lines = 0;
    for line in FIXTURE.lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<&str> = line.split(' ').collect();
        match fields[0] {
            "space" => check_line(&estimate, &reference, &fields),
            _ => check_line(&flat_estimate, &flat_reference, &fields),
        }
        lines += 1;
    }
    assert!(lines >= 60, "the fixture lost its lines");
}

/// Writes the trajectories for the script that asks evo.
#[test]
#[ignore = "prints the trajectories of the fixture"]
fn print_trajectories() {
    let stamped = |poses: &[Isometry3<f64>]| -> Vec<tum::StampedPose> {
        poses.iter().enumerate().map(|(i, pose)| tum::StampedPose { time: i as f64, pose: *pose }).collect()
    };
    let folder = std::env::temp_dir();
    let (estimate, reference) = trajectories();
    tum::write(&stamped(&estimate), folder.join("space_estimate.tum")).unwrap();
    tum::write(&stamped(&reference), folder.join("space_reference.tum")).unwrap();
    let lift =
        |poses: &[Isometry3<f64>]| planar(poses).iter().map(TrajectoryPose::to_isometry3).collect::<Vec<_>>();
    tum::write(&stamped(&lift(&estimate)), folder.join("plane_estimate.tum")).unwrap();
    tum::write(&stamped(&lift(&reference)), folder.join("plane_reference.tum")).unwrap();
}

#[test]
fn a_moved_trajectory_has_no_error_after_alignment() {
    let (_, reference) = trajectories();
    let by = Isometry3::new(Vector3::new(3.0, -2.0, 7.0), Vector3::new(0.4, -2.0, 1.0));
    let moved: Vec<_> = reference.iter().map(|x| by * x).collect();
    let found = ate(&moved, &reference, PoseRelation::FullTransformation, Alignment::Rigid).unwrap();
    assert!(found.statistics().max < 1e-12);
    let back = align(&moved, &reference, Alignment::Similarity).unwrap();
    assert!((back.scaling() - 1.0).abs() < 1e-12 && (back.isometry * by).translation.vector.norm() < 1e-11);
}

#[test]
fn bad_trajectories_are_named() {
    let (mut estimate, reference) = trajectories();
    let run =
        |a: &[Isometry3<f64>], b: &[Isometry3<f64>]| ate(a, b, PoseRelation::default(), Alignment::default());
    assert_eq!(run(&estimate[1..], &reference), Err(Error::Lengths { estimate: 59, reference: 60 }));
    assert_eq!(run(&[], &[]), Err(Error::EmptyGraph));
    assert_eq!(run(&reference[..2], &reference[..2]), Err(Error::Alignment));
    let rest = vec![reference[0]; 9];
    assert_eq!(run(&rest, &reference[..9]), Err(Error::Alignment));
    let params = RpeParams { delta: Delta::Metres(1e3), ..RpeParams::default() };
    assert_eq!(rpe(&estimate, &reference, &params), Err(Error::NoPairs { delta: 1e3 }));
    let params = RpeParams { delta: Delta::Frames(0), ..RpeParams::default() };
    assert_eq!(rpe(&estimate, &reference, &params), Err(Error::Parameter { name: "delta", value: 0.0 }));
    estimate[7].translation.x = f64::NAN;
    assert_eq!(run(&estimate, &reference), Err(Error::Trajectory { trajectory: "estimate", index: 7 }));
}

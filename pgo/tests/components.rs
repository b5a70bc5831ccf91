//! Several parts in one graph, and poses that nothing holds.

use std::sync::Arc;

use draco_lie::LieGroup;
use draco_pgo::{
    CustomFactor, Error, Gauge, Kernel, Key, Method, PoseGraph2, SolveParams, Start, Termination, solve,
};
use nalgebra::{Isometry2, Matrix3, Vector2};

fn at(x: f64, y: f64, angle: f64) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(x, y), angle)
}

/// Two robots of four poses each, not linked; guesses are off.
fn two_robots() -> PoseGraph2 {
    let mut graph = PoseGraph2::new();
    for robot in 0..2 {
        for i in 0..4 {
            let key = Key::new(robot, i);
            graph.add_pose(key, at(1.1 * i as f64, f64::from(robot), 0.1)).unwrap();
            if i > 0 {
                let last = Key::new(robot, i - 1);
                let information = Matrix3::from_diagonal_element(10.0);
                graph.add_between(last, key, at(1.0, 0.0, 0.0), information, Kernel::None).unwrap();
            }
        }
    }
    graph
}

#[test]
fn each_part_keeps_its_first_pose() {
    let graph = two_robots();
    for method in [Method::GaussNewton, Method::LevenbergMarquardt, Method::Dogleg] {
        let solution = solve(&graph, &SolveParams { method, ..SolveParams::default() }).unwrap();
        assert_eq!(solution.held, [Key::new(0, 0), Key::new(1, 0)]);
        assert!(solution.final_cost < 1e-18 && solution.termination == Termination::Converged);
        for robot in 0..2 {
            let first = graph.pose(Key::new(robot, 0)).unwrap();
            assert_eq!(solution.pose(Key::new(robot, 0)), Some(first));
            let last = solution.pose(Key::new(robot, 3)).unwrap();
            assert!(first.between(last).minus(&at(3.0, 0.0, 0.0)).amax() < 1e-9);
        }
    }
}

#[test]
fn a_part_that_hangs_loose_is_named() {
    let mut graph = two_robots();
    let require = SolveParams { gauge: Gauge::Require, ..SolveParams::default() };
    let loose = |graph: &PoseGraph2| solve(graph, &require).err();
    assert_eq!(loose(&graph), Some(Error::NoGauge { key: Key::new(0, 0), size: 4 }));
    graph.set_fixed(Key::new(0, 2), true).unwrap();
    assert_eq!(loose(&graph), Some(Error::NoGauge { key: Key::new(1, 0), size: 4 }));
    graph.add_prior(Key::new(1, 3), at(0.0, 0.0, 0.0), Matrix3::identity(), Kernel::None).unwrap();
    let solution = solve(&graph, &require).unwrap();
    assert!(solution.held.is_empty());
    assert_eq!(solution.pose(Key::new(0, 2)), graph.pose(Key::new(0, 2)));
    assert!(solution.pose(Key::new(1, 3)).unwrap().minus(&at(0.0, 0.0, 0.0)).amax() < 1e-9);
}

/// The distance between two poses: leaves bearing and heading open.
#[derive(Debug)]
struct Distance {
    keys: [Key; 2],
    measured: f64,
}

impl CustomFactor<Isometry2<f64>, 3> for Distance {
    fn keys(&self) -> &[Key] {
        &self.keys
    }

    fn dimension(&self) -> usize {
        1
    }

    fn residual(&self, poses: &[Isometry2<f64>], residual: &mut [f64]) {
        let step = poses[1].translation.vector - poses[0].translation.vector;
        residual[0] = (step.norm() - self.measured) / 0.1;
    }

    fn jacobian(&self, poses: &[Isometry2<f64>], which: usize, jacobian: &mut [f64]) {
        let step = (poses[1].translation.vector - poses[0].translation.vector).normalize();
        // the translation of the tangent is in the body frame
        let own = poses[which].rotation.inverse() * step * if which == 0 { -10.0 } else { 10.0 };
        jacobian.copy_from_slice(&[own.x, own.y, 0.0]);
    }
}

#[test]
fn user_defined_factors_count_and_an_undetermined_pose_is_named() {
    let mut graph = two_robots();
    let link = |a, b, measured| Arc::new(Distance { keys: [a, b], measured });
    let (tag, beacon) = (Key::new(1, 2), Key::new(2, 0));
    for (i, measured) in [(0, 5.0), (3, 4.0)] {
        graph.add_custom(link(Key::new(0, i), tag, measured), Kernel::None).unwrap();
    }
    let solution = solve(&graph, &SolveParams::default()).unwrap();
    let distance = |i| {
        let [a, b] = [Key::new(0, i), tag].map(|key| solution.pose(key).unwrap().translation.vector);
        (a - b).norm()
    };
    assert!(solution.final_cost < 1e-9, "{solution:?}");
    assert!((distance(0) - 5.0).abs() < 1e-6 && (distance(3) - 4.0).abs() < 1e-6);
    // two distances leave robot 1 free to turn; once it is held, the beacon alone is not determined, by one distance
    graph.set_fixed(Key::new(1, 0), true).unwrap();
    graph.add_pose(beacon, at(2.0, 2.0, 0.0)).unwrap();
    graph.add_custom(link(Key::new(0, 1), beacon, 2.0), Kernel::None).unwrap();
    let params = SolveParams { method: Method::GaussNewton, start: Start::Given, ..SolveParams::default() };
    assert_eq!(solve(&graph, &params).err(), Some(Error::Indefinite { key: beacon }));
}

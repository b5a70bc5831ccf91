//! Costs by the definitions of other libraries against published figures.

mod common;

use draco_lie::LieGroup;
use draco_pgo::evaluation::{Objective, TrajectoryPose, objective};
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{
    ChordalPose, Kernel, Key, PoseGraph, PoseGraph3, StaircaseParams, chordal, solve, staircase,
};
use nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector3, Vector6};

/// Costs of a set at its chordal optimum and at its own.
struct Costs {
    chordal_at_chordal: f64,
    log_at_chordal: f64,
    log_at_log: f64,
    g2o_at_log: f64,
    split_at_log: f64,
}

fn costs(name: &str) -> Option<Costs> {
    let path = common::data(&format!("pgo/{name}.g2o"))?;
    Some(match g2o::read(path).unwrap() {
        AnyGraph::Two(graph) => of(graph),
        AnyGraph::Three(graph) => of(graph),
    })
}

fn of<const N: usize, G: TrajectoryPose<N> + ChordalPose<N>>(mut graph: PoseGraph<G, N>) -> Costs {
    chordal(&mut graph).unwrap();
    let at = |graph: &PoseGraph<G, N>, which| objective(graph, which).unwrap();
    let found = staircase(&graph, &StaircaseParams::default()).unwrap();
    graph.update(&found.solution);
    let (chordal_at_chordal, log_at_chordal) = (at(&graph, Objective::Chordal), at(&graph, Objective::Log));
    let solution = solve(&graph, &draco_pgo::SolveParams::default()).unwrap();
    graph.update(&solution);
    let log_at_log = at(&graph, Objective::Log);
    assert!((log_at_log - graph.cost()).abs() <= 1e-12 * log_at_log);
    Costs {
        chordal_at_chordal,
        log_at_chordal,
        log_at_log,
        g2o_at_log: at(&graph, Objective::G2o),
        split_at_log: at(&graph, Objective::Split),
    }
}

#[test]
fn published_costs_are_reproduced() {
    // the chordal optimum, the best known cost of the logarithm
    for (name, chordal, log) in [
        ("tinyGrid3D", 18.519366, 9.3139094),
        ("smallGrid3D", 1025.3981, 517.92533),
        ("CSAIL", 31.703716, 20.275442),
        ("intel", 52.348227, 22.502116),
        ("parking-garage", 1.2625244, 0.6341924),
    ] {
        let Some(costs) = costs(name) else { return };
        assert!(
            (costs.chordal_at_chordal - chordal).abs() <= 1e-7 * chordal,
            "{name}: {}",
            costs.chordal_at_chordal
        );
        assert!(costs.log_at_log <= log * (1.0 + 1e-6), "{name}: {}", costs.log_at_log);
        let planar = ["CSAIL", "intel"].contains(&name);
        if planar {
            assert_eq!(costs.g2o_at_log, costs.split_at_log);
        }
        assert!(
            costs.split_at_log > 0.9 * log && costs.split_at_log < 1.2 * log,
            "{name}: {}",
            costs.split_at_log
        );
    }
}

#[test]
fn the_chordal_optimum_of_csail_costs_what_its_correlated_information_says() {
    let Some(costs) = costs("CSAIL") else { return };
    assert!((costs.log_at_chordal - 10082.0).abs() < 1.0, "{}", costs.log_at_chordal);
}

#[test]
fn residuals_are_those_of_their_definitions() {
    let z = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5));
    let error = Isometry3::from_parts(
        Vector3::new(0.4, -0.3, 0.2).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(1.0, 2.0, -1.5)),
    );
    let mut graph = PoseGraph3::new();
    let start = Isometry3::new(Vector3::new(-3.0, 0.5, 2.0), Vector3::new(-0.6, 0.1, 0.9));
    graph.add_pose(Key::new(0, 0), start).unwrap();
    graph.add_pose(Key::new(0, 1), start * z * error).unwrap();
    let omega = Matrix6::from_diagonal(&Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0));
    graph.add_between(Key::new(0, 0), Key::new(0, 1), z, omega, Kernel::None).unwrap();
    let cost = |e: Vector6<f64>| 0.5 * e.dot(&(omega * e));
    let stack = |a: Vector3<f64>, b: Vector3<f64>| Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
    let (t, axis) = (error.translation.vector, error.rotation.scaled_axis());
    let half = axis.normalize() * (0.5 * axis.norm()).sin();
    let r = |x: &Isometry3<f64>| x.rotation.to_rotation_matrix().into_inner();
    let turned = (r(&(start * z * error)) - r(&start) * r(&z)).norm_squared();
    let kappa = 1.5 / (1.0 / 4.0 + 1.0 / 5.0 + 1.0 / 6.0);
    let tau = 3.0 / (1.0 + 1.0 / 2.0 + 1.0 / 3.0);
    for (which, expected) in [
        (Objective::Log, cost(error.log())),
        (Objective::G2o, cost(stack(t, half))),
        (Objective::Split, cost(stack(t, axis))),
        (Objective::Chordal, kappa * turned + tau * t.norm_squared()),
    ] {
        let found = objective(&graph, which).unwrap();
        assert!((found - expected).abs() < 1e-12 * expected, "{which:?}: {found} instead of {expected}");
    }
}

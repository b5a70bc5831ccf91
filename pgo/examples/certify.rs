//! Is the map globally optimal, or did the solver end in a valley? A ring of poses, from a good and a wound start.

use draco_pgo::{Kernel, Key, PoseGraph2, SolveParams, certify, chordal, chordal_objective, solve};
use nalgebra::{Isometry2, Matrix3, Vector2};

const POSES: u64 = 20;

fn main() -> Result<(), draco_pgo::Error> {
    println!("start     objective   certified");
    let turn = std::f64::consts::TAU / POSES as f64;
    // headings that wind once too often around the ring are a valley of their own
    let mut graph = ring(|i| 2.0 * turn * i as f64)?;
    report("wound", &graph)?;
    chordal(&mut graph)?;
    report("chordal", &graph)
}

fn ring(heading: impl Fn(u64) -> f64) -> Result<PoseGraph2, draco_pgo::Error> {
    let mut graph = PoseGraph2::new();
    for i in 0..POSES {
        graph.add_pose(Key::new(0, i), Isometry2::new(Vector2::zeros(), heading(i)))?;
    }
    let step = Isometry2::new(Vector2::new(1.0, 0.02), std::f64::consts::TAU / POSES as f64 + 0.01);
    for i in 0..POSES {
        let (a, b) = (Key::new(0, i), Key::new(0, (i + 1) % POSES));
        graph.add_between(a, b, step, Matrix3::from_diagonal_element(100.0), Kernel::None)?;
    }
    Ok(graph)
}

fn report(start: &str, graph: &PoseGraph2) -> Result<(), draco_pgo::Error> {
    let mut graph = graph.clone();
    let solution = solve(&chordal_objective(&graph)?, &SolveParams::default())?;
    graph.update(&solution);
    let certificate = certify(&graph)?;
    let verdict = match certificate.slack {
        Some(slack) => format!("yes, no eigenvalue below -{slack:e}"),
        None => "no".into(),
    };
    println!("{start:8}  {:9.4}   {verdict}", certificate.objective);
    Ok(())
}

//! What does optimisation do to a map? A g2o file (or, without one, a noisy drive round the blocks of a town) before
//! and after, as one picture.
//!
//! `draw_g2o [FILE.g2o [PICTURE.svg]]`; the picture goes to the temporary folder by default.

use std::fmt::Write as _;

use draco_lie::LieGroup;
use draco_pgo::evaluation::TrajectoryPose;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{ChordalPose, Kernel, Key, Measurement, PoseGraph, PoseGraph2, SolveParams, chordal, solve};
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let graph = arguments.next().map_or_else(|| town().map(AnyGraph::Two), g2o::read)?;
    let picture = arguments.next().map_or_else(|| std::env::temp_dir().join("draw_g2o.svg"), Into::into);
    let svg = match graph {
        AnyGraph::Two(graph) => optimise(graph)?,
        AnyGraph::Three(graph) => optimise(graph)?,
    };
    std::fs::write(&picture, svg)?;
    println!("picture: {}", picture.display());
    Ok(())
}

fn optimise<const N: usize, G: ChordalPose<N> + TrajectoryPose<N>>(
    before: PoseGraph<G, N>,
) -> Result<String, draco_pgo::Error> {
    let mut after = before.clone();
    chordal(&mut after)?;
    let solution = solve(&after, &SolveParams::default())?;
    after.update(&solution);
    println!("{} poses, {} measurements", before.pose_count(), before.factor_count());
    println!(
        "cost {:.1} before, {:.4} after {} iterations",
        before.cost(),
        after.cost(),
        solution.iterations
    );
    let mut svg = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 1240 640' font-family='sans-serif' font-size='18'>\
         <rect width='1240' height='640' fill='white'/>\n",
    );
    panel(&mut svg, &before, 20.0, "before");
    panel(&mut svg, &after, 640.0, "after");
    svg.push_str("</svg>\n");
    Ok(svg)
}

/// One graph from above: odometry dark, loop closures light.
fn panel<const N: usize, G: TrajectoryPose<N>>(
    svg: &mut String,
    graph: &PoseGraph<G, N>,
    left: f64,
    title: &str,
) {
    let at = |key: Key| graph.pose(key).map(|pose| pose.to_isometry3().translation.vector.xy());
    let points: Vec<Vector2<f64>> = graph.poses().filter_map(|(key, _)| at(key)).collect();
    let low = points.iter().fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(b));
    let high = points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
    let scale = 560.0 / (high - low).max().max(1e-9);
    let place = |p: Vector2<f64>| (left + 10.0 + (p.x - low.x) * scale, 620.0 - (p.y - low.y) * scale);
    let [mut closures, mut odometry] = [String::new(), String::new()];
    for (_, factor) in graph.factors() {
        let Measurement::Between { from, to, .. } = &factor.measurement else { continue };
        let Some((a, b)) = at(*from).zip(at(*to)) else { continue };
        let next = from.robot == to.robot && from.index.abs_diff(to.index) == 1;
        let ((x0, y0), (x1, y1)) = (place(a), place(b));
        // writing to a string cannot fail
        let _ = write!(if next { &mut odometry } else { &mut closures }, "M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}");
    }
    let _ = writeln!(svg, "<text x='{}' y='30'>{title}</text>", left + 10.0);
    let _ = writeln!(svg, "<path d='{closures}' stroke='#e08030' stroke-width='0.7' fill='none'/>");
    let _ = writeln!(svg, "<path d='{odometry}' stroke='#204080' stroke-width='1.2' fill='none'/>");
}

/// A drive of 1200 steps on a grid of streets, with closures wherever it comes by a place again.
fn town() -> Result<PoseGraph2, draco_pgo::Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
    let sigma = Vector3::new(0.04, 0.04, 0.01);
    let information = Matrix3::from_diagonal(&sigma.map(|s| 1.0 / (s * s)));
    let mut truth = vec![Isometry2::identity()];
    for i in 1..1200 {
        let turns = [0.0, 0.0, std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2];
        let turn = if i % 5 == 0 { turns[rng.random_range(0..4)] } else { 0.0 };
        truth.push(truth[i - 1] * Isometry2::new(Vector2::new(1.0, 0.0), turn));
    }
    let mut noise = || sigma.map(|s| s * rng.sample::<f64, _>(rand_distr::StandardNormal));
    let mut graph = PoseGraph2::new();
    let key = |i: usize| Key::new(0, i as u64);
    let mut at = truth[0];
    graph.add_pose(key(0), at)?;
    for i in 1..truth.len() {
        let z = truth[i - 1].between(&truth[i]).plus(&noise());
        at *= z;
        graph.add_pose(key(i), at)?;
        graph.add_between(key(i - 1), key(i), z, information, Kernel::None)?;
        let near = |j: &usize| (truth[*j].translation.vector - truth[i].translation.vector).norm() < 0.5;
        if let Some(j) = (0..i.saturating_sub(20)).find(near) {
            let z = truth[j].between(&truth[i]).plus(&noise());
            graph.add_between(key(j), key(i), z, information, Kernel::None)?;
        }
    }
    Ok(graph)
}

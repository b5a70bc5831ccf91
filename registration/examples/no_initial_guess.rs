//! How does a 3-D shape lie when nothing is known about its pose?
//!
//! `no_initial_guess [MODEL DATA]` reads two point files (PLY, PCD, VTK or text columns), such as the bunny of
//! Go-ICP; without them a lumpy shape is made up.

use std::path::Path;

use draco_registration::global::{SearchParams3, branch_and_bound_3d};
use draco_registration::{Cloud, Target, io::read_points};
use nalgebra::{Isometry3, Point3, Vector3};

fn main() -> anyhow::Result<()> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let (model, data) = match files.as_slice() {
        [] => {
            let pose = Isometry3::new(Vector3::new(0.2, -0.1, 0.3), Vector3::new(1.5, -0.8, 2.0));
            let seen = shape(0.5).into_iter().map(|p| pose.inverse_transform_point(&Point3::from(p)).coords);
            (shape(0.0), seen.collect())
        }
        [model, data] => (read_points(Path::new(model))?, read_points(Path::new(data))?),
        _ => anyhow::bail!("usage: no_initial_guess [MODEL DATA]"),
    };
    let size = model.iter().map(|p| p.norm()).fold(0.0, f64::max);
    let source = Cloud::new(data)?;
    // a gap of (3 % of the size)², as the demonstration of Go-ICP has it
    let params = SearchParams3::all_rotations(0.5 * size, 1e-3 * size * size);
    let found =
        branch_and_bound_3d(&Target::new(&Cloud::new(model)?)?, &source, &Isometry3::identity(), &params)?;
    let found = found.best();
    println!("{}", found.target_from_source);
    println!("root mean square distance {:.4} m over {} points", found.cost.sqrt(), source.len());
    println!("{} boxes; no pose is better than {:.4} m", found.nodes, found.lower_bound.sqrt());
    println!("certified within the gap: {}", found.certified);
    Ok(())
}

/// An uneven lump, about 1 m in size.
fn shape(phase: f64) -> Vec<Vector3<f64>> {
    (0..2000)
        .map(|i| {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5 + 0.3 * phase) / 2000.0;
            let turn = f64::from(i) * 2.399_963 + phase;
            let flat = (1.0 - z * z).sqrt();
            let radius = 0.6 + 0.2 * (2.0 * turn).cos() * flat + 0.15 * z + 0.1 * turn.sin() * flat;
            radius * Vector3::new(flat * turn.cos(), flat * turn.sin(), 0.7 * z)
        })
        .collect()
}

//! Can the answer be trusted along every direction? A scan in a corridor says "I can slide".

use draco_registration::{Cloud, IcpParams, Target};
use nalgebra::{Isometry2, Vector2};

fn main() -> anyhow::Result<()> {
    for (name, end_wall) in [("corridor", false), ("corridor with an end wall", true)] {
        let here = scan(Isometry2::identity(), end_wall, 1);
        let there = scan(Isometry2::new(Vector2::new(0.5, 0.2), 0.1), end_wall, 2);
        let target = Target::new(&Cloud::new(here)?.estimate_normals(8, &Vector2::zeros())?)?;
        let source = Cloud::new(there)?.estimate_normals(8, &Vector2::zeros())?;
        let found = target.align(&source, &Isometry2::identity(), &IcpParams::laser_2d())?;
        println!("{name}: {}", found.target_from_source);
        if found.degenerate_directions.is_empty() {
            let sigma = found.covariance.diagonal().map(f64::sqrt);
            println!("  fixed: ± {:.3} m, ± {:.3} m, ± {:.4} rad", sigma.x, sigma.y, sigma.z);
        }
        for d in &found.degenerate_directions {
            println!(
                "  I can slide: [{:+.2}, {:+.2}] m with {:+.3} rad in the frame of the source",
                d.x, d.y, d.z
            );
        }
    }
    Ok(())
}

/// What a laser sees between two walls 3 m apart, with 2 cm of repeatable noise.
fn scan(pose: Isometry2<f64>, end_wall: bool, seed: u32) -> Vec<Vector2<f64>> {
    let mut state = seed;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        0.07 * (f64::from(state) / f64::from(u32::MAX) - 0.5)
    };
    let mut points = Vec::new();
    for beam in 0..360 {
        let angle = f64::from(beam).to_radians();
        let direction = pose.rotation * Vector2::new(angle.cos(), angle.sin());
        let side = if direction.y > 0.0 { 1.5 } else { -1.5 };
        let mut range = (side - pose.translation.y) / direction.y;
        if end_wall && direction.x > 0.0 {
            range = range.min((8.0 - pose.translation.x) / direction.x);
        }
        if (0.0..20.0).contains(&range) {
            points.push((range + noise()) * Vector2::new(angle.cos(), angle.sin()));
        }
    }
    points
}

//! Where is a beacon when two in five ranges are wrong? Keeps the largest set of which every four ranges agree.

use std::time::Instant;

use draco_consistency::{Pose, Range, RangeParams, Trajectory, isotropic_covariance, range_consistency};
use nalgebra::{Isometry2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let poses: Vec<Isometry2<f64>> = (0..60)
        .map(|k| {
            let t = f64::from(k) * 0.1;
            Isometry2::planar(8.0 * t.cos() + 2.0 * t, 8.0 * (1.3 * t).sin(), t)
        })
        .collect();
    let step = isotropic_covariance::<3, Isometry2<f64>>(0.005, 0.0005);
    let trajectory = Trajectory::from_steps(poses.clone(), &[step; 59])?;
    let beacon = Vector2::new(6.0, 14.0);
    let noise = Normal::new(0.0, 0.1)?;
    let mut is_true = Vec::new();
    let mut ranges = Vec::new();
    for (pose, p) in poses.iter().enumerate() {
        let outlier = rng.random_bool(0.4);
        let distance = (beacon - p.translation.vector).norm() + noise.sample(&mut rng);
        let range = if outlier { rng.random_range(1.0..35.0) } else { distance };
        ranges.push(Range { pose, range, sigma: 0.1 });
        is_true.push(!outlier);
    }

    let start = Instant::now();
    let params = RangeParams { probability: 0.9999, ..RangeParams::default() };
    let found = range_consistency(&trajectory, &ranges, &params)?;
    let accepted = &found.selection.accepted;
    let right = accepted.iter().filter(|&&m| is_true[m]).count();
    println!("60 ranges, {} of them true", is_true.iter().filter(|t| **t).count());
    println!("accepted {}, of which true {right}; proved largest: {}", accepted.len(), found.optimal);
    println!("tests of two {}, of four {} (of 487635 possible)", found.tests[2], found.tests[4]);
    println!("{:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    Ok(())
}

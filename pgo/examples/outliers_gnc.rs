//! How many false loop closures can a map stand? A Manhattan-like drive with a share of random closures, by plain
//! least squares and by graduated non-convexity.

use draco_lie::LieGroup;
use draco_pgo::{GncParams, Kernel, Key, PoseGraph2, SolveParams, gnc, solve};
use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};

const POSES: u64 = 400;

fn main() -> Result<(), draco_pgo::Error> {
    println!("outliers  found  precision  recall  rms plain [m]  rms gnc [m]");
    for share in [0.0, 0.5, 0.7, 0.9] {
        experiment(share)?;
    }
    Ok(())
}

fn truth(index: u64) -> Isometry2<f64> {
    let mut pose = Isometry2::identity();
    for i in 0..index {
        let turn =
            if i % 10 == 9 { std::f64::consts::FRAC_PI_2 * if i % 40 < 30 { 1.0 } else { 2.0 } } else { 0.0 };
        pose *= Isometry2::new(Vector2::new(1.0, 0.0), turn);
    }
    pose
}

fn experiment(share: f64) -> Result<(), draco_pgo::Error> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let sigma = Vector3::new(0.03, 0.03, 0.005);
    let information = Matrix3::from_diagonal(&sigma.map(|s| 1.0 / (s * s)));
    let poses: Vec<Isometry2<f64>> = (0..POSES).map(truth).collect();
    let mut noise = || sigma.map(|s| s * rng.sample::<f64, _>(rand_distr::StandardNormal));
    let mut graph = PoseGraph2::new();
    let mut params = GncParams::default();
    let mut at = Isometry2::identity();
    graph.add_pose(Key::new(0, 0), at)?;
    for i in 1..POSES {
        let z = poses[i as usize - 1].between(&poses[i as usize]).plus(&noise());
        at *= z;
        graph.add_pose(Key::new(0, i), at)?;
        let id = graph.add_between(Key::new(0, i - 1), Key::new(0, i), z, information, Kernel::None)?;
        params.known_inliers.insert(id);
    }
    let mut right = Vec::new();
    for i in 0..POSES {
        for j in (i + 10..POSES).step_by(3) {
            let z = poses[i as usize].between(&poses[j as usize]);
            if z.translation.vector.norm() < 1.5 && right.len() < 150 {
                let z = z.plus(&noise());
                right.push(graph.add_between(
                    Key::new(0, i),
                    Key::new(0, j),
                    z,
                    information,
                    Kernel::None,
                )?);
            }
        }
    }
    let wrong = (right.len() as f64 * share / (1.0 - share)).round() as usize;
    for _ in 0..wrong {
        let (i, j) = (rng.random_range(0..POSES / 2), rng.random_range(POSES / 2 + 2..POSES));
        let xi = Vector3::new(
            rng.random_range(-5.0..5.0),
            rng.random_range(-5.0..5.0),
            rng.random_range(-3.0..3.0),
        );
        graph.add_between(Key::new(0, i), Key::new(0, j), Isometry2::exp(&xi), information, Kernel::None)?;
    }
    let plain = solve(&graph, &SolveParams::default())?;
    let robust = gnc(&graph, &params)?;
    let rms = |pose: &dyn Fn(Key) -> Option<Isometry2<f64>>| {
        let error = |i: u64| {
            pose(Key::new(0, i))
                .map_or(0.0, |x| (x.translation.vector - poses[i as usize].translation.vector).norm_squared())
        };
        ((0..POSES).map(error).sum::<f64>() / POSES as f64).sqrt()
    };
    let kept = robust.inliers.iter().filter(|id| !params.known_inliers.contains(id)).count();
    let true_kept = robust.inliers.iter().filter(|id| right.contains(id)).count();
    println!(
        "{:7.0} %  {kept:5}  {:9.3}  {:6.3}  {:13.3}  {:11.3}",
        100.0 * share,
        true_kept as f64 / kept.max(1) as f64,
        true_kept as f64 / right.len() as f64,
        rms(&|key| plain.pose(key).copied()),
        rms(&|key| robust.solution.pose(key).copied()),
    );
    Ok(())
}

//! True pairs pass at the stated confidence, with independent and with odometry-correlated errors.

use draco_consistency::{Closure, PairTest, Pose, PoseKey, Trajectories, Trajectory, isotropic_covariance};
use nalgebra::{Isometry2, Isometry3, SVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const TRIALS: usize = 20_000;

fn noise<const N: usize, G: Pose<N>>(sigma: (f64, f64), rng: &mut ChaCha8Rng) -> SVector<f64, N> {
    SVector::from_fn(|row, _| {
        let z: f64 = StandardNormal.sample(rng);
        z * if row < G::TRANSLATION { sigma.0 } else { sigma.1 }
    })
}

/// Share of true pairs that pass.
fn accepted<const N: usize, G: Pose<N>>(
    step: (f64, f64),
    registration: (f64, f64),
    same_robot: bool,
    probability: f64,
) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let curve =
        |k: usize, shift: f64| G::planar(2.0 * k as f64, (0.2 * k as f64 + shift).sin(), 0.1 * k as f64);
    let covariance = isotropic_covariance::<N, G>(step.0, step.1);
    let passed = (0..TRIALS)
        .filter(|_| {
            let mut trajectories = Trajectories::new();
            let truth: Vec<Vec<G>> = (0..2).map(|r| (0..12).map(|k| curve(k, r as f64)).collect()).collect();
            for (robot, path) in truth.iter().enumerate() {
                let mut poses = vec![G::identity()];
                for pair in path.windows(2) {
                    let step = pair[0].between(&pair[1]).plus(&noise::<N, G>(step, &mut rng));
                    poses.push(poses[poses.len() - 1].compose(&step));
                }
                let t = Trajectory::from_steps(poses, &vec![covariance; path.len() - 1]).unwrap();
                trajectories.insert(robot as u32, t);
            }
            let other = usize::from(!same_robot);
            let mut closure = |k: usize, i: usize| {
                let z = truth[other][i].between(&truth[0][k]).plus(&noise::<N, G>(registration, &mut rng));
                Closure {
                    source: PoseKey::new(0, k),
                    target: PoseKey::new(other as u32, i),
                    target_from_source: z,
                    covariance: isotropic_covariance::<N, G>(registration.0, registration.1),
                }
            };
            // one of the two is told the other way round; within one robot the two loops share odometry
            let (first, second) = (closure(10, 1), closure(7, 4).reversed());
            PairTest::new(&trajectories, &[first, second], probability).unwrap().agree(0, 1)
        })
        .count();
    passed as f64 / TRIALS as f64
}

fn holds<const N: usize, G: Pose<N>>() {
    for probability in [0.90, 0.99] {
        for (name, step, registration, same_robot) in [
            ("registration alone", (1e-6, 1e-7), (0.15, 0.01), false),
            ("odometry and registration", (0.1, 0.005), (0.1, 0.005), false),
            ("two loops of one robot", (0.1, 0.005), (0.05, 0.002), true),
        ] {
            let share = accepted::<N, G>(step, registration, same_robot, probability);
            assert!((share - probability).abs() < 0.01, "{name}: {share} accepted at {probability}");
        }
    }
}

#[test]
fn true_pairs_pass_at_the_stated_confidence_in_the_plane() {
    holds::<3, Isometry2<f64>>();
}

#[test]
fn true_pairs_pass_at_the_stated_confidence_in_space() {
    holds::<6, Isometry3<f64>>();
}

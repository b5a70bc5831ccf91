//! Residuals of votes against simulated drift, noise and bias: the map-frame algebra by Monte Carlo.

use nalgebra::{Isometry2, Matrix3, SMatrix, SVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use draco_lie::LieGroup;

use super::clusters::Cluster;
use super::frames::Frames;
use super::params::{GcmParams, Sigma};
use super::problem::Problem;
use super::votes::{Kind, Votes};
use crate::{Closure2, Pose, PoseKey, Trajectories2, Trajectory, isotropic_covariance};

const POSES: usize = 20;
const STEP: (f64, f64) = (0.02, 0.002);
const NOISE: (f64, f64) = (0.1, 0.01);
const BIAS: (f64, f64) = (0.1, 0.005);

/// Source robot, target robot, pose pairs of a group.
type Meeting = (u32, u32, [(usize, usize); 2]);
const MEETINGS: [Meeting; 3] =
    [(0, 1, [(5, 3), (6, 4)]), (0, 2, [(12, 8), (13, 8)]), (1, 2, [(10, 14), (11, 15)])];

fn world(robot: u32, k: usize) -> Isometry2<f64> {
    let (r, k) = (f64::from(robot), k as f64);
    Isometry2::planar(3.0 * k + 2.0 * r, 0.05 * (r + 1.0) * k * k, 0.4 * (0.2 * k).sin() + 0.7 * r)
}

fn covariance(sigma: (f64, f64)) -> Matrix3<f64> {
    isotropic_covariance::<3, Isometry2<f64>>(sigma.0, sigma.1)
}

/// Believed paths and closures; `draw` gives an error of the sigmas told.
fn observed(mut draw: impl FnMut((f64, f64)) -> SVector<f64, 3>) -> (Trajectories2, Vec<Closure2>) {
    let mut trajectories = Trajectories2::new();
    for robot in 0..3 {
        let mut poses = vec![Isometry2::identity()];
        for k in 1..POSES {
            let step = world(robot, k - 1).between(&world(robot, k)).plus(&draw(STEP));
            poses.push(poses[k - 1] * step);
        }
        trajectories.insert(robot, Trajectory::from_steps(poses, &[covariance(STEP); POSES - 1]).unwrap());
    }
    let mut closures = Vec::new();
    for (r, q, pairs) in MEETINGS {
        let place = pairs.iter().map(|&(k, _)| world(r, k).position()).sum::<SVector<f64, 3>>() / 2.0;
        let centre = Isometry2::exp(&place);
        let bias = centre * Isometry2::exp(&draw(BIAS)) * LieGroup::inverse(&centre);
        for (k, i) in pairs {
            let z = LieGroup::inverse(&world(q, i)) * bias * world(r, k);
            closures.push(Closure2 {
                source: PoseKey::new(r, k),
                target: PoseKey::new(q, i),
                target_from_source: z.plus(&draw(NOISE)),
                covariance: covariance(NOISE),
            });
        }
    }
    (trajectories, closures)
}

/// The votes of the three groups linearised about the truth.
fn votes(trajectories: &Trajectories2, closures: &[Closure2], params: &GcmParams) -> Votes<3> {
    let mut problem = Problem::new(trajectories, closures, &[], params).unwrap();
    problem.noise_scale = 1.0;
    problem.clusters = MEETINGS
        .iter()
        .zip([0, 2, 4])
        .map(|(&(r, q, _), at)| Cluster {
            robots: (r, q),
            group: at,
            members: vec![at, at + 1],
            is_main: true,
        })
        .collect();
    let evidence = problem.evidence(trajectories, params);
    let centre = Isometry2::translation(-20.0, -3.0);
    let place = |robot| (robot, centre * LieGroup::inverse(&world(0, 0)) * world(robot, 0));
    let frames = Frames { reference: 0, centre_from_map: (0..3).map(place).collect() };
    Votes::new(&evidence, &frames, &[0, 1, 2], |_| true)
}

#[test]
fn residuals_have_the_mean_and_covariance_of_drift_noise_and_bias() {
    const SAMPLES: usize = 10_000;
    const STANDARD_ERRORS: f64 = 6.0;
    // the maps lie where they are linearised
    let params = GcmParams { base: Sigma { translation: 1e-6, rotation: 1e-6 }, ..GcmParams::default() };
    let (trajectories, closures) = observed(|_| SVector::zeros());
    let told = votes(&trajectories, &closures, &params);
    let mut expected = SMatrix::<f64, 9, 9>::zeros();
    for g in 0..3 {
        for h in 0..=g {
            let mut block = *told.block(g, h);
            if let (true, Kind::Cluster { spike, .. }) = (g == h, &told.list[g].kind) {
                block += spike;
            }
            expected.fixed_view_mut::<3, 3>(3 * g, 3 * h).copy_from(&block);
            expected.fixed_view_mut::<3, 3>(3 * h, 3 * g).copy_from(&block.transpose());
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut mean = SVector::<f64, 9>::zeros();
    let mut scatter = SMatrix::<f64, 9, 9>::zeros();
    for _ in 0..SAMPLES {
        let draw = |(metres, radians): (f64, f64)| {
            SVector::<f64, 3>::from_fn(|row, _| {
                let z: f64 = StandardNormal.sample(&mut rng);
                z * if row < 2 { metres } else { radians }
            })
        };
        let (trajectories, closures) = observed(draw);
        let votes = votes(&trajectories, &closures, &params);
        let rho = SVector::<f64, 9>::from_iterator(votes.list.iter().flat_map(|v| v.rho.iter().copied()));
        mean += rho / SAMPLES as f64;
        scatter += rho * rho.transpose() / SAMPLES as f64;
    }
    let cross = expected.fixed_view::<3, 3>(3, 0).norm() + expected.fixed_view::<3, 3>(6, 0).norm();
    assert!(cross > 5e-3, "shared drift is part of the test: {cross}");
    for i in 0..9 {
        let error = STANDARD_ERRORS * (expected[(i, i)] / SAMPLES as f64).sqrt();
        assert!(mean[i].abs() < error, "mean {i}: {} for 0 ± {error}", mean[i]);
        for j in 0..9 {
            let variance = expected[(i, i)] * expected[(j, j)] + expected[(i, j)].powi(2);
            let error = STANDARD_ERRORS * (variance / SAMPLES as f64).sqrt();
            let difference = scatter[(i, j)] - expected[(i, j)];
            assert!(
                difference.abs() < error,
                "({i}, {j}): {} for {} ± {error}",
                scatter[(i, j)],
                expected[(i, j)]
            );
        }
    }
}

//! Group-k consistency: ranges to a beacon and cycles of three robots.

use draco_consistency::simulate::{Harbor, Label, harbor};
use draco_consistency::{
    CycleParams, Error, Pose, Range, RangeParams, Trajectory, Trajectory2, cycle_consistency,
    isotropic_covariance, range_consistency,
};
use nalgebra::{Isometry2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// 60 poses on a curve; ranges to a beacon of which each with `outliers` chance is uniform. The last list tells which
/// are true.
fn problem(outliers: f64, seed: u64) -> (Trajectory2, Vec<Range>, Vec<bool>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let poses: Vec<Isometry2<f64>> = (0..60)
        .map(|k| {
            let t = f64::from(k) * 0.1;
            Isometry2::planar(8.0 * t.cos() + 2.0 * t, 8.0 * (1.3 * t).sin(), t)
        })
        .collect();
    let step = isotropic_covariance::<3, Isometry2<f64>>(0.005, 0.0005);
    let trajectory = Trajectory::from_steps(poses.clone(), &[step; 59]).unwrap();
    let beacon = Vector2::new(6.0, 14.0);
    let normal = Normal::new(0.0, 0.1).unwrap();
    let (ranges, labels) = poses
        .iter()
        .enumerate()
        .map(|(pose, p)| {
            let outlier = rng.random_bool(outliers);
            let distance = (beacon - p.translation.vector).norm() + normal.sample(&mut rng);
            let range = if outlier { rng.random_range(1.0..35.0) } else { distance };
            (Range { pose, range, sigma: 0.1 }, !outlier)
        })
        .unzip();
    (trajectory, ranges, labels)
}

#[test]
fn ranges_with_two_fifths_outliers_are_sorted_out() {
    for seed in 0..2 {
        let (trajectory, ranges, labels) = problem(0.4, seed);
        let params = RangeParams { probability: 0.9999, ..RangeParams::default() };
        let found = range_consistency(&trajectory, &ranges, &params).unwrap();
        let truly = found.selection.accepted.iter().filter(|&&m| labels[m]).count();
        let good = labels.iter().filter(|l| **l).count();
        assert!(found.optimal);
        assert!(truly * 20 >= found.selection.accepted.len() * 19, "precision of seed {seed}");
        assert!(truly * 20 >= good * 18, "{truly} of {good} in seed {seed}");
        assert!(found.tests[4] < 487_635, "pair tests spare tests of four");
    }
}

#[test]
fn bad_ranges_are_typed_errors() {
    let (trajectory, mut ranges, _) = problem(0.0, 0);
    ranges[3].sigma = 0.0;
    let wrong = range_consistency(&trajectory, &ranges, &RangeParams::default()).unwrap_err();
    assert_eq!(wrong, Error::BadRange { range: 3 });
    ranges[3] = Range { pose: 60, range: 1.0, sigma: 0.1 };
    let wrong = range_consistency(&trajectory, &ranges, &RangeParams::default()).unwrap_err();
    assert_eq!(wrong, Error::UnknownPose { closure: 3, robot: 0, index: 60 });
}

#[test]
fn cycles_reject_what_pairs_accept() {
    // without group bias and priors: gross outliers only, and cycles test what pairs cannot
    let params = Harbor { biased_share: 0.0, gross_share: 0.3, group_size: (3, 4), ..Harbor::default() };
    let (mut right, mut accepted) = (0, 0);
    for seed in 0..5 {
        let team = harbor::<3, Isometry2<f64>>(&params, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
        let found = cycle_consistency(&team.trajectories, &team.closures, &CycleParams::default()).unwrap();
        right += found.selection.accepted.iter().filter(|&&m| team.labels[m] == Label::Good).count();
        accepted += found.selection.accepted.len();
        assert_eq!(found.selection.accepted.len() + found.selection.rejected.len(), team.closures.len());
        assert!(found.tests[3] > 0);
    }
    assert!(right * 100 >= accepted * 98, "{right} of {accepted}");
}

//! Gaussian poses: algebra by hand, Monte Carlo, conventions and errors.
use draco_lie::{Error, GaussianPose, GaussianPose2, GaussianPose3, LieGroup, chi2, convention, transport};
use nalgebra::{
    Isometry2, Isometry3, Matrix3, Matrix6, Quaternion, SMatrix, SVector, UnitQuaternion, Vector2, Vector3,
    Vector6,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn a_turned_arm_swings_heading_noise_sideways() {
    // heading noise 0.01 rad at the start of a 10 m arm moves its tip 0.1 m sideways
    let start =
        GaussianPose2::from_deviations(Isometry2::identity(), &Vector3::new(1e-6, 1e-6, 0.01)).unwrap();
    let arm = GaussianPose2::exact(Isometry2::new(Vector2::new(10.0, 0.0), 0.0)).unwrap();
    let tip = start.compose(&arm);
    assert!((tip.covariance()[(1, 1)].sqrt() - 0.1).abs() < 1e-9);
    assert!((tip.covariance()[(1, 2)] - 10.0 * 1e-4).abs() < 1e-12);
}

#[test]
fn between_of_fully_correlated_poses_has_no_noise_left() {
    let a = GaussianPose3::from_deviations(
        Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5)),
        &Vector6::repeat(0.1),
    )
    .unwrap();
    let same = a.between_correlated(&a, a.covariance());
    assert!(same.covariance().norm() < 1e-15);
    assert!(same.mean().log().norm() < 1e-15);
}

#[test]
fn inverse_twice_is_the_same() {
    let a = GaussianPose3::new(
        Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.5)),
        Matrix6::identity() * 0.01,
    )
    .unwrap();
    let back = a.inverse().inverse();
    assert!((back.covariance() - a.covariance()).norm() < 1e-15);
}

#[test]
fn information_is_the_inverse_of_the_covariance() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let m = covariance(&mut rng, Vector6::new(0.1, 0.2, 0.3, 0.01, 0.02, 0.03));
    let a = GaussianPose3::new(Isometry3::identity(), m).unwrap();
    let back = GaussianPose3::from_information(*a.mean(), &a.information().unwrap()).unwrap();
    assert!((back.covariance() - m).amax() < 1e-15);
    let exact = GaussianPose3::exact(*a.mean()).unwrap();
    assert!(matches!(exact.information(), Err(Error::NotPositiveDefinite { pivot: 0, .. })));
    assert_eq!(exact.sample(&mut rng).unwrap(), *exact.mean());
}

#[test]
fn bad_input_is_named() {
    let mean = Isometry2::identity();
    let mut m = Matrix3::identity();
    m[(1, 1)] = -1.0;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotPositiveDefinite { pivot: 1, .. })));
    m[(1, 1)] = f64::NAN;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotFinite { index: 4, .. })));
    m[(1, 1)] = 1.0;
    let giant = Matrix3::new(1e300, 1e290, 0.0, -1e299, 1e300, 0.0, 0.0, 0.0, 1e300);
    assert!(matches!(GaussianPose2::new(mean, giant), Err(Error::NotSymmetric { row: 1, column: 0, .. })));
    m[(0, 1)] = 0.5;
    assert!(matches!(GaussianPose2::new(mean, m), Err(Error::NotSymmetric { row: 1, column: 0, .. })));
    let nowhere = Isometry2::new(Vector2::new(f64::INFINITY, 0.0), 0.0);
    assert!(matches!(GaussianPose2::exact(nowhere), Err(Error::NotFinite { index: 0, .. })));
    assert!(matches!(chi2::gate(-1.0, 0.9, 3), Err(Error::NegativeDistance { .. })));
    assert!(matches!(chi2::gate(1.0, 1.0, 3), Err(Error::Probability { .. })));
    assert!(matches!(chi2::gate(1.0, 0.5, 0), Err(Error::DegreesOfFreedom)));
    assert!(GaussianPose2::exact(mean).unwrap().mahalanobis_sq(&mean).is_err());
}

/// Draws of the Monte Carlo tests; the NEES of `n` draws has a relative deviation of √(2 / (n N)).
const DRAWS: usize = 100_000;
/// Allowed relative distance of the mean NEES from its expectation.
const NEES_TOLERANCE: f64 = 0.02;
/// Allowed distance of the accepted share from the gate's probability.
const GATE_TOLERANCE: f64 = 0.01;

/// A full covariance with the given deviations: a random correlation between all axes.
fn covariance<const N: usize>(rng: &mut ChaCha8Rng, deviations: SVector<f64, N>) -> SMatrix<f64, N, N> {
    let root = SMatrix::<f64, N, N>::from_fn(|i, j| {
        deviations[i] * (rng.random_range(-0.4..0.4) + if i == j { 1.0 } else { 0.0 })
    });
    root * root.transpose()
}

/// Mean NEES over `N`, largest entry of the whitened sample mean, and the share inside the gates.
fn grade<const N: usize, G: LieGroup<N>>(stated: &GaussianPose<G, N>, mut draw: impl FnMut() -> G) {
    let probabilities = [0.5, 0.9, 0.95, 0.99];
    let limits = probabilities.map(|p| chi2::quantile(p, N).unwrap());
    let (mut sum, mut inside) = (0.0, [0usize; 4]);
    for _ in 0..DRAWS {
        let d = stated.mahalanobis_sq(&draw()).unwrap();
        sum += d;
        for (count, limit) in inside.iter_mut().zip(limits) {
            *count += usize::from(d <= limit);
        }
    }
    let nees = sum / (DRAWS * N) as f64;
    println!("dimension {N}: NEES {nees:.4}, inside {inside:?} of {DRAWS} at {probabilities:?}");
    assert!((nees - 1.0).abs() <= NEES_TOLERANCE, "NEES {nees}");
    for (count, p) in inside.into_iter().zip(probabilities) {
        let share = count as f64 / DRAWS as f64;
        assert!((share - p).abs() <= GATE_TOLERANCE, "{share} accepted at {p}");
    }
}

fn monte_carlo<const N: usize, G: LieGroup<N>>(means: [G; 2], deviations: SVector<f64, N>) {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let a = GaussianPose::new(means[0], covariance(&mut rng, deviations)).unwrap();
    let b = GaussianPose::new(means[1], covariance(&mut rng, deviations)).unwrap();
    let rng = std::cell::RefCell::new(rng);
    let draw = |p: &GaussianPose<G, N>| p.sample(&mut *rng.borrow_mut()).unwrap();
    grade(&a, || draw(&a));
    grade(&a.inverse(), || draw(&a).inverse());
    grade(&a.compose(&b), || draw(&a).compose(&draw(&b)));
    grade(&a.between(&b), || draw(&a).between(&draw(&b)));

    // correlated: ξ₂ = K ξ₁ + η, as two poses of one trajectory
    let k = SMatrix::<f64, N, N>::from_fn(|i, j| if i == j { 0.6 } else { 0.05 * (i as f64 - j as f64) });
    let second = k * a.covariance() * k.transpose() + b.covariance();
    let c = GaussianPose::new(*b.mean(), second).unwrap();
    let cross = a.covariance() * k.transpose();
    let pair = || {
        let first = draw(&a);
        (first, draw(&b).plus(&(k * first.minus(a.mean()))))
    };
    grade(&a.compose_correlated(&c, &cross), || {
        let (first, second) = pair();
        first.compose(&second)
    });
    grade(&a.between_correlated(&c, &cross), || {
        let (first, second) = pair();
        first.between(&second)
    });
    // another body frame, rigidly mounted, and another world frame
    let sensor = means[1];
    let mounted =
        GaussianPose::new(a.mean().compose(&sensor), transport(&sensor.inverse(), a.covariance())).unwrap();
    grade(&mounted, || draw(&a).compose(&sensor));
    let elsewhere = GaussianPose::new(sensor.compose(a.mean()), *a.covariance()).unwrap();
    grade(&elsewhere, || sensor.compose(&draw(&a)));
}

#[test]
fn covariances_match_samples_in_the_plane() {
    let means = [Isometry2::new(Vector2::new(3.0, -1.0), 2.5), Isometry2::new(Vector2::new(-2.0, 4.0), -1.2)];
    monte_carlo(means, Vector3::new(0.05, 0.04, 0.01));
}

#[test]
fn covariances_match_samples_in_space() {
    let means = [
        Isometry3::new(Vector3::new(3.0, -1.0, 2.0), Vector3::new(1.5, -0.8, 0.4)),
        Isometry3::new(Vector3::new(-2.0, 4.0, 0.5), Vector3::new(-0.3, 0.9, 2.0)),
    ];
    monte_carlo(means, Vector6::new(0.05, 0.04, 0.06, 0.01, 0.015, 0.008));
}

/// Empirical covariance about the composed mean against first and second order, with large rotations.
#[test]
fn second_order_composition_beats_first_order_on_large_noise() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let a = GaussianPose3::from_deviations(
        Isometry3::new(Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.2, 0.0, 0.4)),
        &Vector6::new(0.5, 0.1, 0.1, 0.3, 0.2, 0.4),
    )
    .unwrap();
    let b = GaussianPose3::from_deviations(
        Isometry3::new(Vector3::new(1.0, 2.0, 0.0), Vector3::new(0.0, -0.5, 0.1)),
        &Vector6::new(0.4, 0.3, 0.2, 0.3, 0.3, 0.2),
    )
    .unwrap();
    let first = a.compose(&b);
    let second = a.compose_second_order(&b).unwrap();
    assert!(!second.first_order_suffices(), "correction {}", second.correction);
    let mut sum = Matrix6::zeros();
    for _ in 0..DRAWS {
        let xi = a.sample(&mut rng).unwrap().compose(&b.sample(&mut rng).unwrap()).minus(first.mean());
        sum += xi * xi.transpose();
    }
    let truth = sum / DRAWS as f64;
    let error = |m: &Matrix6<f64>| (m - truth).norm() / truth.norm();
    let (e1, e2) = (error(first.covariance()), error(second.pose.covariance()));
    println!(
        "relative error: first order {e1:.4}, second order {e2:.4}; correction {:.4}",
        second.correction
    );
    assert!(e2 < 0.35 * e1 && e2 < 0.02, "{e1} {e2}");

    let quiet = |p: &GaussianPose3| GaussianPose3::new(*p.mean(), p.covariance() * 1e-4).unwrap();
    let small = quiet(&a).compose_second_order(&quiet(&b)).unwrap();
    assert!(small.first_order_suffices() && small.correction.abs() < 1e-4);
}

#[test]
fn conventions_of_other_libraries_go_there_and_back() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let m = covariance(&mut rng, Vector6::new(0.1, 0.2, 0.3, 0.01, 0.02, 0.03));
    let mean = Isometry3::new(Vector3::new(3.0, -1.0, 2.0), Vector3::new(1.5, -0.8, 0.4));
    let gtsam = convention::to_gtsam_pose3(&m);
    assert_eq!((gtsam[(0, 1)], gtsam[(0, 3)], gtsam[(5, 4)]), (m[(3, 4)], m[(3, 0)], m[(2, 1)]));
    assert_eq!(convention::from_gtsam_pose3(&gtsam), m);
    let g2o = convention::to_g2o_quaternion_covariance(&m);
    assert_eq!((g2o[(0, 0)], g2o[(0, 4)], g2o[(5, 5)]), (m[(0, 0)], 0.5 * m[(0, 4)], 0.25 * m[(5, 5)]));
    assert_eq!(convention::from_g2o_quaternion_covariance(&g2o), m);
    let information = m.try_inverse().unwrap();
    let there = convention::to_g2o_quaternion_information(&information);
    assert!((there * g2o - Matrix6::identity()).amax() < 1e-12);
    assert_eq!(convention::from_g2o_quaternion_information(&there), information);
    let ros = convention::to_ros_pose_covariance(&mean, &m);
    assert!((convention::from_ros_pose_covariance(&mean, &ros).unwrap() - m).amax() < 1e-15);
    let left = convention::to_left_covariance(&mean, &m);
    assert!((convention::from_left_covariance(&mean, &left) - m).amax() < 1e-13);
    let left_information = convention::to_left_information(&mean, &information);
    assert!((left_information * left - Matrix6::identity()).amax() < 1e-9);
    assert!((convention::from_left_information(&mean, &left_information) - information).amax() < 1e-7);
    let bad = convention::from_ros_pose_covariance(&mean, &[f64::NAN; 36]);
    assert!(matches!(bad, Err(Error::NotFinite { index: 0, .. })));
}

/// The foreign residuals written out, sampled, and compared with the converted covariance.
#[test]
fn converted_covariances_match_samples_of_the_foreign_perturbation() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let deviations = Vector6::new(0.05, 0.04, 0.06, 0.01, 0.015, 0.008);
    let noise = GaussianPose3::new(Isometry3::identity(), covariance(&mut rng, deviations)).unwrap();
    let mean = Isometry3::new(Vector3::new(3.0, -1.0, 2.0), Vector3::new(1.5, -0.8, 0.4));
    let rng = std::cell::RefCell::new(rng);
    let draw = || noise.sample(&mut *rng.borrow_mut()).unwrap().log();
    let foreign = noise.covariance();
    let stated = |m: Matrix6<f64>| GaussianPose3::new(mean, m).unwrap();

    // ROS: along and about the parent's axes, not coupled
    let row_major = std::array::from_fn(|k| foreign[(k / 6, k % 6)]);
    grade(&stated(convention::from_ros_pose_covariance(&mean, &row_major).unwrap()), || {
        let xi = draw();
        let turn = UnitQuaternion::from_scaled_axis(xi.fixed_rows::<3>(3).into_owned());
        let t = mean.translation.vector + xi.fixed_rows::<3>(0);
        Isometry3::from_parts(t.into(), turn * mean.rotation)
    });
    // g2o: [t, q_v] of the error on the right
    grade(&stated(convention::from_g2o_quaternion_covariance(foreign)), || {
        let xi = draw();
        let v = xi.fixed_rows::<3>(3).into_owned();
        let q = Quaternion::from_parts((1.0 - v.norm_squared()).sqrt(), v);
        let t = xi.fixed_rows::<3>(0).into_owned();
        mean * Isometry3::from_parts(t.into(), UnitQuaternion::new_unchecked(q))
    });
    // GTSAM: rotation first
    grade(&stated(convention::from_gtsam_pose3(foreign)), || {
        let xi = draw();
        let ours = Vector6::new(xi[3], xi[4], xi[5], xi[0], xi[1], xi[2]);
        mean.plus(&ours)
    });
    // Barfoot: on the left
    grade(&stated(convention::from_left_covariance(&mean, foreign)), || {
        Isometry3::exp(&draw()).compose(&mean)
    });
}

//! Jacobians of all operations against central differences, points, interpolation, mean, matrices.
use std::f64::consts::PI;

use draco_lie::{Error, LieGroup, MeanParams, PointAction, Termination, frechet_mean};
use nalgebra::{
    Isometry2, Isometry3, Matrix3, Matrix4, SMatrix, SVector, UnitComplex, UnitQuaternion, Vector3, Vector6,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Step of the central differences, and the error left by their curvature and rounding.
const STEP: f64 = 1e-5;
const DIFFERENCE_TOLERANCE: f64 = 2e-9;

/// Both sides of every change of formula, both signs, and the half turn's neighbourhood.
const ANGLES: [f64; 18] = [
    0.0,
    1e-12,
    -1e-9,
    1e-8,
    -1e-5,
    1e-4,
    -1e-2,
    0.3,
    -0.7,
    1.414,
    -1.415,
    2.0,
    -2.99,
    3.01,
    PI - 1e-3,
    PI - 1e-6,
    -2.5,
    1.0,
];

fn numeric<const N: usize, const M: usize>(
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
) -> SMatrix<f64, M, N> {
    let column = |k: usize| {
        let mut step = SVector::<f64, N>::zeros();
        step[k] = STEP;
        (f(&step) - f(&-step)) / (2.0 * STEP)
    };
    SMatrix::from_columns(&(0..N).map(column).collect::<Vec<_>>())
}

fn close<const R: usize, const C: usize>(
    found: &SMatrix<f64, R, C>,
    wanted: &SMatrix<f64, R, C>,
    what: &str,
) {
    let error = (found - wanted).amax() / (1.0 + wanted.amax());
    assert!(error <= DIFFERENCE_TOLERANCE, "{what}: off by {error:e}\n{found}{wanted}");
}

/// Tangents whose rotation part has the wanted size and sign.
fn tangents<const N: usize>(rotations: usize) -> Vec<SVector<f64, N>> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut all = Vec::new();
    for angle in ANGLES {
        let mut xi = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let size = xi.rows(N - rotations, rotations).norm();
        xi.rows_mut(N - rotations, rotations).scale_mut(angle / size);
        all.push(xi);
    }
    all
}

fn check_operations<const N: usize, G: LieGroup<N>>(rotations: usize) {
    let xs = tangents::<N>(rotations);
    for (k, xi) in xs.iter().enumerate() {
        let (a, b) = (G::exp(xi), G::exp(&xs[(k + 5) % xs.len()]));
        // the part of a pose that moves, as a tangent at `at`
        let moved = |at: G| move |pose: G| pose.minus(&at);

        let l = a.compose_with_jacobians(&b);
        let out = moved(l.value);
        close(&l.first, &numeric(|d| out(a.plus(d).compose(&b))), "compose, first");
        close(&l.second, &numeric(|d| out(a.compose(&b.plus(d)))), "compose, second");

        let l = a.inverse_with_jacobian();
        let out = moved(l.value);
        close(&l.jacobian, &numeric(|d| out(a.plus(d).inverse())), "inverse");

        let l = a.between_with_jacobians(&b);
        let out = moved(l.value);
        close(&l.first, &numeric(|d| out(a.plus(d).between(&b))), "between, first");
        close(&l.second, &numeric(|d| out(a.between(&b.plus(d)))), "between, second");

        let l = G::exp_with_jacobian(xi);
        let out = moved(l.value);
        close(&l.jacobian, &numeric(|d| out(G::exp(&(xi + d)))), "exp");

        let l = a.log_with_jacobian();
        // within STEP of a half turn the logarithm jumps, and differences mean nothing
        if a.log().rows(N - rotations, rotations).norm() < PI - 1e-4 {
            close(&l.jacobian, &numeric(|d| a.plus(d).log()), "log");
        }

        let l = a.plus_with_jacobians(&xs[k / 2]);
        let out = moved(l.value);
        close(&l.first, &numeric(|d| out(a.plus(d).plus(&xs[k / 2]))), "plus, first");
        close(&l.second, &numeric(|d| out(a.plus(&(xs[k / 2] + d)))), "plus, second");

        if a.minus(&b).rows(N - rotations, rotations).norm() < PI - 1e-4 {
            let l = a.minus_with_jacobians(&b);
            close(&l.first, &numeric(|d| a.plus(d).minus(&b)), "minus, first");
            close(&l.second, &numeric(|d| a.minus(&b.plus(d))), "minus, second");
        }

        let measured = a.between(&b).plus(&(xs[(k + 3) % xs.len()] * 0.3));
        let l = G::between_error_with_jacobians(&measured, &a, &b);
        assert!((l.value - G::between_error(&measured, &a, &b)).norm() < 1e-14);
        close(&l.first, &numeric(|d| G::between_error(&measured, &a.plus(d), &b)), "error, first");
        close(&l.second, &numeric(|d| G::between_error(&measured, &a, &b.plus(d))), "error, second");

        assert!((G::interpolate(&a, &b, 0.0).minus(&a)).norm() < 1e-14);
        assert!((G::interpolate(&a, &b, 1.0).minus(&b)).norm() < 1e-14);
    }
}

#[test]
fn jacobians_of_all_operations_match_central_differences() {
    check_operations::<1, UnitComplex<f64>>(1);
    check_operations::<3, Isometry2<f64>>(1);
    check_operations::<3, UnitQuaternion<f64>>(3);
    check_operations::<6, Isometry3<f64>>(3);
}

fn check_points<const N: usize, const D: usize, G: PointAction<N, D>>(rotations: usize) {
    for xi in tangents::<N>(rotations) {
        let pose = G::exp(&xi);
        let p = SVector::<f64, D>::from_fn(|i, _| 1.5 - i as f64 * 2.1);
        let moved = pose.act_with_jacobians(&p);
        assert!((moved.point - pose.act(&p)).norm() < 1e-14);
        close(&moved.by_pose, &numeric(|d| pose.plus(d).act(&p)), "point by pose");
        close(&moved.by_point, &numeric(|d: &SVector<f64, D>| pose.act(&(p + d))), "point by point");
        assert!((pose.inverse().act(&moved.point) - p).norm() < 1e-14);
    }
}

#[test]
fn jacobians_of_the_action_on_points_match_central_differences() {
    check_points::<1, 2, UnitComplex<f64>>(1);
    check_points::<3, 2, Isometry2<f64>>(1);
    check_points::<3, 3, UnitQuaternion<f64>>(3);
    check_points::<6, 3, Isometry3<f64>>(3);
}

/// Largest entry of `Jr · Jr⁻¹ - I` allowed, within the angles a logarithm has.
const INVERSE_TOLERANCE: f64 = 1e-14;

fn check_inverse<const N: usize, G: LieGroup<N>>(rotations: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut worst = (0.0_f64, 0.0);
    for k in 0..20_000 {
        let mut xi = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let angle = 2.0 * PI * k as f64 / 20_000.0;
        let size = xi.rows(N - rotations, rotations).norm();
        xi.rows_mut(N - rotations, rotations).scale_mut(angle / size);
        let (j, inverse) = (G::right_jacobian(&xi), G::right_jacobian_inverse(&xi));
        let error = (j * inverse - SMatrix::identity()).amax();
        // near 2π the entries of the inverse grow; one rounding of J (1.1e-16) times them is what f64 can do
        let attainable = INVERSE_TOLERANCE * (inverse.amax() / 5.0).max(1.0);
        assert!(error <= attainable, "{error:e} at {angle}");
        if angle <= 5.5 && error > worst.0 {
            worst = (error, angle);
        }
    }
    println!("Jr Jr⁻¹ - I up to 5.5 rad: {:e} at {}", worst.0, worst.1);
    assert!(worst.0 <= INVERSE_TOLERANCE);
}

#[test]
fn jacobians_times_their_inverses_are_the_identity() {
    check_inverse::<3, Isometry2<f64>>(1);
    check_inverse::<3, UnitQuaternion<f64>>(3);
    check_inverse::<6, Isometry3<f64>>(3);
}

fn check_chain<const N: usize, G: LieGroup<N>>(rotations: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut pose = G::identity();
    for k in 0..100_000 {
        let mut xi = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-1.0..1.0));
        xi.rows_mut(N - rotations, rotations).scale_mut(2.0);
        // in and out, so that the chain does not run away and the comparison stays at unit scale
        pose = if k % 2 == 0 { pose.compose(&G::exp(&xi)) } else { G::exp(&xi).inverse().compose(&pose) };
        let back = G::exp(&pose.log());
        let error = back.minus(&pose);
        let reach = 1.0 + pose.log().norm();
        assert!(error.norm() <= 4e-15 * reach, "{:e} after {k} steps", error.norm());
    }
    assert!(pose.check().is_ok());
}

#[test]
fn a_long_chain_keeps_its_norm_and_exp_undoes_log() {
    check_chain::<1, UnitComplex<f64>>(1);
    check_chain::<3, Isometry2<f64>>(1);
    check_chain::<3, UnitQuaternion<f64>>(3);
    check_chain::<6, Isometry3<f64>>(3);
    let step = <UnitQuaternion<f64> as LieGroup<3>>::exp(&Vector3::new(0.3, -1.1, 0.7));
    let chain = (0..100_000).fold(UnitQuaternion::identity(), |q, _| q.compose(&step));
    assert!((chain.norm() - 1.0).abs() < 1e-15, "norm {}", chain.norm());
}

#[test]
fn at_exactly_half_a_turn_exp_undoes_log() {
    for axis in
        [Vector3::x(), -Vector3::y(), Vector3::new(0.6, 0.0, -0.8), Vector3::new(-1.0, 2.0, 2.0) / 3.0]
    {
        let rotation = UnitQuaternion::new_unchecked(nalgebra::Quaternion::from_parts(0.0, axis));
        let pose = Isometry3::from_parts(nalgebra::Translation3::new(1.0, -2.0, 3.0), rotation);
        let xi = pose.log();
        assert!((xi.fixed_rows::<3>(3).norm() - PI).abs() < 1e-15);
        let back = Isometry3::exp(&xi);
        assert!((back.to_homogeneous() - pose.to_homogeneous()).amax() < 2e-15);
        let by_matrix = Isometry3::try_from_matrix(&pose.to_matrix()).unwrap();
        assert!((by_matrix.log().fixed_rows::<3>(3).norm() - PI).abs() < 1e-15);
        assert!((by_matrix.to_homogeneous() - pose.to_homogeneous()).amax() < 2e-15);
    }
    for theta in [PI, -PI] {
        let pose = Isometry2::new(nalgebra::Vector2::new(3.0, -1.0), theta);
        assert!((Isometry2::exp(&pose.log()).to_homogeneous() - pose.to_homogeneous()).amax() < 2e-15);
    }
}

#[test]
fn matrices_and_hats_go_there_and_back() {
    for xi in tangents::<6>(3) {
        let pose = Isometry3::exp(&xi);
        assert!(Isometry3::try_from_matrix(&pose.to_matrix()).unwrap().minus(&pose).norm() < 2e-15);
        assert_eq!(Isometry3::vee(&Isometry3::hat(&xi)).unwrap(), xi);
        let series = (Isometry3::hat(&xi)).exp();
        assert!((series - pose.to_matrix()).amax() < 1e-13, "nalgebra's matrix exponential at {xi}");
        assert!((Isometry3::small_adjoint(&xi).exp() - pose.adjoint()).amax() < 1e-12);
    }
    for xi in tangents::<3>(1) {
        let pose = Isometry2::exp(&xi);
        assert!(Isometry2::try_from_matrix(&pose.to_matrix()).unwrap().minus(&pose).norm() < 2e-15);
        assert_eq!(Isometry2::vee(&Isometry2::hat(&xi)).unwrap(), xi);
        assert!((Isometry2::hat(&xi).exp() - pose.to_matrix()).amax() < 1e-13);
        assert!((Isometry2::small_adjoint(&xi).exp() - pose.adjoint()).amax() < 1e-12);
    }
}

#[test]
fn the_mean_of_symmetric_poses_is_their_centre() {
    let centre = Isometry3::exp(&Vector6::new(4.0, -2.0, 1.0, 0.9, -1.7, 2.0));
    let offsets: Vec<_> = tangents::<6>(3).iter().map(|xi| xi * 0.4).collect();
    let poses: Vec<_> = offsets.iter().flat_map(|xi| [centre.plus(xi), centre.plus(&-xi)]).collect();
    let mean = frechet_mean(&poses, &[], &MeanParams::default()).unwrap();
    assert_eq!(mean.termination, Termination::Converged);
    assert!(mean.pose.minus(&centre).norm() < 1e-14, "{}", mean.pose.minus(&centre));
    let weights: Vec<f64> = (0..poses.len()).map(|k| if k == 4 { 2.0 } else { 0.0 }).collect();
    let one = frechet_mean(&poses, &weights, &MeanParams::default()).unwrap();
    assert!(one.pose.minus(&poses[4]).norm() < 1e-15);
    let stopped =
        frechet_mean(&poses, &[], &MeanParams { max_iterations: 1, ..MeanParams::default() }).unwrap();
    assert_eq!((stopped.termination, stopped.iterations), (Termination::MaxIterations, 1));
}

#[test]
fn bad_input_is_named() {
    let nan = Vector6::new(0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0);
    assert!(matches!(Isometry3::try_exp(&nan), Err(Error::NotFinite { index: 4, .. })));
    let far = Vector3::new(0.0, f64::INFINITY, 0.0);
    assert!(matches!(Isometry2::try_exp(&far), Err(Error::NotFinite { index: 1, .. })));
    let huge = Vector3::new(1e300, 1e300, 0.0);
    assert!(matches!(UnitQuaternion::try_exp(&huge), Err(Error::NotFinite { .. })));
    let long = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.0, 0.1, 0.0, 0.0));
    assert!(matches!(long.try_log(), Err(Error::NotUnit { .. })));
    assert!(LieGroup::renormalize(&long).try_log().is_ok());
    let complex = UnitComplex::new_unchecked(nalgebra::Complex::new(0.9, 0.0));
    assert!(matches!(complex.try_log(), Err(Error::NotUnit { .. })));
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    assert!(matches!(UnitQuaternion::try_from_matrix(&mirror), Err(Error::NotRotation { .. })));
    let giant = Matrix3::repeat(1e200);
    assert!(matches!(UnitQuaternion::try_from_matrix(&giant), Err(Error::NotRotation { .. })));
    let mut bottom = Matrix4::identity();
    bottom[(3, 0)] = 0.5;
    assert!(matches!(Isometry3::try_from_matrix(&bottom), Err(Error::NotRotation { .. })));
    assert!(matches!(Isometry3::vee(&Matrix4::identity()), Err(Error::NotHat { .. })));
    let none: [Isometry2<f64>; 0] = [];
    let two = [Isometry2::identity(); 2];
    let params = MeanParams::default();
    assert!(matches!(frechet_mean(&none, &[], &params), Err(Error::Empty)));
    assert!(matches!(frechet_mean(&two, &[1.0], &params), Err(Error::WeightCount { poses: 2, weights: 1 })));
    assert!(matches!(frechet_mean(&two, &[1.0, -1.0], &params), Err(Error::Weight { index: 1, .. })));
    assert!(matches!(frechet_mean(&two, &[0.0, 0.0], &params), Err(Error::Weight { .. })));
}

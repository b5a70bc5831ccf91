//! Covariances against dense inversion of a Hessian by central differences of the cost.

mod common;

use draco_lie::LieGroup;
use draco_pgo::{Gauge, Kernel, Key, Marginals, PoseGraph, PoseGraph2, PoseGraph3, SolveParams, solve};
use nalgebra::{DMatrix, Isometry2, Isometry3, Matrix3, SMatrix, SVector};
use rand::{Rng, RngExt, SeedableRng};

fn tangent<const N: usize>(rng: &mut impl Rng, scale: f64) -> SVector<f64, N> {
    SVector::from_fn(|_, _| scale * rng.random_range(-1.0..1.0))
}

fn information<const N: usize>(rng: &mut impl Rng) -> SMatrix<f64, N, N> {
    let a = SMatrix::<f64, N, N>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    a * a.transpose() + SMatrix::identity() * 5.0
}

/// A noise-free loop with chords: its Gauss-Newton Hessian at the truth is the true Hessian.
fn exact_graph<const N: usize, G: LieGroup<N>>(n: u64, seed: u64) -> PoseGraph<G, N> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut graph = PoseGraph::new();
    let poses: Vec<G> = (0..n).map(|_| G::exp(&tangent(&mut rng, 2.0))).collect();
    for (i, pose) in poses.iter().enumerate() {
        graph.add_pose(Key::new(0, i as u64), *pose).unwrap();
    }
    graph.add_prior(Key::new(0, 0), poses[0], information(&mut rng), Kernel::None).unwrap();
    for i in 0..n as usize {
        for j in [(i + 1) % n as usize, (i * 3 + 2) % n as usize] {
            if i != j {
                let z = poses[i].between(&poses[j]);
                let (a, b) = (Key::new(0, i as u64), Key::new(0, j as u64));
                graph.add_between(a, b, z, information(&mut rng), Kernel::None).unwrap();
            }
        }
    }
    graph
}

fn numeric_hessian<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>) -> DMatrix<f64> {
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    let h = 1e-4;
    let cost = |moves: [(usize, f64); 2]| {
        let mut moved = graph.clone();
        for (index, by) in moves {
            let mut xi = SVector::<f64, N>::zeros();
            xi[index % N] = by;
            let key = keys[index / N];
            // both moves of one pose have to act as one perturbation
            if moves[0].0 / N == moves[1].0 / N {
                let mut both = SVector::<f64, N>::zeros();
                both[moves[0].0 % N] += moves[0].1;
                both[moves[1].0 % N] += moves[1].1;
                moved.set_pose(key, graph.pose(key).unwrap().plus(&both)).unwrap();
            } else {
                moved.set_pose(key, graph.pose(key).unwrap().plus(&xi)).unwrap();
            }
        }
        moved.cost()
    };
    let n = keys.len() * N;
    DMatrix::from_fn(n, n, |r, c| {
        (cost([(r, h), (c, h)]) - cost([(r, h), (c, -h)]) - cost([(r, -h), (c, h)])
            + cost([(r, -h), (c, -h)]))
            / (4.0 * h * h)
    })
}

fn check<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>) {
    let inverse = numeric_hessian(graph).try_inverse().unwrap();
    let marginals = Marginals::new(graph, Gauge::Require).unwrap();
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    let tolerance = 1e-5 * inverse.amax();
    for (i, a) in keys.iter().enumerate() {
        let own = marginals.covariance(*a).unwrap();
        assert!((own - inverse.fixed_view::<N, N>(i * N, i * N)).amax() < tolerance);
        for (j, b) in keys.iter().enumerate() {
            let joint = marginals.joint(*a, *b).unwrap();
            assert!((joint.cross - inverse.fixed_view::<N, N>(i * N, j * N)).amax() < tolerance, "{a} {b}");
        }
    }
    for ((key, covariance), expected) in marginals.all().into_iter().zip(&keys) {
        assert_eq!(key, *expected);
        let solved = marginals.covariance(key).unwrap();
        assert!((covariance - solved).amax() <= 1e-11 * solved.amax());
    }
    let all = marginals.joint_of(&keys).unwrap();
    assert!((all - inverse).amax() < tolerance);
}

#[test]
fn covariances_are_the_inverse_of_the_hessian_of_the_cost() {
    check::<3, Isometry2<f64>>(&exact_graph(7, 1));
    check::<6, Isometry3<f64>>(&exact_graph(5, 2));
}

/// The information matrix assembled from the Jacobians of each measurement, dense, with the first pose held.
fn dense_information<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>) -> DMatrix<f64> {
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    let index = |key: Key| keys.binary_search(&key).unwrap();
    let n = (keys.len() - 1) * N;
    let mut hessian = DMatrix::<f64>::zeros(n, n);
    for (_, factor) in graph.factors() {
        let draco_pgo::Measurement::Between { from, to, measured } = &factor.measurement else { continue };
        let (a, b) = (graph.pose(*from).unwrap(), graph.pose(*to).unwrap());
        let e = G::between_error_with_jacobians(measured, a, b);
        let ends = [(index(*from), e.first), (index(*to), e.second)];
        for (r, jr) in ends.iter().filter(|(i, _)| *i > 0) {
            for (c, jc) in ends.iter().filter(|(i, _)| *i > 0) {
                let mut block = hessian.fixed_view_mut::<N, N>((r - 1) * N, (c - 1) * N);
                block += jr.transpose() * factor.information * jc;
            }
        }
    }
    hessian
}

/// Largest deviation of covariances from dense inversion, relative to the covariance compared.
fn against_dense<const N: usize, G: LieGroup<N>>(mut graph: PoseGraph<G, N>, name: &str) {
    let solution = solve(&graph, &SolveParams::default()).unwrap();
    graph.update(&solution);
    let inverse = dense_information(&graph).cholesky().unwrap().inverse();
    let marginals = Marginals::new(&graph, Gauge::HoldFirst).unwrap();
    let keys: Vec<Key> = graph.poses().map(|(key, _)| key).collect();
    let (mut worst, mut worst_all): (f64, f64) = (0.0, 0.0);
    for ((i, a), (_, all)) in keys.iter().enumerate().zip(marginals.all()).skip(1) {
        let expected = inverse.fixed_view::<N, N>((i - 1) * N, (i - 1) * N).into_owned();
        let difference = |found: SMatrix<f64, N, N>| (found - expected).amax() / expected.amax();
        worst = worst.max(difference(marginals.covariance(*a).unwrap()));
        worst_all = worst_all.max(difference(all));
        let j = 1 + (i * 37 + 11) % (keys.len() - 1);
        let joint = marginals.joint(*a, keys[j]).unwrap();
        let cross = inverse.fixed_view::<N, N>((i - 1) * N, (j - 1) * N).into_owned();
        let scale = (joint.first.amax() * joint.second.amax()).sqrt();
        worst = worst.max((joint.cross - cross).amax() / scale);
    }
    println!("{name}: chosen poses {worst:.1e}, all poses {worst_all:.1e} off dense inversion");
    assert!(worst <= 1e-9 && worst_all <= 1e-9, "{name}: {worst:e} {worst_all:e}");
}

#[test]
fn covariances_equal_dense_inversion() {
    let (mut plane, mut space) =
        (exact_graph::<3, Isometry2<f64>>(150, 21), exact_graph::<6, Isometry3<f64>>(70, 22));
    // the dense matrix knows relative poses only
    plane.remove_factor(draco_pgo::FactorId(0)).unwrap();
    space.remove_factor(draco_pgo::FactorId(0)).unwrap();
    against_dense(plane, "random, plane");
    against_dense(space, "random, space");
    use draco_pgo::io::g2o::{self, AnyGraph};
    for name in ["tinyGrid3D", "smallGrid3D", "multi/dm4/0"] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        match g2o::read(path).unwrap() {
            AnyGraph::Two(graph) => against_dense(graph, name),
            AnyGraph::Three(graph) => against_dense(graph, name),
        }
    }
}

#[test]
#[ignore = "dense inversion of thousands of rows takes minutes in the dev profile"]
fn covariances_equal_dense_inversion_on_large_sets() {
    use draco_pgo::io::g2o::{self, AnyGraph};
    for name in ["CSAIL", "MIT", "intel"] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let AnyGraph::Two(mut graph) = g2o::read(path).unwrap() else { panic!("not in the plane") };
        draco_pgo::chordal(&mut graph).unwrap();
        against_dense(graph, name);
    }
}

#[test]
fn relative_covariance_of_one_measurement_is_the_measurement_noise() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut graph = PoseGraph3::new();
    let (a, b) = (Key::new(0, 0), Key::new(0, 1));
    let x = Isometry3::exp(&tangent(&mut rng, 2.0));
    let z = Isometry3::exp(&tangent(&mut rng, 2.0));
    graph.add_pose(a, x).unwrap();
    graph.add_pose(b, x * z).unwrap();
    let (prior, between) = (information(&mut rng), information(&mut rng));
    graph.add_prior(a, x, prior, Kernel::None).unwrap();
    graph.add_between(a, b, z, between, Kernel::None).unwrap();
    let relative = Marginals::new(&graph, Gauge::Require).unwrap().relative(a, b).unwrap();
    assert!((relative - between.try_inverse().unwrap()).amax() < 1e-12);
}

#[test]
fn estimates_scatter_as_the_joint_covariance_says() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let truth: PoseGraph2 = exact_graph(6, 5);
    let scaled = |omega: SMatrix<f64, 3, 3>| omega * 1e4;
    let mut exact = PoseGraph2::new();
    for (key, pose) in truth.poses() {
        exact.add_pose(key, *pose).unwrap();
    }
    copy(&truth, &mut exact, |z, omega| (z, scaled(omega)));
    let (a, b) = (Key::new(0, 2), Key::new(0, 4));
    let expected = Marginals::new(&exact, Gauge::Require).unwrap().joint_of(&[a, b]).unwrap();
    let relative = Marginals::new(&exact, Gauge::Require).unwrap().relative(a, b).unwrap();
    let whiten = expected.clone().cholesky().unwrap().l();
    let whiten_relative = relative.cholesky().unwrap().l();
    let true_relative = truth.pose(a).unwrap().between(truth.pose(b).unwrap());
    let mut relative_sum = Matrix3::<f64>::zeros();
    let runs = 3000;
    let mut sum = DMatrix::<f64>::zeros(6, 6);
    for _ in 0..runs {
        let mut noisy = PoseGraph2::new();
        for (key, pose) in truth.poses() {
            noisy.add_pose(key, *pose).unwrap();
        }
        copy(&exact, &mut noisy, |z, omega| {
            let normal = SVector::<f64, 3>::from_fn(|_, _| rng.sample(rand_distr::StandardNormal));
            let noise = omega.cholesky().unwrap().l().transpose().try_inverse().unwrap() * normal;
            (z.plus(&noise), omega)
        });
        let solution = solve(&noisy, &SolveParams::default()).unwrap();
        let mut error = nalgebra::DVector::zeros(6);
        for (i, key) in [a, b].into_iter().enumerate() {
            let e = solution.pose(key).unwrap().minus(truth.pose(key).unwrap());
            error.fixed_rows_mut::<3>(3 * i).copy_from(&e);
        }
        let white = whiten.solve_lower_triangular(&error).unwrap();
        sum += &white * white.transpose();
        let seen = solution.pose(a).unwrap().between(solution.pose(b).unwrap());
        let white = whiten_relative.solve_lower_triangular(&seen.minus(&true_relative)).unwrap();
        relative_sum += white * white.transpose();
    }
    assert!((relative_sum / f64::from(runs) - Matrix3::identity()).amax() < 0.12);
    let sample = sum / f64::from(runs);
    // entries of a whitened sample covariance scatter by sqrt(2 / runs) = 0.026 at most
    assert!((sample - DMatrix::identity(6, 6)).amax() < 0.12);
}

fn copy(
    from: &PoseGraph2,
    to: &mut PoseGraph2,
    mut change: impl FnMut(Isometry2<f64>, SMatrix<f64, 3, 3>) -> (Isometry2<f64>, SMatrix<f64, 3, 3>),
) {
    use draco_pgo::Measurement;
    for (_, factor) in from.factors() {
        match &factor.measurement {
            Measurement::Prior { key, measured } => {
                let (z, omega) = change(*measured, factor.information);
                to.add_prior(*key, z, omega, factor.kernel).unwrap();
            }
            Measurement::Between { from, to: other, measured } => {
                let (z, omega) = change(*measured, factor.information);
                to.add_between(*from, *other, z, omega, factor.kernel).unwrap();
            }
            _ => {}
        }
    }
}

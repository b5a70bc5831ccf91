//! Taking poses out of an incremental smoother, against the batch solver over what is left or over everything.

use draco_lie::LieGroup;
use draco_pgo::{
    Error, Gauge, Incremental, Incremental2, IncrementalMode, IncrementalParams, Kernel, Key, Marginals,
    PoseGraph, SolveParams, solve,
};
use nalgebra::{Isometry2, Isometry3, Matrix3, SMatrix, SVector};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Largest distance of an exact estimate from the batch optimum, metres and radians.
const EXACT_TOLERANCE: f64 = 1e-8;
/// Largest deviation of a covariance, relative to the largest entry.
const COVARIANCE_TOLERANCE: f64 = 1e-7;

fn exact() -> IncrementalParams {
    IncrementalParams { mode: IncrementalMode::Exact, ..IncrementalParams::default() }
}

fn tight() -> SolveParams {
    SolveParams { relative_tolerance: 1e-15, ..SolveParams::default() }
}

fn key(index: usize) -> Key {
    Key::new(0, index as u64)
}

/// A wandering truth and noisy measurements of it.
struct World<G> {
    rng: ChaCha8Rng,
    truth: Vec<G>,
}

impl<G: Copy> World<G> {
    fn new<const N: usize>(seed: u64, poses: usize) -> Self
    where
        G: LieGroup<N>,
    {
        let mut world = Self { rng: ChaCha8Rng::seed_from_u64(seed), truth: vec![G::identity()] };
        for i in 1..poses {
            let step = world.tangent::<N>(1.0);
            world.truth.push(world.truth[i - 1].plus(&step));
        }
        world
    }

    fn tangent<const N: usize>(&mut self, size: f64) -> SVector<f64, N> {
        SVector::from_fn(|_, _| self.rng.random_range(-size..size))
    }

    fn information<const N: usize>(&mut self) -> SMatrix<f64, N, N> {
        let a = SMatrix::<f64, N, N>::from_fn(|_, _| self.rng.random_range(-1.0..1.0));
        a * a.transpose() + SMatrix::identity() * 5.0
    }

    fn between<const N: usize>(&mut self, smoother: &mut Incremental<G, N>, from: usize, to: usize)
    where
        G: LieGroup<N>,
    {
        let noise = self.tangent::<N>(0.02);
        let measured = self.truth[from].between(&self.truth[to]).plus(&noise);
        let information = self.information();
        smoother.add_between(key(from), key(to), measured, information, Kernel::None).unwrap();
    }

    /// Adds poses `from..to`, each with factors on the two before it and now and then on an older one.
    fn extend<const N: usize>(&mut self, smoother: &mut Incremental<G, N>, from: usize, to: usize)
    where
        G: LieGroup<N>,
    {
        for i in from..to {
            let noise = self.tangent::<N>(0.05);
            smoother.add_pose(key(i), self.truth[i].plus(&noise)).unwrap();
            for other in i.saturating_sub(2)..i {
                if smoother.graph().pose(key(other)).is_some() {
                    self.between(smoother, other, i);
                }
            }
            let old = self.rng.random_range(0..i.max(1));
            if i > 5 && old + 2 < i && i % 4 == 0 && smoother.graph().pose(key(old)).is_some() {
                self.between(smoother, i, old);
            }
            if i % 9 == 0 {
                let noise = self.tangent::<N>(0.02);
                let (measured, information) = (self.truth[i].plus(&noise), self.information());
                smoother.add_prior(key(i), measured, information, Kernel::None).unwrap();
            }
            if self.rng.random_range(0..3) > 0 {
                smoother.update().unwrap();
            }
        }
    }
}

/// Largest distance of the estimates from the batch optimum of `graph`, over the poses the smoother holds.
fn distance<const N: usize, G: LieGroup<N>>(smoother: &Incremental<G, N>, graph: &PoseGraph<G, N>) -> f64 {
    let batch = solve(graph, &tight()).unwrap();
    smoother
        .graph()
        .poses()
        .map(|(key, pose)| pose.minus(batch.pose(key).unwrap()).amax())
        .fold(0.0, f64::max)
}

/// Largest deviation of the joint covariance of three poses from the batch one, relative.
fn covariance_distance<const N: usize, G: LieGroup<N>>(
    smoother: &Incremental<G, N>,
    graph: &PoseGraph<G, N>,
) -> f64 {
    let mut graph = graph.clone();
    graph.update(&solve(&graph, &tight()).unwrap());
    let keys: Vec<Key> = smoother.graph().poses().map(|(key, _)| key).collect();
    let chosen = [keys[0], keys[keys.len() / 2], keys[keys.len() - 1]];
    let mine = smoother.joint_covariance(&chosen).unwrap();
    let batch = Marginals::new(&graph, Gauge::Require).unwrap().joint_of(&chosen).unwrap();
    (&mine - &batch).amax() / batch.amax()
}

fn removes_like_batch<const N: usize, G: LieGroup<N>>(seed: u64, poses: usize) -> Result<(), TestCaseError> {
    let mut world = World::<G>::new(seed, 2 * poses);
    let mut smoother = Incremental::new(exact()).unwrap();
    world.extend(&mut smoother, 0, poses);
    for round in 0..4 {
        // a pose whose neighbours are still there, so that the chain of factors over two steps stays whole
        let at = 1 + world.rng.random_range(0..poses / 4) * 4;
        if smoother.graph().pose(key(at)).is_some() && at + 1 < poses {
            let removed = smoother.remove_pose(key(at)).unwrap();
            prop_assert!(!removed.is_empty() && smoother.graph().pose(key(at)).is_none());
        }
        let last = smoother.graph().poses().map(|(k, _)| k.index as usize).max().unwrap();
        if round % 2 == 1 {
            smoother.update().unwrap();
        }
        world.extend(&mut smoother, last + 1, last + 4);
    }
    let report = smoother.update().unwrap();
    prop_assert!(report.converged);
    let apart = distance(&smoother, smoother.graph());
    prop_assert!(apart < EXACT_TOLERANCE, "{apart:e}");
    let apart = covariance_distance(&smoother, smoother.graph());
    prop_assert!(apart < COVARIANCE_TOLERANCE, "covariance {apart:e}");
    Ok(())
}

fn marginalises_like_batch<const N: usize, G: LieGroup<N>>(
    seed: u64,
    poses: usize,
) -> Result<(), TestCaseError> {
    let mut world = World::<G>::new(seed, poses);
    let mut smoother = Incremental::new(exact()).unwrap();
    world.extend(&mut smoother, 0, poses);
    smoother.update().unwrap();
    let mut whole = smoother.graph().clone();
    for k in 0..poses / 2 {
        // the oldest poses, the one with the prior first, as a window that moves on; and some in between
        let at = if k % 3 == 2 { poses - 2 - k } else { k };
        if smoother.graph().pose(key(at)).is_some() {
            smoother.marginalise(key(at)).unwrap();
        }
        if k % 2 == 0 {
            smoother.update().unwrap();
        }
    }
    smoother.update().unwrap();
    let apart = distance(&smoother, &whole);
    prop_assert!(apart < EXACT_TOLERANCE, "{apart:e}");
    let apart = covariance_distance(&smoother, &whole);
    prop_assert!(apart < COVARIANCE_TOLERANCE, "covariance {apart:e}");
    // what comes later meets the same knowledge; a measurement that agrees moves nothing, so models stay exact
    let ends: Vec<Key> = smoother.graph().poses().map(|(key, _)| key).collect();
    let (a, b) = (ends[0], ends[ends.len() - 1]);
    let estimate = |key| *smoother.graph().pose(key).unwrap();
    let (measured, information) = (estimate(a).between(&estimate(b)), world.information());
    smoother.add_between(a, b, measured, information, Kernel::None).unwrap();
    whole.add_between(a, b, measured, information, Kernel::None).unwrap();
    smoother.update().unwrap();
    let apart = covariance_distance(&smoother, &whole);
    prop_assert!(apart < COVARIANCE_TOLERANCE, "covariance with a later closure {apart:e}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn what_is_left_is_solved_like_batch_in_the_plane(seed in any::<u64>(), poses in 12usize..50) {
        removes_like_batch::<3, Isometry2<f64>>(seed, poses)?;
    }

    #[test]
    fn what_is_left_is_solved_like_batch_in_space(seed in any::<u64>(), poses in 12usize..30) {
        removes_like_batch::<6, Isometry3<f64>>(seed, poses)?;
    }

    #[test]
    fn a_marginalised_pose_leaves_what_it_knew_in_the_plane(seed in any::<u64>(), poses in 8usize..40) {
        marginalises_like_batch::<3, Isometry2<f64>>(seed, poses)?;
    }

    #[test]
    fn a_marginalised_pose_leaves_what_it_knew_in_space(seed in any::<u64>(), poses in 8usize..20) {
        marginalises_like_batch::<6, Isometry3<f64>>(seed, poses)?;
    }
}

#[test]
fn a_window_that_moves_on_stays_small_and_near_the_batch_solution() {
    let mut world = World::<Isometry2<f64>>::new(3, 120);
    let mut window = Incremental::new(exact()).unwrap();
    let mut whole = Incremental::new(exact()).unwrap();
    for i in 0..120 {
        let noise = world.tangent::<3>(0.02);
        let guess = world.truth[i].plus(&noise);
        let information = Matrix3::identity() * 400.0;
        for smoother in [&mut window, &mut whole] {
            smoother.add_pose(key(i), guess).unwrap();
            if i == 0 {
                smoother.add_prior(key(0), guess, information, Kernel::None).unwrap();
            }
        }
        for other in i.saturating_sub(3)..i {
            let noise = world.tangent::<3>(0.02);
            let measured = world.truth[other].between(&world.truth[i]).plus(&noise);
            for smoother in [&mut window, &mut whole] {
                smoother.add_between(key(other), key(i), measured, information, Kernel::None).unwrap();
            }
        }
        window.update().unwrap();
        whole.update().unwrap();
        if i >= 10 {
            window.marginalise(key(i - 10)).unwrap();
        }
    }
    window.update().unwrap();
    assert_eq!(window.graph().pose_count(), 10);
    for (key, pose) in window.graph().poses() {
        let apart = pose.minus(whole.graph().pose(key).unwrap()).amax();
        assert!(apart < 2e-3, "{key}: {apart}");
    }
}

#[test]
fn removals_that_cannot_be_are_named() {
    let at = |x: f64| Isometry2::new(nalgebra::Vector2::new(x, 0.0), 0.0);
    let information = Matrix3::identity();
    let mut smoother = Incremental2::new(exact()).unwrap();
    assert_eq!(smoother.remove_pose(key(0)), Err(Error::UnknownKey { key: key(0) }));
    assert_eq!(smoother.marginalise(key(0)), Err(Error::UnknownKey { key: key(0) }));
    smoother.add_fixed_pose(key(0), at(0.0)).unwrap();
    for i in 1..4 {
        smoother.add_pose(key(i), at(i as f64)).unwrap();
        smoother.add_between(key(i - 1), key(i), at(1.0), information, Kernel::None).unwrap();
    }
    smoother.update().unwrap();
    let loose = smoother.clone();
    smoother.remove_pose(key(2)).unwrap();
    assert!(matches!(smoother.update(), Err(Error::NoGauge { key: k, size: 1 }) if k == key(3)));
    smoother.add_between(key(1), key(3), at(2.5), information, Kernel::None).unwrap();
    smoother.update().unwrap();
    assert!((smoother.graph().pose(key(3)).unwrap().translation.x - 3.5).abs() < 1e-9);
    assert!((smoother.covariance(key(3)).unwrap()[(0, 0)] - 2.0).abs() < 1e-9);
    // a fixed pose taken out leaves its neighbour held by what it measured
    let mut smoother = loose;
    smoother.marginalise(key(0)).unwrap();
    smoother.update().unwrap();
    assert!((smoother.graph().pose(key(3)).unwrap().translation.x - 3.0).abs() < 1e-9);
    assert!((smoother.covariance(key(3)).unwrap()[(0, 0)] - 3.0).abs() < 1e-9);
    // without the last pose nothing is left to say
    for i in 1..4 {
        assert!(smoother.marginalise(key(i)).is_ok());
    }
    assert!(matches!(smoother.update(), Err(Error::EmptyGraph)));
}

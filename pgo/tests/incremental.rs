//! Incremental smoothing against the batch solver.

mod common;

use draco_lie::LieGroup;
use draco_pgo::io::g2o::{self, AnyGraph};
use draco_pgo::{
    Error, FactorId, Gauge, Incremental, Incremental2, IncrementalMode, IncrementalParams, Kernel, Key,
    Marginals, Measurement, PoseGraph, PoseGraph2, SolveParams, chordal, solve,
};
use nalgebra::{Isometry2, Isometry3, Matrix3, SMatrix, SVector, Vector2};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

/// Largest distance of an exact estimate from the batch optimum, metres and radians.
const EXACT_TOLERANCE: f64 = 1e-8;

fn exact() -> IncrementalParams {
    IncrementalParams { mode: IncrementalMode::Exact, ..IncrementalParams::default() }
}

fn tight() -> SolveParams {
    SolveParams { relative_tolerance: 1e-15, ..SolveParams::default() }
}

/// A growing random graph: poses near a wandering truth, factors with small noise, some factors removed.
struct Growth<G, const N: usize> {
    rng: rand_chacha::ChaCha8Rng,
    truth: Vec<G>,
    smoother: Incremental<G, N>,
    removable: Vec<FactorId>,
}

impl<const N: usize, G: LieGroup<N>> Growth<G, N> {
    fn new(seed: u64) -> Self {
        let mut growth = Self {
            rng: rand_chacha::ChaCha8Rng::seed_from_u64(seed),
            truth: vec![G::identity()],
            smoother: Incremental::new(exact()).unwrap(),
            removable: Vec::new(),
        };
        let key = Key::new(0, 0);
        growth.smoother.add_pose(key, G::identity()).unwrap();
        let information = growth.information();
        growth.smoother.add_prior(key, G::identity(), information, Kernel::None).unwrap();
        growth
    }

    fn tangent(&mut self, size: f64) -> SVector<f64, N> {
        SVector::from_fn(|_, _| self.rng.random_range(-size..size))
    }

    fn information(&mut self) -> SMatrix<f64, N, N> {
        let a = SMatrix::<f64, N, N>::from_fn(|_, _| self.rng.random_range(-1.0..1.0));
        a * a.transpose() + SMatrix::identity() * 5.0
    }

    fn between(&mut self, from: usize, to: usize) -> FactorId {
        let noise = self.tangent(0.02);
        let measured = self.truth[from].between(&self.truth[to]).plus(&noise);
        let information = self.information();
        let [a, b] = [from, to].map(|i| Key::new(0, i as u64));
        self.smoother.add_between(a, b, measured, information, Kernel::None).unwrap()
    }

    /// One random change: a pose with its odometry, a closure, or a closure less.
    fn change(&mut self) {
        let last = self.truth.len() - 1;
        match self.rng.random_range(0..10) {
            0..=5 => {
                let step = self.tangent(1.0);
                self.truth.push(self.truth[last].plus(&step));
                let noise = self.tangent(0.05);
                let guess = self.truth[last + 1].plus(&noise);
                self.smoother.add_pose(Key::new(0, last as u64 + 1), guess).unwrap();
                self.between(last, last + 1);
            }
            6..=7 if last > 1 => {
                let (a, b) = (self.rng.random_range(0..last), self.rng.random_range(0..=last));
                if a != b {
                    let id = self.between(a, b);
                    self.removable.push(id);
                }
            }
            8 if !self.removable.is_empty() => {
                let at = self.rng.random_range(0..self.removable.len());
                let id = self.removable.swap_remove(at);
                self.smoother.remove_factor(id).unwrap();
            }
            9 => {
                let at = self.rng.random_range(0..=last);
                let information = self.information();
                let noise = self.tangent(0.02);
                let measured = self.truth[at].plus(&noise);
                let key = Key::new(0, at as u64);
                let id = self.smoother.add_prior(key, measured, information, Kernel::None).unwrap();
                self.removable.push(id);
            }
            _ => {}
        }
    }

    /// Largest distance from the batch optimum.
    fn distance(&self) -> f64 {
        let batch = solve(self.smoother.graph(), &tight()).unwrap();
        batch
            .poses()
            .map(|(key, pose)| self.smoother.graph().pose(key).unwrap().minus(pose).amax())
            .fold(0.0, f64::max)
    }
}

fn grows_like_batch<const N: usize, G: LieGroup<N>>(seed: u64, changes: usize) -> Result<(), TestCaseError> {
    let mut growth = Growth::<G, N>::new(seed);
    for at in 0..changes {
        growth.change();
        // several changes at once now and then
        if at % 3 != 1 {
            let report = growth.smoother.update().unwrap();
            prop_assert!(report.converged, "change {at}: {report:?}");
        }
        if at % 7 == 0 && at % 3 != 1 {
            let distance = growth.distance();
            prop_assert!(distance < EXACT_TOLERANCE, "after change {at}: {distance:e}");
        }
    }
    growth.smoother.update().unwrap();
    let distance = growth.distance();
    prop_assert!(distance < EXACT_TOLERANCE, "at the end: {distance:e}");
    let graph = growth.smoother.graph();
    let marginals = Marginals::new(graph, Gauge::Require).unwrap();
    let (first, last) = (Key::new(0, 0), Key::new(0, graph.pose_count() as u64 - 1));
    let mine = growth.smoother.joint_covariance(&[first, last]).unwrap();
    let batch = marginals.joint_of(&[first, last]).unwrap();
    prop_assert!((&mine - &batch).amax() < 1e-7 * batch.amax(), "{mine} instead of {batch}");
    let alone = growth.smoother.covariance(last).unwrap();
    prop_assert!((alone - batch.view((N, N), (N, N))).amax() < 1e-7 * batch.amax());
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn exact_mode_equals_batch_after_any_changes_in_the_plane(seed in any::<u64>(), changes in 1usize..60) {
        grows_like_batch::<3, Isometry2<f64>>(seed, changes)?;
    }

    #[test]
    fn exact_mode_equals_batch_after_any_changes_in_space(seed in any::<u64>(), changes in 1usize..40) {
        grows_like_batch::<6, Isometry3<f64>>(seed, changes)?;
    }
}

/// Feeds a graph pose by pose; returns the final cost.
fn replay<const N: usize, G: LieGroup<N>>(graph: &PoseGraph<G, N>, params: IncrementalParams) -> f64 {
    let mut smoother = Incremental::new(params).unwrap();
    let mut arriving: Vec<(Key, FactorId)> =
        graph.factors().map(|(id, factor)| (factor.keys().into_iter().max().unwrap(), id)).collect();
    arriving.sort_unstable();
    let mut arriving = arriving.into_iter().peekable();
    for (at, (key, first)) in graph.poses().enumerate() {
        let mut factors = Vec::new();
        while let Some((_, id)) = arriving.next_if(|(k, _)| *k == key) {
            factors.push(graph.factor(id).unwrap());
        }
        if at == 0 {
            smoother.add_fixed_pose(key, *first).unwrap();
            continue;
        }
        let guess = factors.iter().find_map(|factor| match &factor.measurement {
            Measurement::Between { from, to, measured } if *to == key => {
                smoother.graph().pose(*from).map(|pose| pose.compose(measured))
            }
            Measurement::Between { to, measured, .. } => {
                smoother.graph().pose(*to).map(|pose| pose.compose(&measured.inverse()))
            }
            _ => None,
        });
        smoother.add_pose(key, guess.unwrap_or(*first)).unwrap();
        for factor in factors {
            let Measurement::Between { from, to, measured } = factor.measurement else { continue };
            smoother.add_between(from, to, measured, factor.information, factor.kernel).unwrap();
        }
        smoother.update().unwrap();
    }
    smoother.graph().cost()
}

#[test]
fn replays_end_near_the_batch_optimum() {
    for (name, best) in [("intel", 22.502116), ("CSAIL", 20.275442)] {
        let Some(path) = common::data(&format!("pgo/{name}.g2o")) else { return };
        let AnyGraph::Two(mut graph) = g2o::read(path).unwrap() else { unreachable!("a set in the plane") };
        draco_pgo::spanning_tree(&mut graph).unwrap();
        let cost = replay(&graph, IncrementalParams::default());
        assert!(cost < best * 1.001, "{name}: {cost} instead of {best}");
    }
}

#[test]
fn an_exact_replay_in_space_ends_at_the_batch_optimum() {
    let Some(path) = common::data("pgo/smallGrid3D.g2o") else { return };
    let AnyGraph::Three(mut graph) = g2o::read(path).unwrap() else { unreachable!("a set in space") };
    chordal(&mut graph).unwrap();
    let cost = replay(&graph, exact());
    let best = solve(&graph, &tight()).unwrap().final_cost;
    assert!((cost - best).abs() < 1e-8 * best, "{cost} instead of {best}");
}

fn at(x: f64, y: f64, angle: f64) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(x, y), angle)
}

#[test]
fn a_loose_pose_is_named_and_may_be_tied_up_later() {
    let information = Matrix3::identity();
    let mut smoother = Incremental2::new(IncrementalParams::default()).unwrap();
    assert!(matches!(smoother.update(), Err(Error::EmptyGraph)));
    let keys: Vec<Key> = (0..3).map(|i| Key::new(0, i)).collect();
    smoother.add_fixed_pose(keys[0], at(0.0, 0.0, 0.0)).unwrap();
    smoother.add_pose(keys[1], at(1.0, 0.0, 0.0)).unwrap();
    let odometry =
        smoother.add_between(keys[0], keys[1], at(1.0, 0.0, 0.0), information, Kernel::None).unwrap();
    smoother.update().unwrap();
    smoother.add_pose(keys[2], at(9.0, 0.0, 0.0)).unwrap();
    assert!(matches!(smoother.update(), Err(Error::NoGauge { key, size: 1 }) if key == keys[2]));
    smoother.add_between(keys[1], keys[2], at(1.0, 0.0, 0.0), information, Kernel::None).unwrap();
    smoother.update().unwrap();
    assert!((smoother.graph().pose(keys[2]).unwrap().translation.x - 2.0).abs() < 1e-9);
    smoother.remove_factor(odometry).unwrap();
    assert!(matches!(smoother.update(), Err(Error::NoGauge { key, size: 2 }) if key == keys[1]));
    smoother.add_between(keys[0], keys[1], at(2.0, 0.0, 0.0), information, Kernel::None).unwrap();
    smoother.update().unwrap();
    assert!((smoother.graph().pose(keys[2]).unwrap().translation.x - 3.0).abs() < 1e-9);
    assert!(smoother.covariance(Key::new(5, 5)).is_err());
    assert_eq!(smoother.covariance(keys[0]).unwrap(), Matrix3::zeros());
}

/// A square walked twice. Each second pose of the second round has a right closure under a kernel, the others have
/// a false one if `spoiled`; the first closure is false where `false_first`.
fn square(spoiled: bool, false_first: bool) -> Vec<Isometry2<f64>> {
    let information = Matrix3::from_diagonal(&nalgebra::Vector3::new(1e3, 1e3, 1e4));
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let step = |i: u64| at(1.0, 0.0, if i % 10 == 9 { std::f64::consts::FRAC_PI_2 } else { 0.0 });
    let mut smoother = Incremental2::new(IncrementalParams::default()).unwrap();
    smoother.add_fixed_pose(Key::new(0, 0), at(0.0, 0.0, 0.0)).unwrap();
    for i in 0..80u64 {
        let (last, key) = (Key::new(0, i), Key::new(0, i + 1));
        let noise = nalgebra::Vector3::from_fn(|r, _| [0.05, 0.05, 0.02][r] * rng.random_range(-1.0..1.0));
        let measured = step(i).plus(&noise);
        let guess = *smoother.graph().pose(last).unwrap() * measured;
        smoother.add_pose(key, guess).unwrap();
        smoother.add_between(last, key, measured, information, Kernel::None).unwrap();
        let right = (i % 2 == 0) != false_first;
        if i >= 40 && (right || spoiled) {
            let z = if right { at(0.0, 0.0, 0.0) } else { at(3.0, -4.0, 1.0) };
            let other = Key::new(0, i + 1 - 40);
            smoother.add_between(other, key, z, information, Kernel::GemanMcClure(2.0)).unwrap();
        }
        smoother.update().unwrap();
    }
    smoother.graph().poses().map(|(_, pose)| *pose).collect()
}

#[test]
fn graduated_kernels_shrug_off_false_closures() {
    for false_first in [false, true] {
        let (clean, spoiled) = (square(false, false_first), square(true, false_first));
        let apart = clean.iter().zip(&spoiled).map(|(a, b)| a.minus(b).amax()).fold(0.0, f64::max);
        assert!(apart < 0.03, "false closures first: {false_first}, apart {apart}");
    }
}

#[test]
fn bad_parameters_are_named() {
    let bad = |params| Incremental2::new(params).err();
    let default = IncrementalParams::default;
    assert!(matches!(
        bad(IncrementalParams { relinearize_threshold: -1.0, ..default() }),
        Some(Error::Parameter { name: "relinearize_threshold", .. })
    ));
    assert!(bad(IncrementalParams { graduation: Some(1.0), ..default() }).is_some());
    assert!(bad(IncrementalParams { exact_tolerance: f64::NAN, ..default() }).is_some());
    let _: PoseGraph2 = Incremental2::new(default()).unwrap().into_graph();
}

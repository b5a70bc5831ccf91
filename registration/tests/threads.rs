//! The feature `rayon` changes how long an alignment takes and nothing else.
#![cfg(feature = "rayon")]

use draco_registration::{Cloud, IcpParams, KdTree, Registration, Residual, Target};
use nalgebra::{Isometry2, Isometry3, SVector, Vector2, Vector3};

/// The same on one, two, three and four threads, and on four again.
fn same<T: PartialEq + std::fmt::Debug + Send>(name: &str, work: impl Fn() -> T + Sync) {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(&work)
    };
    let one = on(1);
    for threads in [2, 3, 4, 4] {
        assert!(on(threads) == one, "{name} differs on {threads} threads");
    }
}

/// A sheet of hills with a mast, large enough to be cut into several runs.
fn hills(count: u32) -> Vec<Vector3<f64>> {
    let side = f64::from(count).sqrt();
    (0..count)
        .map(|i| {
            let (u, v) = (f64::from(i) % side / side * 40.0, f64::from(i) / side / side * 40.0);
            let mast = if i % 50 == 0 { f64::from(i % 7) } else { 0.0 };
            Vector3::new(u, v, (0.4 * u).sin() + (0.3 * v).cos() + mast)
        })
        .collect()
}

/// Every number of an answer, as bits.
fn bits<const N: usize>(pose: Vec<f64>, covariance: &nalgebra::SMatrix<f64, N, N>) -> Vec<u64> {
    pose.into_iter().chain(covariance.iter().copied()).map(f64::to_bits).collect()
}

fn bits_3(found: &Registration<Isometry3<f64>, 6>) -> Vec<u64> {
    let matrix = found.target_from_source.to_homogeneous();
    bits(matrix.iter().copied().collect(), &found.covariance)
}

#[test]
fn a_tree_and_normals_are_the_same_on_any_number_of_threads() {
    let points = hills(20_000);
    same("the tree", || {
        let tree = KdTree::new(&points).unwrap();
        points.iter().step_by(17).map(|p| tree.k_nearest(&(p * 1.01), 5)).collect::<Vec<_>>()
    });
    same("normals", || {
        let cloud = Cloud::new(points.clone()).unwrap().estimate_normals(10, &Vector3::zeros()).unwrap();
        cloud.normals().unwrap().iter().flat_map(|n| n.iter().map(|v| v.to_bits())).collect::<Vec<_>>()
    });
}

#[test]
fn an_alignment_is_the_same_on_any_number_of_threads() {
    let points = hills(20_000);
    let truth = Isometry3::new(Vector3::new(0.2, -0.1, 0.1), Vector3::new(0.01, -0.02, 0.03));
    let moved: Vec<_> = points.iter().map(|p| truth.inverse_transform_point(&(*p).into()).coords).collect();
    let ready = |points: &[Vector3<f64>]| {
        Cloud::new(points.to_vec()).unwrap().estimate_normals(10, &Vector3::zeros()).unwrap()
    };
    for residual in [Residual::PointToPoint, Residual::PointToPlane, Residual::PlaneToPlane] {
        same(&format!("{residual:?}"), || {
            let params = IcpParams { residual, ..IcpParams::lidar_3d() };
            let target = Target::new(&ready(&points)).unwrap();
            bits_3(&target.align(&ready(&moved), &Isometry3::identity(), &params).unwrap())
        });
    }
    let flat = |points: &[Vector3<f64>]| points.iter().map(|p| p.xy()).collect::<Vec<SVector<f64, 2>>>();
    same("in the plane", || {
        let target = Target::new(&Cloud::new(flat(&points)).unwrap()).unwrap();
        let start = Isometry2::new(Vector2::new(0.05, 0.0), 0.01);
        let source = Cloud::new(flat(&moved)).unwrap();
        let found = target.align(&source, &start, &IcpParams::sonar_2d()).unwrap();
        bits(found.target_from_source.to_homogeneous().iter().copied().collect(), &found.covariance)
    });
}

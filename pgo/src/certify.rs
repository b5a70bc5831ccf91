use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::chordal::{ChordalPose, Edge};
use crate::sparse::{BlockMatrix, Cholesky, Symbolic};
use crate::{CustomFactor, Error, Kernel, Key, PoseGraph};

/// What [`certify`] found about the poses of a graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// The chordal objective `F = Σ κ |R_j - R_i R_ij|² + τ |t_j - t_i - R_i t_ij|²`, without a factor ½.
    pub objective: f64,
    /// The smallest of 1e-8, 1e-7, ... 1e-2 for which the certificate matrix plus that multiple of the identity is
    /// positive definite: no eigenvalue is below its negative. `None`: the poses are not certified.
    pub slack: Option<f64>,
    /// Largest entry of the certificate matrix times the poses; zero at a stationary point. A certificate means
    /// something only where this is small against the weights.
    pub stationarity: f64,
}

/// Whether the poses of `graph` are a **global** minimum of the chordal objective, by positive definiteness of the
/// dual certificate matrix.
///
/// Optimise [`chordal_objective`] first: the minimum of the graph's own cost is another point. Fixed poses,
/// priors, kernels and user-defined factors are not looked at.
///
/// Costs one to seven factorisations with blocks one wider than the dimension of space.
///
/// **Source**: Rosen, Carlone, Bandeira, Leonard, *SE-Sync: A certifiably correct algorithm for synchronization
/// over the special Euclidean group*, 2019; Carlone, Rosen, Calafiore, Leonard, Dellaert, *Lagrangian duality in
/// 3D SLAM*, 2015.
///
/// # Errors
/// [`Error::EmptyGraph`].
pub fn certify<const N: usize, G: ChordalPose<N>>(graph: &PoseGraph<G, N>) -> Result<Certificate, Error> {
    if graph.pose_count() == 0 {
        return Err(Error::EmptyGraph);
    }
    G::certify(graph)
}

/// The graph whose cost is half the chordal objective of `graph`: the same poses and fixed poses, and one
/// user-defined factor a relative pose. Priors, kernels and other factors are left out.
///
/// # Errors
/// [`Error::UnknownKey`] cannot happen with a graph made by this crate.
pub fn chordal_objective<const N: usize, G: ChordalPose<N>>(
    graph: &PoseGraph<G, N>,
) -> Result<PoseGraph<G, N>, Error> {
    let mut objective = PoseGraph::new();
    for (slot, key) in graph.keys.iter().enumerate() {
        objective.add_pose(*key, graph.poses[slot])?;
        objective.set_fixed(*key, graph.fixed[slot])?;
    }
    for factor in G::chordal_factors(graph)? {
        objective.add_custom(factor, Kernel::None)?;
    }
    Ok(objective)
}

/// One relative pose in the chordal objective; `D` is the dimension of space.
#[derive(Debug)]
pub(crate) struct ChordalFactor<const D: usize> {
    pub(crate) keys: [Key; 2],
    pub(crate) edge: Edge<D>,
}

/// Rotation matrix and translation of a pose.
pub(crate) type Parts<const D: usize> = (SMatrix<f64, D, D>, SVector<f64, D>);

impl<const D: usize> ChordalFactor<D> {
    /// Rows of the rotation residual, column by column, then those of the translation.
    pub(crate) fn write_residual(&self, [a, b]: [Parts<D>; 2], residual: &mut [f64]) {
        let rotation = (b.0 - a.0 * self.edge.rotation) * self.edge.kappa.sqrt();
        let translation = (b.1 - a.1 - a.0 * self.edge.translation) * self.edge.tau.sqrt();
        for (to, from) in residual.iter_mut().zip(rotation.iter().chain(translation.iter())) {
            *to = *from;
        }
    }

    /// Derivative by the right perturbation of either pose, `N` columns: with `G_k` the generators of rotation,
    /// `dR = R G_k` and `dt = R ρ`.
    pub(crate) fn write_jacobian<const N: usize>(
        &self,
        [a, b]: [Parts<D>; 2],
        which: usize,
        generators: &[SMatrix<f64, D, D>],
        jacobian: &mut [f64],
    ) {
        let (kappa, tau) = (self.edge.kappa.sqrt(), self.edge.tau.sqrt());
        let (sign, pose) = if which == 0 { (-1.0, a) } else { (1.0, b) };
        for c in 0..D {
            for r in 0..D {
                jacobian[(D * D + r) * N + c] = sign * tau * pose.0[(r, c)];
            }
        }
        for (k, generator) in generators.iter().enumerate() {
            let turned = pose.0 * generator;
            let rotation = if which == 0 { turned * self.edge.rotation } else { turned };
            for (row, value) in rotation.iter().enumerate() {
                jacobian[row * N + D + k] = sign * kappa * value;
            }
            if which == 0 {
                let moved = turned * self.edge.translation;
                for r in 0..D {
                    jacobian[(D * D + r) * N + D + k] = -tau * moved[r];
                }
            }
        }
    }
}

/// The certificate for poses given as rotations and translations; `M = D + 1`.
pub(crate) fn certify_parts<const D: usize, const M: usize>(
    edges: &[Edge<D>],
    poses: &[Parts<D>],
) -> Result<Certificate, Error> {
    let mut objective = 0.0;
    let zero = SMatrix::<f64, M, M>::zeros();
    let mut pairs: Vec<(u32, u32)> =
        edges.iter().map(|e| (e.slots[0].max(e.slots[1]), e.slots[0].min(e.slots[1]))).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let mut matrix = BlockMatrix { diagonal: vec![zero; poses.len()], off_diagonal: vec![zero; pairs.len()] };
    for edge in edges {
        let [i, j] = edge.slots;
        let (a, b) = (poses[i as usize], poses[j as usize]);
        objective += edge.kappa * (b.0 - a.0 * edge.rotation).norm_squared()
            + edge.tau * (b.1 - a.1 - a.0 * edge.translation).norm_squared();
        let (at_i, at_j, mixed) = connection::<D, M>(edge);
        matrix.diagonal[i as usize] += at_i;
        matrix.diagonal[j as usize] += at_j;
        if let Ok(pair) = pairs.binary_search(&(i.max(j), i.min(j))) {
            matrix.off_diagonal[pair] += if j > i { mixed } else { mixed.transpose() };
        }
    }
    let product = times_poses(&matrix, &pairs, poses);
    let mut stationarity: f64 = 0.0;
    for ((block, q), (rotation, _)) in matrix.diagonal.iter_mut().zip(&product).zip(poses) {
        let upper: SMatrix<f64, D, D> = q.fixed_view::<D, D>(0, 0).into_owned();
        let raw = upper * rotation;
        let multiplier = (raw + raw.transpose()) * 0.5;
        let rest = upper - multiplier * rotation.transpose();
        stationarity = stationarity.max(rest.amax()).max(q.row(D).amax());
        for c in 0..D {
            for r in 0..D {
                block[(r, c)] -= multiplier[(r, c)];
            }
        }
    }
    let symbolic = Arc::new(Symbolic::new(poses.len(), &pairs, M));
    let mut cholesky = Cholesky::<M>::new(symbolic, &pairs);
    let slack = (2..=8).rev().map(|digits| 10f64.powi(-digits)).find(|slack| {
        let shift = vec![SVector::<f64, M>::from_element(*slack); poses.len()];
        cholesky.factor(&matrix, Some(&shift)).is_ok()
    });
    Ok(Certificate { objective, slack, stationarity })
}

/// The three blocks one edge adds to the matrix of the objective: at `(i, i)`, `(j, j)` and `(j, i)`.
fn connection<const D: usize, const M: usize>(
    edge: &Edge<D>,
) -> (SMatrix<f64, M, M>, SMatrix<f64, M, M>, SMatrix<f64, M, M>) {
    let (mut at_i, mut at_j, mut mixed) = (SMatrix::zeros(), SMatrix::zeros(), SMatrix::zeros());
    // the translation seen from `i` as a column (t, 1)
    let seen = SVector::<f64, M>::from_fn(|r, _| if r < D { edge.translation[r] } else { 1.0 });
    for k in 0..D {
        at_i[(k, k)] = edge.kappa;
        at_j[(k, k)] = edge.kappa;
        for c in 0..D {
            mixed[(k, c)] = -edge.kappa * edge.rotation[(c, k)];
        }
    }
    at_j[(D, D)] += edge.tau;
    at_i += seen * seen.transpose() * edge.tau;
    for c in 0..M {
        mixed[(D, c)] -= edge.tau * seen[c];
    }
    (at_i, at_j, mixed)
}

/// The matrix times the stacked transposed poses `(R, t)ᵀ`, by node.
fn times_poses<const D: usize, const M: usize>(
    matrix: &BlockMatrix<M>,
    pairs: &[(u32, u32)],
    poses: &[Parts<D>],
) -> Vec<SMatrix<f64, M, D>> {
    let stacked: Vec<SMatrix<f64, M, D>> =
        poses.iter().map(|(r, t)| SMatrix::from_fn(|i, c| if i < D { r[(c, i)] } else { t[c] })).collect();
    let mut product: Vec<SMatrix<f64, M, D>> =
        matrix.diagonal.iter().zip(&stacked).map(|(block, x)| block * x).collect();
    for (block, (row, column)) in matrix.off_diagonal.iter().zip(pairs) {
        product[*row as usize] += block * stacked[*column as usize];
        product[*column as usize] += block.transpose() * stacked[*row as usize];
    }
    product
}

impl CustomFactor<nalgebra::Isometry2<f64>, 3> for ChordalFactor<2> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }
    fn dimension(&self) -> usize {
        6
    }
    fn residual(&self, poses: &[nalgebra::Isometry2<f64>], residual: &mut [f64]) {
        self.write_residual([parts2(&poses[0]), parts2(&poses[1])], residual);
    }
    fn jacobian(&self, poses: &[nalgebra::Isometry2<f64>], which: usize, jacobian: &mut [f64]) {
        let generators = [nalgebra::Matrix2::new(0.0, -1.0, 1.0, 0.0)];
        self.write_jacobian::<3>([parts2(&poses[0]), parts2(&poses[1])], which, &generators, jacobian);
    }
}

impl CustomFactor<nalgebra::Isometry3<f64>, 6> for ChordalFactor<3> {
    fn keys(&self) -> &[Key] {
        &self.keys
    }
    fn dimension(&self) -> usize {
        12
    }
    fn residual(&self, poses: &[nalgebra::Isometry3<f64>], residual: &mut [f64]) {
        self.write_residual([parts3(&poses[0]), parts3(&poses[1])], residual);
    }
    fn jacobian(&self, poses: &[nalgebra::Isometry3<f64>], which: usize, jacobian: &mut [f64]) {
        let generators = [0, 1, 2].map(|k| draco_lie::hat3(&nalgebra::Vector3::ith(k, 1.0)));
        self.write_jacobian::<6>([parts3(&poses[0]), parts3(&poses[1])], which, &generators, jacobian);
    }
}

pub(crate) fn parts2(x: &nalgebra::Isometry2<f64>) -> Parts<2> {
    (x.rotation.to_rotation_matrix().into_inner(), x.translation.vector)
}

pub(crate) fn parts3(x: &nalgebra::Isometry3<f64>) -> Parts<3> {
    (x.rotation.to_rotation_matrix().into_inner(), x.translation.vector)
}

/// The chordal factors of a graph whose edges are `edges`.
pub(crate) fn factors<const N: usize, const D: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    edges: Vec<Edge<D>>,
) -> Vec<Arc<dyn CustomFactor<G, N>>>
where
    ChordalFactor<D>: CustomFactor<G, N> + 'static,
{
    let factor = |edge: Edge<D>| ChordalFactor { keys: edge.slots.map(|s| graph.keys[s as usize]), edge };
    edges.into_iter().map(|e| Arc::new(factor(e)) as Arc<dyn CustomFactor<G, N>>).collect()
}

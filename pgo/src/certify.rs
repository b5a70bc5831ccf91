use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::chordal::{ChordalPose, Edge};
use crate::pattern::{Elimination, Pattern};
use crate::sparse::{BlockMatrix, Cholesky};
use crate::staircase::lifted::Lifted;
use crate::{CustomFactor, Error, Kernel, Key, PoseGraph};

/// What [`certify`] found about the poses of a graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// The chordal objective `F = Σ κ |R_j - R_i R_ij|² + τ |t_j - t_i - R_i t_ij|²`, without a factor ½.
    pub objective: f64,
    /// The smallest of 1e-8, 1e-7, ... 1e-2 for which the certificate matrix plus that multiple of the identity on
    /// the rotations is positive definite. `None`: the poses are not certified.
    pub slack: Option<f64>,
    /// No poses whatever have an objective lower by more than this, the slack times the squared norm of all
    /// rotations; `None` without certificate.
    pub gap: Option<f64>,
    /// Largest entry of half the gradient; zero at a stationary point. A certificate means something only where
    /// this is small against the weights.
    pub stationarity: f64,
}

/// Whether the poses of `graph` are a **global** minimum of the chordal objective, by positive definiteness of the
/// dual certificate matrix.
///
/// Optimise [`chordal_objective`] first: the minimum of the graph's own cost is another point. Fixed poses,
/// priors, kernels and user-defined factors are not looked at.
///
/// Costs one to seven factorisations with blocks one wider than the dimension of space, in the elimination order that
/// [`crate::solve()`] or [`crate::chordal()`] left in the graph, else one of its own: where the first slack does, little
/// more than one Gauss-Newton iteration and the order.
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
    elimination: &Elimination,
) -> Certificate {
    certify_parts_with(&mut Dual::<D, M>::new(edges, poses.len(), elimination), edges, poses)
}

/// The same with the matrix of the objective given, which is lost.
pub(crate) fn certify_parts_with<const D: usize, const M: usize>(
    dual: &mut Dual<D, M>,
    edges: &[Edge<D>],
    poses: &[Parts<D>],
) -> Certificate {
    let problem = Lifted::<D, M> { edges, nodes: poses.len() };
    let point = Lifted::<D, M>::point(poses);
    let mut product = vec![0.0; point.x.len()];
    problem.times(&point.x, point.rank, &mut product);
    let multipliers = problem.multipliers(&point, &product);
    problem.project(&point, &mut product);
    let stationarity = product.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let matrix = dual.turn_into_certificate_matrix(&multipliers);
    let slack = dual.slack(&matrix, f64::INFINITY);
    let gap = slack.map(|slack| dual.gap(slack));
    Certificate { objective: problem.cost(&point), slack, gap, stationarity }
}

/// The matrix `Q` of the chordal objective `tr(X Q Xᵀ)` and the memory to factor it less multipliers.
pub(crate) struct Dual<const D: usize, const M: usize> {
    /// Places of the off-diagonal blocks.
    pub(crate) pairs: Vec<(u32, u32)>,
    objective: BlockMatrix<M>,
    cholesky: Cholesky<M>,
    /// Added to the diagonal: pins one translation in each connected part, which nothing else determines.
    pins: Vec<SVector<f64, M>>,
    shift: Vec<SVector<f64, M>>,
}

/// Smallest slack a certificate is tried with: rounding of matrices with entries of a few thousands.
const LEAST_SLACK: f64 = 1e-8;
/// Shift of the preconditioner, relative to the largest entry: leaves it definite when the noise is zero.
const PRECONDITIONER_SHIFT: f64 = 1e-9;

impl<const D: usize, const M: usize> Dual<D, M> {
    pub(crate) fn new(edges: &[Edge<D>], nodes: usize, elimination: &Elimination) -> Self {
        let (pattern, places) = Pattern::new(vec![false; nodes], edges.iter().map(|edge| edge.slots));
        let zero = SMatrix::<f64, M, M>::zeros();
        let mut objective =
            BlockMatrix { diagonal: vec![zero; nodes], off_diagonal: vec![zero; pattern.pairs.len()] };
        let mut group: Vec<u32> = (0..nodes as u32).collect();
        for (edge, place) in edges.iter().zip(places) {
            let [i, j] = edge.slots;
            crate::graph::union(&mut group, i, j);
            let (at_i, at_j, mixed) = connection::<D, M>(edge);
            objective.diagonal[i as usize] += at_i;
            objective.diagonal[j as usize] += at_j;
            objective.off_diagonal[place as usize] += if j > i { mixed } else { mixed.transpose() };
        }
        let mut pins = vec![SVector::zeros(); nodes];
        for node in 0..nodes as u32 {
            if crate::graph::find(&mut group, node) == node {
                pins[node as usize][D] = 1.0 + objective.diagonal[node as usize][(D, D)];
            }
        }
        let cholesky = Cholesky::<M>::new(elimination.symbolic(&pattern, M), &pattern.pairs);
        Self { shift: pins.clone(), pairs: pattern.pairs, objective, cholesky, pins }
    }

    /// The order of elimination.
    pub(crate) fn order(&self) -> &[u32] {
        &self.cholesky.symbolic().order
    }

    pub(crate) fn nodes(&self) -> usize {
        self.pins.len()
    }

    /// Whether each node is the pinned one of its connected part.
    pub(crate) fn pinned(&self) -> impl Iterator<Item = bool> + '_ {
        self.pins.iter().map(|pin| pin[D] > 0.0)
    }

    /// The diagonal block of `Q` at a node.
    pub(crate) fn objective_block(&self, node: usize) -> &SMatrix<f64, M, M> {
        &self.objective.diagonal[node]
    }

    /// A factor of `Q`, slightly shifted.
    ///
    /// # Errors
    /// The node at which a pivot was not positive.
    pub(crate) fn preconditioner(&mut self) -> Result<Cholesky<M>, usize> {
        let scale = self.objective.diagonal.iter().map(SMatrix::amax).fold(0.0, f64::max);
        self.set_shift(PRECONDITIONER_SHIFT * scale);
        let mut cholesky = self.cholesky.clone();
        cholesky.factor(&self.objective, Some(&self.shift)).map(|()| cholesky)
    }

    /// `Q - Λ`.
    pub(crate) fn certificate_matrix(&self, multipliers: &[SMatrix<f64, D, D>]) -> BlockMatrix<M> {
        let mut matrix = self.objective.clone();
        subtract(&mut matrix, multipliers);
        matrix
    }

    /// The same in the memory of `Q`, which is lost.
    fn turn_into_certificate_matrix(&mut self, multipliers: &[SMatrix<f64, D, D>]) -> BlockMatrix<M> {
        let nothing = BlockMatrix { diagonal: Vec::new(), off_diagonal: Vec::new() };
        let mut matrix = std::mem::replace(&mut self.objective, nothing);
        subtract(&mut matrix, multipliers);
        matrix
    }

    fn set_shift(&mut self, shift: f64) {
        for (s, pin) in self.shift.iter_mut().zip(&self.pins) {
            *s = SVector::from_fn(|row, _| if row < D { shift } else { pin[D] });
        }
    }

    /// Whether the matrix plus `shift` times the identity on the rotations is positive definite; if so, its factor
    /// is what [`Dual::solve`] uses.
    pub(crate) fn is_positive(&mut self, matrix: &BlockMatrix<M>, shift: f64) -> bool {
        self.set_shift(shift);
        self.cholesky.factor(matrix, Some(&self.shift)).is_ok()
    }

    /// Solves with the matrix that was last found positive.
    pub(crate) fn solve(&mut self, v: &mut [SVector<f64, M>]) {
        self.cholesky.solve(v);
    }

    /// The smallest of 1e-8, 1e-7, ... 1e-2 that makes the matrix positive definite; past the first only while the
    /// gap is at most `largest_gap`.
    pub(crate) fn slack(&mut self, matrix: &BlockMatrix<M>, largest_gap: f64) -> Option<f64> {
        (2..=8)
            .rev()
            .map(|digits| 10f64.powi(-digits))
            .take_while(|slack| {
                *slack <= LEAST_SLACK || self.pins.len() as f64 * D as f64 * slack <= largest_gap
            })
            .collect::<Vec<f64>>()
            .into_iter()
            .find(|slack| self.is_positive(matrix, *slack))
    }

    /// How far the objective can be from the optimum: each rotation has squared norm `D`.
    pub(crate) fn gap(&self, slack: f64) -> f64 {
        slack * (self.pins.len() * D) as f64
    }
}

fn subtract<const D: usize, const M: usize>(matrix: &mut BlockMatrix<M>, multipliers: &[SMatrix<f64, D, D>]) {
    for (block, multiplier) in matrix.diagonal.iter_mut().zip(multipliers) {
        let mut rotation = block.fixed_view_mut::<D, D>(0, 0);
        rotation -= multiplier;
    }
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

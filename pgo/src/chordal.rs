use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, Matrix2, Rotation2, Rotation3, SMatrix, SVector};
use nalgebra::{Translation, UnitComplex, UnitQuaternion};

use crate::certify::{Certificate, Parts, certify_parts, factors, parts2, parts3};
use crate::key_table::KeyTable;
use crate::nearest_rotation::nearest_rotation;
use crate::pattern::{HELD, Pattern};
use crate::sparse::{BlockMatrix, Cholesky, Symbolic};
use crate::staircase::{StaircaseParams, StaircaseSolution, climb};
use crate::{CustomFactor, Error, Measurement, PoseGraph};

/// Poses for which chordal relaxation is known: those of the plane and of space.
pub trait ChordalPose<const N: usize>: LieGroup<N> {
    /// The relaxed poses of a graph, by slot; called by [`chordal`].
    #[doc(hidden)]
    fn relax(graph: &PoseGraph<Self, N>) -> Result<Vec<Self>, Error>;

    /// The terms of the chordal objective; called by [`crate::chordal_objective`].
    #[doc(hidden)]
    fn chordal_factors(graph: &PoseGraph<Self, N>) -> Result<Vec<Arc<dyn CustomFactor<Self, N>>>, Error>;

    /// The certificate at the present poses; called by [`crate::certify()`].
    #[doc(hidden)]
    fn certify(graph: &PoseGraph<Self, N>) -> Result<Certificate, Error>;

    /// The staircase from the present poses; called by [`crate::staircase()`].
    #[doc(hidden)]
    fn staircase(
        graph: &PoseGraph<Self, N>,
        params: &StaircaseParams,
    ) -> Result<StaircaseSolution<Self>, Error>;
}

/// Moves the poses of `graph` to the chordal relaxation of its relative poses, which needs no first guess:
/// rotations first, by linear least squares on their matrices and projection, then translations.
///
/// Fixed poses stay. In a connected part without one, the first pose with a prior moves to the prior and stays
/// there, else the part's first pose stays where it is. Poses on no relative pose stay, too. Kernels and
/// user-defined factors are not looked at: outliers spoil this start.
///
/// Costs a factorisation with blocks of the rotations' dimension and one with scalar entries, both on one analysis of
/// one elimination order: about one Gauss-Newton iteration, and the order when the graph has none yet. The graph keeps
/// the order, so that [`crate::solve()`], [`crate::Marginals`] and [`crate::certify()`] do not look for one again while
/// the same poses are joined.
///
/// **Source**: Martinec, Pajdla, *Robust Rotation and Translation Estimation in Multiview Reconstruction*, 2007;
/// Carlone, Tron, Daniilidis, Dellaert, *Initialization Techniques for 3D SLAM*, 2015. Weights as in Rosen,
/// Carlone, Bandeira, Leonard, *SE-Sync*, 2019.
///
/// # Errors
/// [`Error::EmptyGraph`], [`Error::Indefinite`] when rounding defeats the factorisation.
pub fn chordal<const N: usize, G: ChordalPose<N>>(graph: &mut PoseGraph<G, N>) -> Result<(), Error> {
    if graph.pose_count() == 0 {
        return Err(Error::EmptyGraph);
    }
    graph.poses = G::relax(graph)?;
    Ok(())
}

impl ChordalPose<3> for Isometry2<f64> {
    fn relax(graph: &PoseGraph<Self, 3>) -> Result<Vec<Self>, Error> {
        let edges = edges2(graph)?;
        let start: Vec<Start<2>> = starts(graph, &edges, parts2);
        let project = |m: &Matrix2<f64>| {
            // the nearest rotation has the direction of the sums of the entries
            let (cosine, sine) = (m.m11 + m.m22, m.m21 - m.m12);
            let norm = cosine.hypot(sine);
            let (c, s) = if norm > 0.0 { (cosine / norm, sine / norm) } else { (1.0, 0.0) };
            Matrix2::new(c, -s, s, c)
        };
        let relaxed = relax(graph, &edges, &start, project)?;
        Ok(relaxed.iter().map(pose2).collect())
    }

    fn chordal_factors(graph: &PoseGraph<Self, 3>) -> Result<Vec<Arc<dyn CustomFactor<Self, 3>>>, Error> {
        Ok(factors(graph, edges2(graph)?))
    }

    fn certify(graph: &PoseGraph<Self, 3>) -> Result<Certificate, Error> {
        let poses: Vec<Parts<2>> = graph.poses.iter().map(parts2).collect();
        Ok(certify_parts::<2, 3>(&edges2(graph)?, &poses, &graph.elimination))
    }

    fn staircase(
        graph: &PoseGraph<Self, 3>,
        params: &StaircaseParams,
    ) -> Result<StaircaseSolution<Self>, Error> {
        let (edges, start) = (edges2(graph)?, graph.poses.iter().map(parts2).collect::<Vec<_>>());
        let climb = climb::<2, 3, 3>(&edges, &start, params, &graph.elimination)
            .map_err(|slot| Error::Indefinite { key: graph.keys[slot] })?;
        let poses = climb.poses.iter().map(pose2).collect();
        Ok(climb.into_solution(graph, &edges, poses))
    }
}

impl ChordalPose<6> for Isometry3<f64> {
    fn relax(graph: &PoseGraph<Self, 6>) -> Result<Vec<Self>, Error> {
        let edges = edges3(graph)?;
        let start: Vec<Start<3>> = starts(graph, &edges, parts3);
        let relaxed = relax(graph, &edges, &start, nearest_rotation)?;
        Ok(relaxed.iter().map(pose3).collect())
    }

    fn chordal_factors(graph: &PoseGraph<Self, 6>) -> Result<Vec<Arc<dyn CustomFactor<Self, 6>>>, Error> {
        Ok(factors(graph, edges3(graph)?))
    }

    fn certify(graph: &PoseGraph<Self, 6>) -> Result<Certificate, Error> {
        let poses: Vec<Parts<3>> = graph.poses.iter().map(parts3).collect();
        Ok(certify_parts::<3, 4>(&edges3(graph)?, &poses, &graph.elimination))
    }

    fn staircase(
        graph: &PoseGraph<Self, 6>,
        params: &StaircaseParams,
    ) -> Result<StaircaseSolution<Self>, Error> {
        let (edges, start) = (edges3(graph)?, graph.poses.iter().map(parts3).collect::<Vec<_>>());
        let climb = climb::<3, 4, 6>(&edges, &start, params, &graph.elimination)
            .map_err(|slot| Error::Indefinite { key: graph.keys[slot] })?;
        let poses = climb.poses.iter().map(pose3).collect();
        Ok(climb.into_solution(graph, &edges, poses))
    }
}

fn pose2((r, t): &Parts<2>) -> Isometry2<f64> {
    let rotation = UnitComplex::from_rotation_matrix(&Rotation2::from_matrix_unchecked(*r));
    Isometry2::from_parts(Translation::from(*t), rotation)
}

fn pose3((r, t): &Parts<3>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*r));
    Isometry3::from_parts(Translation::from(*t), rotation)
}

fn edges2(graph: &PoseGraph<Isometry2<f64>, 3>) -> Result<Vec<Edge<2>>, Error> {
    edges(graph, |z, information| Edge {
        rotation: z.rotation.to_rotation_matrix().into_inner(),
        translation: z.translation.vector,
        kappa: information[(2, 2)],
        tau: harmonic::<2>(&information.fixed_view::<2, 2>(0, 0).into_owned()),
        ..Edge::default()
    })
}

fn edges3(graph: &PoseGraph<Isometry3<f64>, 6>) -> Result<Vec<Edge<3>>, Error> {
    edges(graph, |z, information| Edge {
        rotation: z.rotation.to_rotation_matrix().into_inner(),
        translation: z.translation.vector,
        kappa: 0.5 * harmonic::<3>(&information.fixed_view::<3, 3>(3, 3).into_owned()),
        tau: harmonic::<3>(&information.fixed_view::<3, 3>(0, 0).into_owned()),
        ..Edge::default()
    })
}

/// `D / tr(Ω⁻¹)`: the isotropic information with the same total variance.
fn harmonic<const D: usize>(information: &SMatrix<f64, D, D>) -> f64 {
    let (mut l, mut inverse) = (*information, SMatrix::<f64, D, D>::zeros());
    let mut trace = 0.0;
    for c in 0..D {
        let pivot = l[(c, c)] - (0..c).map(|k| l[(c, k)] * l[(c, k)]).sum::<f64>();
        if pivot.is_nan() || pivot <= 0.0 {
            return 0.0;
        }
        let root = pivot.sqrt();
        for r in c + 1..D {
            l[(r, c)] = (l[(r, c)] - (0..c).map(|k| l[(r, k)] * l[(c, k)]).sum::<f64>()) / root;
        }
        // row `c` of `L⁻¹`; with `Ω = L Lᵀ` the trace of the inverse is the sum of its squares
        for k in 0..=c {
            let own = if k == c { 1.0 } else { 0.0 };
            let value = (own - (k..c).map(|i| l[(c, i)] * inverse[(i, k)]).sum::<f64>()) / root;
            inverse[(c, k)] = value;
            trace += value * value;
        }
    }
    D as f64 / trace
}

/// A relative pose as the chordal objective sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Edge<const D: usize> {
    pub(crate) slots: [u32; 2],
    pub(crate) rotation: SMatrix<f64, D, D>,
    pub(crate) translation: SVector<f64, D>,
    pub(crate) kappa: f64,
    pub(crate) tau: f64,
}

impl<const D: usize> Default for Edge<D> {
    fn default() -> Self {
        Self {
            slots: [0; 2],
            rotation: SMatrix::identity(),
            translation: SVector::zeros(),
            kappa: 1.0,
            tau: 1.0,
        }
    }
}

fn edges<const N: usize, const D: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    edge: impl Fn(&G, &SMatrix<f64, N, N>) -> Edge<D>,
) -> Result<Vec<Edge<D>>, Error> {
    let mut edges = Vec::with_capacity(graph.factor_count());
    let table = KeyTable::new(graph);
    for (_, factor) in graph.factors() {
        if let Measurement::Between { from, to, measured } = &factor.measurement {
            let slots = [table.slot(*from)?, table.slot(*to)?];
            edges.push(Edge { slots, ..edge(measured, &factor.information) });
        }
    }
    Ok(edges)
}

/// First value of a pose and whether it stays.
struct Start<const D: usize> {
    rotation: SMatrix<f64, D, D>,
    translation: SVector<f64, D>,
    held: bool,
}

fn starts<const N: usize, const D: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    edges: &[Edge<D>],
    parts: impl Fn(&G) -> (SMatrix<f64, D, D>, SVector<f64, D>),
) -> Vec<Start<D>> {
    let mut group: Vec<u32> = (0..graph.poses.len() as u32).collect();
    for edge in edges {
        crate::graph::union(&mut group, edge.slots[0], edge.slots[1]);
    }
    let mut anchored = vec![false; group.len()];
    let mut starts: Vec<Start<D>> = Vec::with_capacity(group.len());
    for (slot, (pose, fixed)) in graph.poses.iter().zip(&graph.fixed).enumerate() {
        let (rotation, translation) = parts(pose);
        starts.push(Start { rotation, translation, held: *fixed });
        if *fixed {
            anchored[crate::graph::find(&mut group, slot as u32) as usize] = true;
        }
    }
    for (_, factor) in graph.factors() {
        let Measurement::Prior { key, measured } = &factor.measurement else { continue };
        let Ok(slot) = graph.slot(*key) else { continue };
        let root = crate::graph::find(&mut group, slot as u32) as usize;
        if !anchored[root] {
            anchored[root] = true;
            let (rotation, translation) = parts(measured);
            starts[slot] = Start { rotation, translation, held: true };
        }
    }
    for slot in graph.slots.values() {
        let root = crate::graph::find(&mut group, *slot) as usize;
        if !anchored[root] {
            anchored[root] = true;
            starts[*slot as usize].held = true;
        }
    }
    starts
}

type Relaxed<const D: usize> = Vec<(SMatrix<f64, D, D>, SVector<f64, D>)>;

fn relax<const N: usize, const D: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    edges: &[Edge<D>],
    start: &[Start<D>],
    project: impl Fn(&SMatrix<f64, D, D>) -> SMatrix<f64, D, D>,
) -> Result<Relaxed<D>, Error> {
    let (pattern, pairs) = Pattern::new(start.iter().map(|s| s.held), edges.iter().map(|edge| edge.slots));
    let mut poses: Relaxed<D> = start.iter().map(|s| (s.rotation, s.translation)).collect();
    if pattern.slots.is_empty() {
        return Ok(poses);
    }
    let system =
        System { edges, pattern: &pattern, pairs, symbolic: graph.elimination.symbolic(&pattern, N) };
    let failed = |c: usize| Error::Indefinite { key: graph.keys[pattern.slots[c] as usize] };
    for (slot, y) in pattern.slots.iter().zip(system.rotations(&poses).map_err(failed)?) {
        poses[*slot as usize].0 = project(&y.transpose());
    }
    for (slot, t) in pattern.slots.iter().zip(system.translations(&poses).map_err(failed)?) {
        poses[*slot as usize].1 = t;
    }
    Ok(poses)
}

/// The two linear problems of the relaxation.
struct System<'a, const D: usize> {
    edges: &'a [Edge<D>],
    pattern: &'a Pattern,
    /// Off-diagonal block of each edge, or [`HELD`].
    pairs: Vec<u32>,
    /// Serves both, though their blocks differ in size.
    symbolic: Arc<Symbolic>,
}

impl<const D: usize> System<'_, D> {
    /// Least squares on `Y_i = R_iᵀ`: minimises `Σ κ |Y_j - R_ijᵀ Y_i|²`.
    fn rotations(&self, poses: &Relaxed<D>) -> Result<Vec<SMatrix<f64, D, D>>, usize> {
        let Self { edges, pattern, pairs, symbolic } = self;
        let n = pattern.slots.len();
        let zero = SMatrix::<f64, D, D>::zeros();
        let mut hessian =
            BlockMatrix { diagonal: vec![zero; n], off_diagonal: vec![zero; pattern.pairs.len()] };
        let mut rhs = vec![zero; n];
        for (edge, pair) in edges.iter().zip(pairs) {
            let [i, j] = edge.slots;
            let (column_i, column_j) = (pattern.column(i), pattern.column(j));
            let weighted = edge.rotation * edge.kappa;
            for column in [column_i, column_j].into_iter().flatten() {
                hessian.diagonal[column] += SMatrix::identity() * edge.kappa;
            }
            match (column_i, column_j, pair) {
                (Some(ci), Some(cj), pair) => {
                    // the stored block has the larger column as its row
                    hessian.off_diagonal[*pair as usize] -=
                        if cj > ci { weighted.transpose() } else { weighted };
                }
                (Some(ci), None, _) => rhs[ci] += weighted * poses[j as usize].0.transpose(),
                (None, Some(cj), _) => {
                    rhs[cj] += weighted.transpose() * poses[i as usize].0.transpose();
                }
                _ => {}
            }
        }
        let mut cholesky = Cholesky::<D>::new(symbolic.clone(), &pattern.pairs);
        cholesky.factor(&hessian, None)?;
        let mut column = vec![SVector::<f64, D>::zeros(); n];
        // in the plane all blocks are multiples of rotations, so the second column is the first one turned
        for c in 0..if D == 2 { 1 } else { D } {
            for (x, block) in column.iter_mut().zip(&rhs) {
                *x = block.column(c).into_owned();
            }
            cholesky.solve(&mut column);
            for (x, block) in column.iter().zip(&mut rhs) {
                block.set_column(c, x);
            }
        }
        if D == 2 {
            for block in &mut rhs {
                (block[(0, 1)], block[(1, 1)]) = (-block[(1, 0)], block[(0, 0)]);
            }
        }
        Ok(rhs)
    }

    /// Least squares on translations with rotations given: minimises `Σ τ |t_j - t_i - R_i t_ij|²`.
    fn translations(&self, poses: &Relaxed<D>) -> Result<Vec<SVector<f64, D>>, usize> {
        let Self { edges, pattern, pairs, symbolic } = self;
        let n = pattern.slots.len();
        let zero = SMatrix::<f64, 1, 1>::zeros();
        let mut hessian =
            BlockMatrix { diagonal: vec![zero; n], off_diagonal: vec![zero; pattern.pairs.len()] };
        let mut rhs = vec![SVector::<f64, D>::zeros(); n];
        for (edge, pair) in edges.iter().zip(pairs) {
            let [i, j] = edge.slots;
            let (column_i, column_j) = (pattern.column(i), pattern.column(j));
            let (rotation_i, translation_i) = &poses[i as usize];
            let step = rotation_i * edge.translation;
            if let Some(ci) = column_i {
                hessian.diagonal[ci][0] += edge.tau;
                let other = if column_j.is_none() { poses[j as usize].1 } else { SVector::zeros() };
                rhs[ci] += (other - step) * edge.tau;
            }
            if let Some(cj) = column_j {
                hessian.diagonal[cj][0] += edge.tau;
                let other = if column_i.is_none() { *translation_i } else { SVector::zeros() };
                rhs[cj] += (other + step) * edge.tau;
            }
            if *pair != HELD {
                hessian.off_diagonal[*pair as usize][0] -= edge.tau;
            }
        }
        let mut cholesky = Cholesky::<1>::new(symbolic.clone(), &pattern.pairs);
        cholesky.factor(&hessian, None)?;
        cholesky.solve_together(&mut rhs);
        Ok(rhs)
    }
}

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::certify::{Dual, Parts};
use crate::chordal::{ChordalPose, Edge};
use crate::optimizer::Outcome;
use crate::pattern::Elimination;
use crate::{Certificate, Error, PoseGraph, Solution, Termination};

mod escape;
pub(crate) mod lifted;
mod newton;
mod round;
mod trust_region;

use lifted::{Lifted, Point};
use newton::Newton;
use round::round;
use trust_region::TrustRegion;

/// Parameters of [`staircase()`].
#[derive(Debug, Clone, PartialEq)]
pub struct StaircaseParams {
    /// Largest rank to climb to. Default 10; ranks past 5 are rarely needed.
    pub max_rank: usize,
    /// Trust-region steps at each rank. Default 300.
    pub max_iterations: usize,
    /// Steps of conjugate gradients within each of those. Default 1000.
    pub max_inner_iterations: usize,
    /// Stop a descent when a Newton step promises less than this fraction of the objective. Default 1e-15.
    pub relative_tolerance: f64,
    /// Stop climbing when the objective is proven to be within this fraction of the optimum. Default 1e-6; the
    /// smallest slack of [`crate::certify()`] always suffices.
    pub gap_tolerance: f64,
}

impl Default for StaircaseParams {
    fn default() -> Self {
        Self {
            max_rank: 10,
            max_iterations: 300,
            max_inner_iterations: 1000,
            relative_tolerance: 1e-15,
            gap_tolerance: 1e-6,
        }
    }
}

/// What [`staircase()`] found.
#[derive(Debug, Clone)]
pub struct StaircaseSolution<G> {
    /// The poses; costs are half the chordal objective, as that of [`crate::chordal_objective`].
    pub solution: Solution<G>,
    /// The certificate of these poses.
    pub certificate: Certificate,
    /// What no poses can go below: the objective at the rank that was certified, less its gap. `None` when none was.
    pub lower_bound: Option<f64>,
    /// The rank at which the staircase ended; the dimension of space when it did not have to climb.
    pub rank: usize,
}

/// Minimises the chordal objective from the present poses to a **global** minimum: descends, asks for a
/// certificate, and while that is withheld climbs into one more dimension along a direction of negative curvature,
/// where a valley becomes a saddle. In the end the lifted solution is rounded to poses and descended from again.
///
/// Fixed poses, priors, kernels and user-defined factors are not looked at. The objective does not depend on where
/// the map lies; each connected part is moved so that its smallest key stays.
///
/// Only noise beyond what the relaxation stands (then [`StaircaseSolution::certificate`] has no slack, but
/// [`StaircaseSolution::lower_bound`] tells how far the result can be from the optimum) or
/// [`StaircaseParams::max_rank`] keep it from the global optimum.
///
/// **Source**: Boumal, *A Riemannian low-rank method for optimization over semidefinite matrices with
/// block-diagonal constraints*, 2015, algorithm 1; Rosen, Carlone, Bandeira, Leonard, *SE-Sync*, 2019. We keep the
/// translations as variables, find the direction by inverse iteration, and descend by Newton's method where the rank is
/// the dimension of space, by conjugate gradients in a trust region above.
///
/// # Errors
/// [`Error::EmptyGraph`], [`Error::Parameter`]; [`Error::Indefinite`] when rounding defeats the factorisation.
pub fn staircase<const N: usize, G: ChordalPose<N>>(
    graph: &PoseGraph<G, N>,
    params: &StaircaseParams,
) -> Result<StaircaseSolution<G>, Error> {
    if graph.pose_count() == 0 {
        return Err(Error::EmptyGraph);
    }
    for (name, value) in
        [("relative_tolerance", params.relative_tolerance), ("gap_tolerance", params.gap_tolerance)]
    {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::Parameter { name, value });
        }
    }
    G::staircase(graph, params)
}

/// Limits of one descent.
#[derive(Debug, Clone, Copy)]
struct Limits {
    iterations: usize,
    inner_iterations: usize,
    /// Stop when the gain that a Newton step promises is below this fraction of the objective.
    relative_tolerance: f64,
}

/// Where a descent ended.
struct Descent {
    point: Point,
    cost: f64,
    iterations: usize,
    converged: bool,
}

/// Gains below this fraction of the objective drown in rounding and count as predicted.
const ROUNDING: f64 = 1e-13;
/// Objectives below this are zero but for rounding.
const NOTHING: f64 = 1e-20;

/// The staircase for poses given as rotations and translations.
pub(crate) struct Climb<const D: usize> {
    pub(crate) poses: Vec<Parts<D>>,
    certificate: Certificate,
    lower_bound: Option<f64>,
    rank: usize,
    outcome: Outcome,
}

impl<const D: usize> Climb<D> {
    pub(crate) fn into_solution<const N: usize, G: LieGroup<N>>(
        self,
        graph: &PoseGraph<G, N>,
        edges: &[Edge<D>],
        poses: Vec<G>,
    ) -> StaircaseSolution<G> {
        let poses = back_to_start(graph, edges, poses);
        StaircaseSolution {
            solution: Solution::new(graph, &poses, Vec::new(), self.outcome),
            certificate: self.certificate,
            lower_bound: self.lower_bound,
            rank: self.rank,
        }
    }
}

/// Moves each connected part so that its smallest key lies where it lay.
fn back_to_start<const N: usize, const D: usize, G: LieGroup<N>>(
    graph: &PoseGraph<G, N>,
    edges: &[Edge<D>],
    mut poses: Vec<G>,
) -> Vec<G> {
    let mut group: Vec<u32> = (0..poses.len() as u32).collect();
    for edge in edges {
        crate::graph::union(&mut group, edge.slots[0], edge.slots[1]);
    }
    let mut moves: Vec<Option<G>> = vec![None; poses.len()];
    for slot in graph.slots.values() {
        let root = crate::graph::find(&mut group, *slot) as usize;
        let (was, is) = (&graph.poses[*slot as usize], poses[*slot as usize]);
        let by = *moves[root].get_or_insert_with(|| was.compose(&is.inverse()));
        poses[*slot as usize] = by.compose(&is).renormalize();
    }
    poses
}

/// # Errors
/// The slot at which the preconditioner could not be factored.
pub(crate) fn climb<const D: usize, const M: usize, const N: usize>(
    edges: &[Edge<D>],
    start: &[Parts<D>],
    params: &StaircaseParams,
    elimination: &Elimination,
) -> Result<Climb<D>, usize> {
    let problem = Lifted::<D, M> { edges, nodes: start.len() };
    let mut dual = Dual::<D, M>::new(edges, start.len(), elimination);
    let limits = Limits {
        iterations: params.max_iterations,
        inner_iterations: params.max_inner_iterations,
        relative_tolerance: params.relative_tolerance,
    };
    let first = Lifted::<D, M>::point(start);
    let initial = problem.cost(&first);
    let mut newton = Newton::<N>::new(&dual);
    let mut descent = newton.descend(&problem, &dual, first, limits);
    let mut preconditioner = None;
    let (mut iterations, mut rank) = (descent.iterations, D);
    let mut lower_bound = None;
    loop {
        let matrix = certificate_matrix(&problem, &dual, &descent.point);
        if let Some(slack) = dual.slack(&matrix, params.gap_tolerance * descent.cost) {
            lower_bound = Some(descent.cost - dual.gap(slack));
            break;
        }
        if rank >= params.max_rank {
            break;
        }
        let Some(direction) = escape::descent_direction(&mut dual, &matrix) else { break };
        let Some(point) = escape::escape(&problem, &descent.point, &direction) else { break };
        tracing::debug!(rank, cost = descent.cost, "not certified, climbing");
        rank += 1;
        if preconditioner.is_none() {
            preconditioner = Some(dual.preconditioner()?);
        }
        let Some(preconditioner) = &preconditioner else { break };
        descent = TrustRegion { problem: &problem, preconditioner, limits }.descend(point);
        iterations += descent.iterations;
    }
    if rank > D {
        descent = newton.descend(&problem, &dual, round::<D, M>(&descent.point), limits);
        iterations += descent.iterations;
    }
    let poses = parts::<D, M>(&descent.point);
    let certificate = crate::certify::certify_parts_with(&mut dual, edges, &poses);
    let termination = if descent.converged { Termination::Converged } else { Termination::MaxIterations };
    let outcome =
        Outcome { cost: 0.5 * descent.cost, iterations, termination, ..Outcome::at_start(0.5 * initial) };
    Ok(Climb { poses, certificate, lower_bound, rank, outcome })
}

fn certificate_matrix<const D: usize, const M: usize>(
    problem: &Lifted<D, M>,
    dual: &Dual<D, M>,
    point: &Point,
) -> crate::sparse::BlockMatrix<M> {
    let mut product = vec![0.0; point.x.len()];
    problem.times(&point.x, point.rank, &mut product);
    dual.certificate_matrix(&problem.multipliers(point, &product))
}

fn parts<const D: usize, const M: usize>(point: &Point) -> Vec<Parts<D>> {
    let nodes = point.x.chunks_exact(M * D);
    nodes
        .map(|x| (SMatrix::from_column_slice(&x[..D * D]), SVector::from_column_slice(&x[D * D..])))
        .collect()
}

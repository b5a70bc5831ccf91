use std::marker::PhantomData;

use nalgebra::{SMatrix, SVector};
use pulp::{Arch, NullaryFnOnce};

use super::anderson::Anderson;
use super::association::{Association, Pair};
use super::covariance;
use super::normal_equations::{NormalEquations, Term, term};
use super::outcome::{Registration, ResidualStatistics, Termination};
use super::rejector::{Rejector, trim_limit_sq};
use super::target::{Target, centre};
use super::{Acceleration, IcpParams, Matcher, Optimizer, Residual};
use crate::Error;
use crate::cloud::Cloud;
use crate::kd_tree::KdTree;
use crate::linalg::pseudo_solve;
use crate::motion::RigidMotion;
use crate::rigid_fit::rigid_fit;

/// Information along a direction below this share of the largest is rounding and not followed.
const RANK_TOLERANCE: f64 = 1e-11;

/// A pose between the centred clouds: `x = rotation · p + translation`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pose<const D: usize> {
    pub(crate) rotation: SMatrix<f64, D, D>,
    pub(crate) translation: SVector<f64, D>,
}

/// One alignment with all its buffers.
pub(crate) struct Problem<'a, const D: usize> {
    pub(crate) target: &'a Target<D>,
    pub(crate) params: &'a IcpParams,
    /// Source points about their mean.
    pub(crate) points: Vec<SVector<f64, D>>,
    pub(crate) normals: Option<&'a [SVector<f64, D>]>,
    covariances: Option<&'a [SMatrix<f64, D, D>]>,
    /// Mean of the source points.
    pub(crate) centre: SVector<f64, D>,
    /// Root mean square distance of the source points from their mean: turns radians into metres.
    pub(crate) radius: f64,
    association: Association<D>,
    source_tree: Option<KdTree<D>>,
    pub(crate) matched: Vec<Pair>,
    pub(crate) kept: Vec<Pair>,
    buffer: Vec<f64>,
}

pub(crate) fn align<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    target: &Target<D>,
    source: &Cloud<D>,
    initial: &G,
    params: &IcpParams,
) -> Result<Registration<G, N>, Error> {
    params.check()?;
    let mut problem = Problem::new(target, source, params)?;
    if !initial.to_row_major().iter().all(|v| v.is_finite()) {
        return Err(Error::NonFinite { what: "the initial pose" });
    }
    let mut pose = problem.to_centred(initial);
    let mut accelerator = match params.acceleration {
        Acceleration::None => None,
        Acceleration::Anderson => Some(Accelerator::new(&pose)),
    };
    let mut steps: Vec<(f64, f64)> = Vec::new();
    let mut damping = 1e-6;
    let mut termination = Termination::MaxIterations;
    while steps.len() < params.stop.max_iterations {
        problem.associate(&pose);
        if problem.kept.len() < D {
            termination = Termination::TooFewPairs;
            break;
        }
        if let Some(accelerator) = &mut accelerator {
            accelerator.fit = problem.fit();
            if let Some(plain) = accelerator.take_back() {
                pose = plain;
                problem.associate(&pose);
                accelerator.fit = problem.fit();
            }
        }
        let (next, step) = problem.step::<N, G>(&pose, &mut damping);
        pose = match &mut accelerator {
            None => next,
            Some(accelerator) => accelerator.further::<G>(&problem, &pose, &next),
        };
        let rotation = (0..N - D).map(|i| step[D + i] * step[D + i]).sum::<f64>().sqrt();
        steps.push((step.fixed_rows::<D>(0).norm(), rotation));
        if steps.len() >= params.stop.window {
            let last = &steps[steps.len() - params.stop.window..];
            let mean = |f: fn(&(f64, f64)) -> f64| last.iter().map(f).sum::<f64>() / last.len() as f64;
            if mean(|s| s.0) < params.stop.translation && mean(|s| s.1) < params.stop.rotation {
                pose = next;
                termination = Termination::Converged;
                break;
            }
        }
    }
    problem.associate(&pose);
    Ok(problem.finish(&pose, steps.len(), termination))
}

/// Steps that look ahead, and the way back where that made the fit worse.
struct Accelerator<const D: usize, const N: usize> {
    anderson: Anderson<N>,
    /// Poses are told by their motion from here.
    start: Pose<D>,
    /// Where the last step would have led by itself, if it went elsewhere, and the fit before it.
    plain: Option<(Pose<D>, f64)>,
    /// The fit where the problem is now.
    fit: f64,
}

impl<const D: usize, const N: usize> Accelerator<D, N> {
    fn new(start: &Pose<D>) -> Self {
        Self { anderson: Anderson::default(), start: *start, plain: None, fit: f64::INFINITY }
    }

    /// The pose to return to when the fit got worse by the last step.
    fn take_back(&mut self) -> Option<Pose<D>> {
        let (pose, before) = self.plain.take()?;
        if self.fit <= before {
            return None;
        }
        self.anderson.forget();
        Some(pose)
    }

    /// From the pose a step led to, on to where the steps so far seem to lead.
    fn further<G: RigidMotion<D, N>>(
        &mut self,
        problem: &Problem<'_, D>,
        from: &Pose<D>,
        to: &Pose<D>,
    ) -> Pose<D> {
        let scale = problem.scale::<N>();
        let place = |pose: &Pose<D>| {
            let turn =
                G::from_matrix(&(pose.rotation * self.start.rotation.transpose()), &SVector::zeros()).log();
            let shift = pose.translation - self.start.translation;
            SVector::<f64, N>::from_fn(|i, _| if i < D { shift[i] } else { turn[i] * scale[i] })
        };
        let x = place(from);
        let extra = self.anderson.extra(&x, &(place(to) - x));
        if extra == SVector::<f64, N>::zeros() {
            return *to;
        }
        self.plain = Some((*to, self.fit));
        moved::<D, N, G>(to, &extra.component_div(&scale))
    }
}

impl<'a, const D: usize> Problem<'a, D> {
    fn new(target: &'a Target<D>, source: &'a Cloud<D>, params: &'a IcpParams) -> Result<Self, Error> {
        if source.is_empty() {
            return Err(Error::TooFewPoints { what: "the source", found: 0, needed: 1 });
        }
        let angle = params.rejectors.iter().any(|r| matches!(r, Rejector::NormalAngle { .. }));
        let both = angle || matches!(params.residual, Residual::Symmetric | Residual::PlaneToPlane);
        if (both || params.residual == Residual::PointToPlane) && target.normals.is_none() {
            return Err(Error::MissingNormals { what: "target" });
        }
        if both && source.normals().is_none() {
            return Err(Error::MissingNormals { what: "source" });
        }
        let unweighted = target.covariances.is_none() && source.covariances().is_none();
        if params.residual == Residual::Mahalanobis && unweighted {
            return Err(Error::MissingCovariances);
        }
        let (centre, points) = centre(source.points());
        let mean_sq = points.iter().map(|p| p.norm_squared()).sum::<f64>() / points.len() as f64;
        let source_tree = match params.matcher {
            Matcher::Nearest => None,
            Matcher::Reciprocal => Some(KdTree::new(&points)?),
        };
        Ok(Self {
            target,
            params,
            association: Association::new(&points, params.max_distance),
            radius: if mean_sq > 0.0 { mean_sq.sqrt() } else { 1.0 },
            points,
            normals: if both { source.normals() } else { None },
            covariances: source.covariances(),
            centre,
            source_tree,
            matched: Vec::new(),
            kept: Vec::new(),
            buffer: Vec::new(),
        })
    }

    pub(crate) fn to_centred<const N: usize, G: RigidMotion<D, N>>(&self, pose: &G) -> Pose<D> {
        let rotation = pose.rotation_matrix();
        let translation = rotation * self.centre + pose.translation_vector() - self.target.origin;
        Pose { rotation, translation }
    }

    fn to_pose<const N: usize, G: RigidMotion<D, N>>(&self, pose: &Pose<D>) -> G {
        let translation = pose.translation - pose.rotation * self.centre + self.target.origin;
        G::from_matrix(&pose.rotation, &translation).renormalize()
    }

    /// The pair of one source point at another pose, found afresh from the partner it had.
    pub(crate) fn nearest_pair(&self, pair: &Pair, pose: &Pose<D>) -> Option<Pair> {
        let x = pose.rotation * self.points[pair.source as usize] + pose.translation;
        let (target, distance_sq) = self.target.tree.nearest_from(&x, pair.target);
        let reach_sq = self.params.max_distance * self.params.max_distance;
        (distance_sq <= reach_sq).then_some(Pair { source: pair.source, target, distance_sq })
    }

    /// Fills `matched` and `kept`.
    pub(crate) fn associate(&mut self, pose: &Pose<D>) {
        let (r, t) = (&pose.rotation, &pose.translation);
        self.association.update(&self.target.tree, r, t, &mut self.matched);
        if let Some(source_tree) = &self.source_tree {
            let tree = &self.target.tree;
            self.matched.retain(|pair| {
                let back = r.transpose() * (tree.point_at(pair.target as usize) - t);
                source_tree.nearest(&back).is_some_and(|n| {
                    n.index == pair.source as usize
                        || self.points[n.index] == self.points[pair.source as usize]
                })
            });
        }
        let (mut kept, mut buffer) = (std::mem::take(&mut self.kept), std::mem::take(&mut self.buffer));
        self.reject(pose, &self.matched, &mut kept, &mut buffer);
        (self.kept, self.buffer) = (kept, buffer);
    }

    /// Fills `kept` with the pairs that pass every rejector.
    pub(crate) fn reject(
        &self,
        pose: &Pose<D>,
        matched: &[Pair],
        kept: &mut Vec<Pair>,
        buffer: &mut Vec<f64>,
    ) {
        let limit_sq = trim_limit_sq(&self.params.rejectors, matched, buffer);
        let min_cosine = self.params.rejectors.iter().fold(-1.0f64, |least, rejector| match rejector {
            Rejector::NormalAngle { max_angle } => least.max(max_angle.min(std::f64::consts::PI).cos()),
            _ => least,
        });
        kept.clear();
        kept.extend(matched.iter().filter(|p| p.distance_sq <= limit_sq));
        if min_cosine > -1.0
            && let (Some(n), Some(m)) = (self.target.normals.as_deref(), self.normals)
        {
            let turned = |p: &Pair| pose.rotation * m[p.source as usize];
            kept.retain(|p| n[p.target as usize].dot(&turned(p)) >= min_cosine);
        }
    }

    /// Mean squared distance of the pairs that count, points without a partner counting as far as one may be.
    fn fit(&self) -> f64 {
        let sum: f64 = self.kept.iter().map(|p| p.distance_sq).sum();
        let lost = 1.0 - self.matched.len() as f64 / self.points.len() as f64;
        sum / self.kept.len().max(1) as f64 + lost * self.params.max_distance.powi(2)
    }

    /// The term of one pair at a pose.
    #[inline(always)]
    pub(crate) fn term<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pair: &Pair,
        pose: &Pose<D>,
    ) -> Term<D, N> {
        let lever = pose.rotation * self.points[pair.source as usize];
        let e = self.target.tree.point_at(pair.target as usize) - (lever + pose.translation);
        let n = match &self.target.normals {
            Some(normals) => normals[pair.target as usize],
            None => SVector::zeros(),
        };
        let m = match self.normals {
            Some(normals) => pose.rotation * normals[pair.source as usize],
            None => SVector::zeros(),
        };
        let metric = || self.metric(pair, pose);
        term::<D, N, G>(self.params.residual, &lever, &e, &n, &m, metric)
    }

    /// `(C_q + R C_x Rᵀ)⁻¹` of a pair; zero, so that the pair does not count, where rounding leaves nothing to invert.
    fn metric(&self, pair: &Pair, pose: &Pose<D>) -> SMatrix<f64, D, D> {
        let mut sum = SMatrix::<f64, D, D>::zeros();
        if let Some(of_target) = &self.target.covariances {
            sum += of_target[pair.target as usize];
        }
        if let Some(of_source) = self.covariances {
            sum += pose.rotation * of_source[pair.source as usize] * pose.rotation.transpose();
        }
        sum.try_inverse().map_or_else(SMatrix::zeros, |inverse| (inverse + inverse.transpose()) * 0.5)
    }

    /// The normal equations at a pose; each pair's term and weight are shown to `see`.
    pub(crate) fn normal_equations_seen<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pose: &Pose<D>,
        see: impl FnMut(&Pair, &Term<D, N>, f64),
    ) -> NormalEquations<N> {
        Arch::new().dispatch(Summation { problem: self, pose, see, group: PhantomData::<G> })
    }

    pub(crate) fn normal_equations<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pose: &Pose<D>,
    ) -> NormalEquations<N> {
        self.normal_equations_seen::<N, G>(pose, |_, _, _| ())
    }

    fn step<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pose: &Pose<D>,
        damping: &mut f64,
    ) -> (Pose<D>, SVector<f64, N>) {
        match self.params.optimizer {
            Optimizer::ClosedForm => self.closed_form::<N, G>(pose),
            Optimizer::GaussNewton => {
                let sum = self.normal_equations::<N, G>(pose);
                let step = self.solve::<N>(&sum, 0.0);
                (moved::<D, N, G>(pose, &step), step)
            }
            Optimizer::LevenbergMarquardt => self.levenberg_marquardt::<N, G>(pose, damping),
        }
    }

    /// Solves in metres (rotations times the radius), so that eigenvalues compare.
    pub(crate) fn solve<const N: usize>(&self, sum: &NormalEquations<N>, damping: f64) -> SVector<f64, N> {
        let scale = self.scale::<N>();
        let mut h = SMatrix::<f64, N, N>::from_fn(|i, j| sum.h[(i, j)] / (scale[i] * scale[j]));
        let g = sum.g.component_div(&scale);
        let mean = h.trace() / N as f64;
        (0..N).for_each(|i| h[(i, i)] += damping * mean);
        pseudo_solve(&h, &g, RANK_TOLERANCE).component_div(&scale)
    }

    /// `[1.., radius..]`.
    pub(crate) fn scale<const N: usize>(&self) -> SVector<f64, N> {
        SVector::from_fn(|i, _| if i < D { 1.0 } else { self.radius })
    }

    fn levenberg_marquardt<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pose: &Pose<D>,
        damping: &mut f64,
    ) -> (Pose<D>, SVector<f64, N>) {
        let sum = self.normal_equations::<N, G>(pose);
        // the weights are frozen, so the cost that must fall is the weighted square sum
        let weights: Vec<f64> = self
            .kept
            .iter()
            .map(|pair| self.params.kernel.weight(self.term::<N, G>(pair, pose).cost()))
            .collect();
        for _ in 0..10 {
            let step = self.solve::<N>(&sum, *damping);
            let next = moved::<D, N, G>(pose, &step);
            let cost: f64 =
                self.kept.iter().zip(&weights).map(|(p, w)| w * self.term::<N, G>(p, &next).cost()).sum();
            if cost <= sum.cost {
                *damping = (*damping * 0.1).max(1e-12);
                return (next, step);
            }
            *damping *= 10.0;
        }
        (*pose, SVector::zeros())
    }

    fn closed_form<const N: usize, G: RigidMotion<D, N>>(
        &self,
        pose: &Pose<D>,
    ) -> (Pose<D>, SVector<f64, N>) {
        let pairs = self.kept.iter().map(|pair| {
            let (p, q) = (self.points[pair.source as usize], self.target.tree.point_at(pair.target as usize));
            (p, *q, self.params.kernel.weight(pair.distance_sq))
        });
        let Some((rotation, translation)) = rigid_fit::<D, N, G>(pairs) else {
            return (*pose, SVector::zeros());
        };
        let turn = G::from_matrix(&(rotation * pose.rotation.transpose()), &SVector::zeros()).log();
        let shift = translation - pose.translation;
        let step = SVector::from_fn(|i, _| if i < D { shift[i] } else { turn[i] });
        (Pose { rotation, translation }, step)
    }

    fn finish<const N: usize, G: RigidMotion<D, N>>(
        &mut self,
        pose: &Pose<D>,
        iterations: usize,
        termination: Termination,
    ) -> Registration<G, N> {
        let uncertainty = covariance::estimate::<D, N, G>(self, pose);
        let overlap_sq = self.params.overlap_radius * self.params.overlap_radius;
        let overlapping = if self.params.overlap_radius <= self.params.max_distance {
            self.matched.iter().filter(|p| p.distance_sq <= overlap_sq).count()
        } else {
            let near = |p: &SVector<f64, D>| {
                let x = pose.rotation * p + pose.translation;
                self.target.tree.nearest_within(&x, self.params.overlap_radius).is_some()
            };
            self.points.iter().filter(|p| near(p)).count()
        };
        let square_sum: f64 = self.kept.iter().map(|p| p.distance_sq).sum();
        Registration {
            target_from_source: self.to_pose(pose),
            covariance: uncertainty.covariance,
            information: uncertainty.information,
            degenerate_directions: uncertainty.degenerate_directions,
            overlap: overlapping as f64 / self.points.len() as f64,
            residuals: ResidualStatistics {
                matched: self.matched.len(),
                inliers: self.kept.len(),
                rms: (square_sum / self.kept.len().max(1) as f64).sqrt(),
                sigma: uncertainty.sigma,
            },
            iterations,
            termination,
        }
    }
}

/// The sum over the pairs, as one piece of work that is compiled for the processor's vectors.
struct Summation<'a, F, G, const D: usize, const N: usize> {
    problem: &'a Problem<'a, D>,
    pose: &'a Pose<D>,
    see: F,
    group: PhantomData<G>,
}

impl<F, G, const D: usize, const N: usize> NullaryFnOnce for Summation<'_, F, G, D, N>
where
    G: RigidMotion<D, N>,
    F: FnMut(&Pair, &Term<D, N>, f64),
{
    type Output = NormalEquations<N>;

    #[inline(always)]
    fn call(mut self) -> NormalEquations<N> {
        let mut sum = NormalEquations::zero();
        for pair in &self.problem.kept {
            let term = self.problem.term::<N, G>(pair, self.pose);
            let weight = self.problem.params.kernel.weight(term.cost());
            sum.add::<D, G>(&term, weight);
            (self.see)(pair, &term, weight);
        }
        sum.finish();
        sum
    }
}

/// The pose after a small motion about the source's centre, axes of the target.
pub(crate) fn moved<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    pose: &Pose<D>,
    step: &SVector<f64, N>,
) -> Pose<D> {
    let turn_only = SVector::from_fn(|i, _| if i < D { 0.0 } else { step[i] });
    let turned = G::exp(&turn_only).rotation_matrix() * pose.rotation;
    // through the group type once, so that products of many steps stay orthonormal
    let rotation = G::from_matrix(&turned, &SVector::zeros()).renormalize().rotation_matrix();
    Pose { rotation, translation: pose.translation + step.fixed_rows::<D>(0) }
}

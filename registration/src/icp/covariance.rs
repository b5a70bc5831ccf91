use nalgebra::{SMatrix, SVector};

use super::Covariance;
use super::align::{Pose, Problem, moved};
use super::params::Residual;
use crate::DEGENERATE_SIGMA;
use crate::linalg::symmetric_eigen;
use crate::motion::RigidMotion;

/// The probe step of the curvature in units of the root mean square distance of the pairs: far enough for the
/// points to change partners.
const PROBE: f64 = 3.0;

/// A direction is degenerate when its standard deviation exceeds this share of the probe step: moving that far
/// then changes the score by less than three of its own deviations, so the scans do not show the motion.
const DEGENERATE_SHARE: f64 = 1.0 / 3.0;

/// Largest ratio of the noise to the residuals that is believed; beyond it the local fits are not noise.
const MOST_SELECTION: f64 = 4.0;

/// Source points that try each motion at most, evenly drawn; the rest would change the curvature by little.
const MOST_PROBES: usize = 500;

pub(crate) struct Uncertainty<const N: usize> {
    pub(crate) covariance: SMatrix<f64, N, N>,
    pub(crate) information: SMatrix<f64, N, N>,
    pub(crate) degenerate_directions: Vec<SVector<f64, N>>,
    pub(crate) sigma: f64,
}

/// What the residuals say at the answer, in metres (rotations times the radius of the source).
struct Evidence<const N: usize> {
    /// `Σ w Jᵀ M J`.
    h: SMatrix<f64, N, N>,
    /// Variance of the score `Σ w Jᵀ M e`.
    score_variance: SMatrix<f64, N, N>,
    sigma: f64,
    rms: f64,
}

pub(crate) fn estimate<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> Uncertainty<N> {
    let evidence = evidence::<D, N, G>(problem, pose);
    let to_body = body_from_scaled::<D, N, G>(problem, pose);
    let enough = problem.kept.len() * coordinates::<D>(problem.params.residual) > N;
    let mut answer = if !enough {
        unknown(&to_body, evidence.sigma)
    } else {
        let probe = (PROBE * evidence.rms).min(0.5 * problem.params.max_distance).max(1e-6 * problem.radius);
        let curvature = match problem.params.covariance {
            Covariance::Residual | Covariance::Spacing { .. } => evidence.h,
            Covariance::Sandwich => curvature::<D, N, G>(problem, pose, probe),
        };
        combine(&evidence, &curvature, probe, problem, &to_body)
    };
    if let Covariance::Spacing { scale, radius } = problem.params.covariance {
        answer.covariance = SMatrix::identity() * (scale * mean_square_within(problem, radius));
    }
    answer
}

fn coordinates<const D: usize>(residual: Residual) -> usize {
    match residual {
        Residual::PointToPoint | Residual::PlaneToPlane | Residual::Mahalanobis => D,
        Residual::PointToPlane | Residual::Symmetric => 1,
    }
}

fn unknown<const N: usize>(to_body: &SMatrix<f64, N, N>, sigma: f64) -> Uncertainty<N> {
    Uncertainty {
        covariance: to_body * to_body.transpose() * (DEGENERATE_SIGMA * DEGENERATE_SIGMA),
        information: SMatrix::zeros(),
        degenerate_directions: (0..N).map(|k| to_body.column(k).normalize()).collect(),
        sigma,
    }
}

fn evidence<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> Evidence<N> {
    let sum = problem.normal_equations::<N, G>(pose);
    let scale = problem.scale::<N>();
    let mut scores: Vec<(u32, SVector<f64, N>)> = problem
        .kept
        .iter()
        .map(|pair| (pair.target, score::<D, N, G>(problem, pose, pair).component_div(&scale)))
        .collect();
    // a target point's own error is common to all source points that chose it: they count as one draw
    scores.sort_by_key(|(target, _)| *target);
    let (mut variance, mut clusters) = (SMatrix::zeros(), 0.0);
    for cluster in scores.chunk_by(|a, b| a.0 == b.0) {
        let total: SVector<f64, N> = cluster.iter().map(|(_, s)| s).sum();
        variance += total * total.transpose();
        clusters += 1.0;
    }
    let freedom = (sum.weight * coordinates::<D>(problem.params.residual) as f64 - N as f64).max(1.0);
    let squares: f64 = problem.kept.iter().map(|p| p.distance_sq).sum();
    Evidence {
        h: SMatrix::from_fn(|i, j| sum.h[(i, j)] / (scale[i] * scale[j])),
        score_variance: variance
            * (clusters / (clusters - N as f64).max(1.0))
            * selection::<D, N, G>(problem, pose),
        sigma: (sum.cost / freedom).sqrt(),
        rms: (squares / problem.kept.len().max(1) as f64).sqrt(),
    }
}

/// By how much the score varies more than the residuals show, at least 1.
///
/// Of several points about as near, the nearest is also the one whose error matches best, so residuals are
/// smaller than two independent errors make them wherever points lie closer than the noise. The noise itself is
/// known from how the neighbours of each point scatter about their line or plane. Residuals as seen give too small a
/// variance; independent errors give too large a one, since choosing among neighbours also averages over them. The
/// answer lies midway: in simulated rooms, where points lie apart, the two differ by a third; on piles drowned in
/// noise, by a factor of four.
fn selection<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> f64 {
    // medians of chi-square over its degrees of freedom: 1 for a residual, about 12 for two local fits
    const RESIDUAL_MEDIAN: f64 = 0.455;
    const NOISE_MEDIAN: f64 = 0.945;
    let (Some(of_source), Some(of_target)) = (problem.variances, &problem.target.variances) else {
        return 1.0;
    };
    let along = matches!(problem.params.residual, Residual::PointToPoint | Residual::Mahalanobis);
    if along || problem.kept.is_empty() {
        return 1.0;
    }
    let noise = |p: &super::association::Pair| of_source[p.source as usize] + of_target[p.target as usize];
    let expected = median(problem.kept.iter().map(noise)) / NOISE_MEDIAN;
    let seen = median(problem.kept.iter().map(|p| problem.term::<N, G>(p, pose).cost())) / RESIDUAL_MEDIAN;
    let ratio = if seen > 0.0 { (expected / seen).clamp(1.0, MOST_SELECTION) } else { 1.0 };
    0.5 * (1.0 + ratio)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn score<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    pair: &super::association::Pair,
) -> SVector<f64, N> {
    let term = problem.term::<N, G>(pair, pose);
    term.score::<G>() * problem.params.kernel.weight(term.cost())
}

/// How the score falls with a motion, by central differences over `probe` metres with the points free to change
/// partners.
///
/// The usual `JᵀJ` holds the pairs fixed, so a wall seems to pin a scan that slides along it as soon as the
/// residual or noise in the normals has a part along the wall; here the motion itself is tried. Points keep the
/// weight they have at the answer, since the probe is longer than a kernel's scale; the kernel's slope there
/// enters by its mean.
fn curvature<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    probe: f64,
) -> SMatrix<f64, N, N> {
    let scale = problem.scale::<N>();
    let kernel = problem.params.kernel;
    let (mut total, mut slope) = (0.0, 0.0);
    let mut weighted = Vec::with_capacity(problem.kept.len());
    for pair in &problem.kept {
        let cost = problem.term::<N, G>(pair, pose).cost();
        let weight = kernel.weight(cost);
        weighted.push((*pair, weight));
        total += weight;
        slope += kernel.slope(cost, coordinates::<D>(problem.params.residual));
    }
    let shrink = if total > 0.0 { (slope / total).clamp(0.1, 1.0) } else { 1.0 };
    let stride = weighted.len().div_ceil(MOST_PROBES).max(1);
    let mut curvature = SMatrix::<f64, N, N>::zeros();
    for k in 0..N {
        let mut column = SVector::<f64, N>::zeros();
        for sign in [-1.0, 1.0] {
            let mut step = SVector::<f64, N>::zeros();
            step[k] = sign * probe / scale[k];
            let there = moved::<D, N, G>(pose, &step);
            let mut score = SVector::<f64, N>::zeros();
            for (pair, weight) in weighted.iter().step_by(stride).filter(|(_, w)| *w > 0.0) {
                let Some(pair) = problem.nearest_pair(pair, &there) else { continue };
                score += problem.term::<N, G>(&pair, &there).score::<G>() * *weight;
            }
            column -= score.component_div(&scale) * sign;
        }
        curvature.set_column(k, &(column / (2.0 * probe)));
    }
    let drawn: f64 = weighted.iter().step_by(stride).map(|(_, weight)| weight).sum();
    let share = if drawn > 0.0 { total / drawn } else { 0.0 };
    (curvature + curvature.transpose()) * (0.5 * shrink * share)
}

/// `K⁻¹ A K⁻¹` with curvature `K` and score variance `A`, without the directions it cannot speak of.
fn combine<const D: usize, const N: usize>(
    evidence: &Evidence<N>,
    curvature: &SMatrix<f64, N, N>,
    probe: f64,
    problem: &Problem<'_, D>,
    to_body: &SMatrix<f64, N, N>,
) -> Uncertainty<N> {
    let (values, vectors) = symmetric_eigen(curvature);
    // exact data has no residual; a floor keeps the information finite
    let floor = (1e-9 * problem.radius).powi(2);
    let variance = match problem.params.covariance {
        Covariance::Sandwich => evidence.score_variance + evidence.h * floor,
        _ => evidence.h * evidence.sigma.powi(2).max(floor),
    };
    let limit = DEGENERATE_SHARE * probe;
    let mut inverse = SMatrix::<f64, N, N>::zeros();
    let mut covariance = SMatrix::<f64, N, N>::zeros();
    let mut degenerate_directions = Vec::new();
    for k in 0..N {
        let v = vectors.column(k).into_owned();
        let deviation = (v.transpose() * variance * v)[0].max(0.0).sqrt();
        let fixed = values[k] > 1e-9 * values[N - 1] && deviation < limit * values[k];
        if fixed && values[N - 1] > 0.0 {
            inverse += v * v.transpose() / values[k];
        } else {
            let direction = to_body * v;
            covariance += direction * direction.transpose() * (DEGENERATE_SIGMA * DEGENERATE_SIGMA);
            degenerate_directions.push(direction.normalize());
        }
    }
    let scaled = inverse * variance * inverse;
    let mut information = SMatrix::<f64, N, N>::zeros();
    if let Some(from_body) = to_body.try_inverse() {
        let (spread, axes) = symmetric_eigen(&scaled);
        for k in degenerate_directions.len()..N {
            let gradient = from_body.transpose() * axes.column(k);
            information += gradient * gradient.transpose() / spread[k].max(f64::MIN_POSITIVE);
        }
    }
    covariance += to_body * scaled * to_body.transpose();
    Uncertainty { covariance, information, degenerate_directions, sigma: evidence.sigma }
}

/// Mean squared distance of the pairs within `radius`, as the reference system's fitness.
fn mean_square_within<const D: usize>(problem: &Problem<'_, D>, radius: f64) -> f64 {
    let near = problem.matched.iter().map(|p| p.distance_sq).filter(|d| *d <= radius * radius);
    let (count, sum) = near.fold((0usize, 0.0), |(n, s), d| (n + 1, s + d));
    if count > 0 { sum / count as f64 } else { radius * radius }
}

/// Maps a small motion about the source's centre, in the target's axes and metres, to the tangent at the
/// source's frame.
fn body_from_scaled<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> SMatrix<f64, N, N> {
    let shift = G::from_matrix(&SMatrix::identity(), &problem.centre);
    let scale = problem.scale::<N>();
    let mut map = shift.adjoint() * G::turn_tangent(&pose.rotation.transpose());
    for k in 0..N {
        for i in 0..N {
            map[(i, k)] /= scale[k];
        }
    }
    map
}

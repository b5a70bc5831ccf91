use nalgebra::{SMatrix, SVector};

use super::Covariance;
use super::align::{Pose, Problem, moved};
use super::normal_equations::NormalEquations;
use super::params::Residual;
use crate::DEGENERATE_SIGMA;
use crate::linalg::symmetric_eigen;
use crate::motion::RigidMotion;

/// The probe step of the curvature in units of the root mean square distance of the pairs: far enough for the
/// points to change partners.
const PROBE: f64 = 3.0;

/// A direction is degenerate when its standard deviation exceeds this share of the probe step: moving that far
/// then changes the score by less than five of its own deviations, so the scans do not show the motion.
const DEGENERATE_SHARE: f64 = 1.0 / 5.0;

/// Bounds of the ratio of the local to the wide curvature along a direction that is fixed: outside them the local one
/// is noise.
const LOCAL_TO_WIDE: [f64; 2] = [0.05, 1.0];

/// Lengths of the small motions over which the local curvature is averaged, in units of the residual: the error of the
/// pose is shorter, but over short ways the score, which jumps as pairs change, is mostly noise. On 800 simulated scans
/// of pilings and 400 of a room 0.4 to 1.0 covers 92 and 97 % by the 95 % ellipsoid, 0.6 to 1.4 covers 95 and 98 %. Of
/// many points each length is tried by others.
const LENGTHS: [f64; 3] = [0.5, 0.85, 1.2];

/// Scores of one point that each curvature takes at most, of points evenly drawn; the rest would change it by little.
const MOST_SCORES: usize = 3000;

/// Source points that try each of the `2 N` motions at most.
const fn most_probes(dimensions: usize) -> usize {
    MOST_SCORES / (2 * dimensions)
}

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
    /// What a score that is not zero on the whole adds to it.
    offset: SMatrix<f64, N, N>,
    sigma: f64,
    /// Root mean square of the residuals that count, in metres.
    step: f64,
    /// Root mean square distance of the pairs, metres.
    rms: f64,
    /// Weight of each pair that counts.
    weights: Vec<f64>,
    /// By how much the kernel's own slope lessens the curvature, on the mean.
    shrink: f64,
}

pub(crate) fn estimate<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
) -> Uncertainty<N> {
    let mut evidence = evidence::<D, N, G>(problem, pose);
    let to_body = body_from_scaled::<D, N, G>(problem, pose);
    let enough = problem.kept.len() * coordinates::<D>(problem.params.residual) > N;
    let mut answer = if !enough {
        unknown(&to_body, evidence.sigma)
    } else {
        let probe = (PROBE * evidence.rms).min(0.5 * problem.params.max_distance).max(1e-6 * problem.radius);
        let (wide, local) = match problem.params.covariance {
            Covariance::Residual | Covariance::Spacing { .. } => (evidence.h, evidence.h),
            Covariance::Sandwich => {
                let step = evidence.step.clamp(1e-6 * problem.radius, probe);
                let (local, offset) = local_curvature::<D, N, G>(problem, pose, step);
                evidence.offset = offset * offset.transpose();
                (wide_curvature::<D, N, G>(problem, pose, probe, &evidence), local)
            }
        };
        combine(&evidence, &wide, &local, probe, problem, &to_body)
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
    let scale = problem.scale::<N>();
    let kernel = problem.params.kernel;
    let dimensions = coordinates::<D>(problem.params.residual);
    // a target point's own error is common to all source points that chose it: they count as one draw
    let mut draws = vec![0.0; N * problem.target.len()];
    let mut chosen = vec![0u8; problem.target.len()];
    let mut weights = Vec::with_capacity(problem.kept.len());
    let (mut slope, mut metric) = (0.0, 0.0);
    let sum = problem.normal_equations_seen::<N, G>(pose, |pair, term, weight| {
        let score = (term.score::<G>() * weight).component_div(&scale);
        let at = pair.target as usize;
        chosen[at] = 1;
        draws[N * at..N * (at + 1)].iter_mut().zip(score.iter()).for_each(|(total, part)| *total += part);
        weights.push(weight);
        slope += kernel.slope(term.cost(), weight, dimensions);
        metric += term.mean_metric();
    });
    let (mut variance, mut clusters) = (SMatrix::zeros(), 0.0);
    for (draw, _) in draws.chunks_exact(N).zip(&chosen).filter(|(_, chosen)| **chosen == 1) {
        let total = SVector::<f64, N>::from_column_slice(draw);
        variance += total * total.transpose();
        clusters += 1.0;
    }
    let freedom = (sum.weight * dimensions as f64 - N as f64).max(1.0);
    let squares: f64 = problem.kept.iter().map(|p| p.distance_sq).sum();
    Evidence {
        h: SMatrix::from_fn(|i, j| sum.h[(i, j)] / (scale[i] * scale[j])),
        score_variance: variance * (clusters / (clusters - N as f64).max(1.0)),
        offset: SMatrix::zeros(),
        sigma: (sum.cost / freedom).sqrt(),
        step: noise_metres::<D, N>(problem, &sum, metric / problem.kept.len().max(1) as f64),
        rms: (squares / problem.kept.len().max(1) as f64).sqrt(),
        weights,
        shrink: if sum.weight > 0.0 { (slope / sum.weight).clamp(0.1, 1.0) } else { 1.0 },
    }
}

/// Root mean square of the residuals that count, along the directions in which they count.
///
/// A residual in standard deviations is turned into metres by the mean size of its metric.
fn noise_metres<const D: usize, const N: usize>(
    problem: &Problem<'_, D>,
    sum: &NormalEquations<N>,
    mean_metric: f64,
) -> f64 {
    let along = match problem.params.residual {
        // only the direction across the planes has weight to speak of
        Residual::PointToPlane | Residual::Symmetric | Residual::PlaneToPlane => 1.0,
        Residual::PointToPoint | Residual::Mahalanobis => D as f64,
    };
    let mean_square = sum.cost / (sum.weight * along).max(f64::MIN_POSITIVE);
    if problem.params.residual != Residual::Mahalanobis {
        mean_square.sqrt()
    } else if mean_metric > 0.0 {
        (mean_square / mean_metric).sqrt()
    } else {
        0.0
    }
}

fn score<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    pair: &super::association::Pair,
) -> SVector<f64, N> {
    let term = problem.term::<N, G>(pair, pose);
    term.score::<G>() * problem.params.kernel.weight(term.cost())
}

/// How the score falls with a motion as small as the noise: every pair is chosen, rejected and weighted afresh.
///
/// The error of the pose is far smaller than the noise of a point, so this is the slope on which it settles. It is less
/// steep than `JᵀJ` makes it (by a quarter where points lie five times as far apart as they are noisy, by half at
/// twice), since a scan that moves across a wall finds partners whose own errors are on that side, and loses the
/// others to trimming.
///
/// With it comes the mean score over these motions: where it is not zero, the answer has stopped at one of the many
/// places where the score, jumping as pairs change, happens to vanish, and not where it does on the whole.
fn local_curvature<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    step: f64,
) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let points = problem.matched.len();
    let stride = if points <= most_probes(N) { 1 } else { (LENGTHS.len() * points).div_ceil(most_probes(N)) };
    let (mut moved_pairs, mut kept, mut buffer) = (Vec::new(), Vec::new(), Vec::new());
    let (mut slope, mut mean) = (SMatrix::zeros(), SVector::zeros());
    for (length, begin) in LENGTHS.iter().zip(0..) {
        let drawn = || problem.matched.iter().skip(begin % stride).step_by(stride);
        let share = points as f64 / drawn().count().max(1) as f64;
        let (s, m) = central_differences::<D, N, G>(problem, pose, length * step, |there| {
            moved_pairs.clear();
            moved_pairs.extend(drawn().filter_map(|p| problem.nearest_pair(p, there)));
            problem.reject(there, &moved_pairs, &mut kept, &mut buffer);
            kept.iter().map(|pair| score::<D, N, G>(problem, there, pair)).sum()
        });
        slope += s * (share / LENGTHS.len() as f64);
        mean += m * (share / LENGTHS.len() as f64);
    }
    (slope, mean)
}

/// The negative slope of a score over steps of so many metres both ways along each axis, made symmetric, and its mean,
/// in metres.
fn central_differences<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    metres: f64,
    mut score_at: impl FnMut(&Pose<D>) -> SVector<f64, N>,
) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let scale = problem.scale::<N>();
    let mut slope = SMatrix::<f64, N, N>::zeros();
    let mut sum = SVector::<f64, N>::zeros();
    for k in 0..N {
        let mut column = SVector::<f64, N>::zeros();
        for sign in [-1.0, 1.0] {
            let mut step = SVector::<f64, N>::zeros();
            step[k] = sign * metres / scale[k];
            let score = score_at(&moved::<D, N, G>(pose, &step)).component_div(&scale);
            column -= score * sign;
            sum += score;
        }
        slope.set_column(k, &(column / (2.0 * metres)));
    }
    ((slope + slope.transpose()) * 0.5, sum / (2 * N) as f64)
}

/// How the score falls with a motion, by central differences over `probe` metres with the points free to change
/// partners.
///
/// The usual `JᵀJ` holds the pairs fixed, so a wall seems to pin a scan that slides along it as soon as the
/// residual or noise in the normals has a part along the wall; here the motion itself is tried. Points keep the
/// weight they have at the answer, since the probe is longer than a kernel's scale; the kernel's slope there
/// enters by its mean.
fn wide_curvature<const D: usize, const N: usize, G: RigidMotion<D, N>>(
    problem: &Problem<'_, D>,
    pose: &Pose<D>,
    probe: f64,
    evidence: &Evidence<N>,
) -> SMatrix<f64, N, N> {
    let stride = problem.kept.len().div_ceil(most_probes(N)).max(1);
    let drawn = || problem.kept.iter().zip(&evidence.weights).step_by(stride);
    let (curvature, _) = central_differences::<D, N, G>(problem, pose, probe, |there| {
        let mut score = SVector::<f64, N>::zeros();
        for (pair, weight) in drawn().filter(|(_, w)| **w > 0.0) {
            let Some(pair) = problem.nearest_pair(pair, there) else { continue };
            score += problem.term::<N, G>(&pair, there).score::<G>() * *weight;
        }
        score
    });
    let total: f64 = evidence.weights.iter().sum();
    let of_drawn: f64 = drawn().map(|(_, weight)| weight).sum();
    let share = if of_drawn > 0.0 { total / of_drawn } else { 0.0 };
    curvature * (evidence.shrink * share)
}

/// `K⁻¹ A K⁻¹` with the local curvature `K` and score variance `A`, without the directions of which the wide curvature
/// says that nothing fixes them.
fn combine<const D: usize, const N: usize>(
    evidence: &Evidence<N>,
    wide: &SMatrix<f64, N, N>,
    local: &SMatrix<f64, N, N>,
    probe: f64,
    problem: &Problem<'_, D>,
    to_body: &SMatrix<f64, N, N>,
) -> Uncertainty<N> {
    let (values, vectors) = symmetric_eigen(wide);
    // exact data has no residual; a floor keeps the information finite
    let floor = (1e-9 * problem.radius).powi(2);
    let variance = match problem.params.covariance {
        Covariance::Sandwich => evidence.score_variance + evidence.h * floor,
        _ => evidence.h * evidence.sigma.powi(2).max(floor),
    };
    let limit = DEGENERATE_SHARE * probe;
    // columns that turn the wide curvature into the identity where a direction is fixed
    let mut whiten = SMatrix::<f64, N, N>::zeros();
    let mut covariance = SMatrix::<f64, N, N>::zeros();
    let mut degenerate_directions = Vec::new();
    for k in 0..N {
        let v = vectors.column(k).into_owned();
        let deviation = (v.transpose() * variance * v)[0].max(0.0).sqrt();
        let fixed = values[k] > 1e-9 * values[N - 1] && deviation < limit * values[k];
        if fixed && values[N - 1] > 0.0 {
            whiten.set_column(k, &(v / values[k].sqrt()));
        } else {
            let direction = to_body * v;
            covariance += direction * direction.transpose() * (DEGENERATE_SIGMA * DEGENERATE_SIGMA);
            degenerate_directions.push(direction.normalize());
        }
    }
    let (ratios, axes) = symmetric_eigen(&(whiten.transpose() * local * whiten));
    let mut inverse = SMatrix::<f64, N, N>::zeros();
    for (ratio, axis) in ratios.iter().zip(axes.column_iter()) {
        let direction = whiten * axis;
        inverse += direction * direction.transpose() / ratio.clamp(LOCAL_TO_WIDE[0], LOCAL_TO_WIDE[1]);
    }
    let scaled = inverse * (variance + evidence.offset) * inverse;
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

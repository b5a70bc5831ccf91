use draco_lie::chi2;
use nalgebra::{SMatrix, SVector};

use crate::pose::transported;
use crate::{Closure, Error, Pose, Trajectories, Trajectory};

/// The test whether two closures between the same two robots tell of the same map transform.
///
/// A closure `Z` from pose `i` of robot `q` to pose `k` of robot `r` implies `T = X_rk Z⁻¹ X_qi⁻¹`, robot `q`'s
/// map seen from robot `r`'s. For two closures `m` and `n`
///
/// ```text
/// e = log(T_m T_n⁻¹)
/// Σ = A_m S_m A_mᵀ + A_n S_n A_nᵀ + V_r(k, l) + Ad(T) V_q(i, j) Ad(T)ᵀ        A = Ad(X_rk)
/// χ² = eᵀ Σ⁻¹ e
/// ```
///
/// with the covariances `S` of **both** measurements and `V` of the odometry between the poses of **both** robots.
/// The adjoint frames cancel in χ², so it is the χ² of the loop closed by the two measurements. When both ends
/// are one robot the two odometry parts are correlated and the cross terms are added.
///
/// Everything that belongs to one closure is computed once, so a pair costs one logarithm, one congruence and one
/// triangular factor. Most pairs that disagree cost less: the χ² of a part of `e` with its own covariance is at most
/// that of the whole, so a pair whose orientations alone are too far apart for it has failed.
pub struct PairTest<'a, G, const N: usize> {
    ends: Vec<End<G, N>>,
    first: Option<&'a Trajectory<G, N>>,
    second: Option<&'a Trajectory<G, N>>,
    same_robot: bool,
    limit: f64,
}

/// What one closure brings to every pair it is in. What most pairs need comes first, so that it is in few lines of
/// memory.
#[derive(Debug, Clone)]
#[repr(C)]
pub(crate) struct End<G, const N: usize> {
    first_from_second: G,
    turns: Turns,
    k: usize,
    i: usize,
    second_from_first: G,
    adjoint: SMatrix<f64, N, N>,
    measurement: SMatrix<f64, N, N>,
}

/// Traces of the rotation's part of covariances.
#[derive(Debug, Clone, Copy)]
struct Turns {
    /// Of the measurement.
    measurement: f64,
    /// Of the drift of each robot up to its pose; not a number where drifts are not sums along a chain, or both robots
    /// are one.
    first: f64,
    second: f64,
}

/// Room for rounding between the part's χ² and the whole's.
const ROUNDING: f64 = 1.0 + 1e-6;

impl<'a, G: Pose<N>, const N: usize> PairTest<'a, G, N> {
    /// Prepares the closures of one robot pair; those of the other direction are turned.
    ///
    /// * `probability` – share of true pairs that shall pass, e.g. 0.99.
    ///
    /// # Errors
    /// A closure of another robot pair, with an unknown pose, or with a bad pose or covariance; a `probability`
    /// outside (0, 1).
    pub fn new(
        trajectories: &'a Trajectories<G, N>,
        closures: &[Closure<G, N>],
        probability: f64,
    ) -> Result<Self, Error> {
        let limit = gate::<N>(probability)?;
        let robots = closures.first().map(Closure::robots);
        let mut ends = Vec::with_capacity(closures.len());
        for (index, closure) in closures.iter().enumerate() {
            closure.check(index)?;
            if Some(closure.robots()) != robots {
                return Err(Error::MixedRobots { closure: index });
            }
            ends.push(End::new(trajectories, index, closure)?);
        }
        Ok(Self::of_ends(trajectories, robots.unwrap_or_default(), ends, limit))
    }

    /// The test over closures prepared before.
    pub(crate) fn of_ends(
        trajectories: &'a Trajectories<G, N>,
        (first, second): (u32, u32),
        ends: Vec<End<G, N>>,
        limit: f64,
    ) -> Self {
        Self {
            ends,
            first: trajectories.get(first),
            second: trajectories.get(second),
            same_robot: first == second,
            limit,
        }
    }

    /// The same test with all covariances multiplied by `scale`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a `scale` that is not positive and finite.
    pub fn with_scale(self, scale: f64) -> Result<Self, Error> {
        Ok(Self { limit: scaled(self.limit, scale)?, ..self })
    }

    /// Gives the prepared closures back.
    pub(crate) fn into_ends(self) -> Vec<End<G, N>> {
        self.ends
    }

    /// Number of closures.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is no closure.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Largest χ² that passes.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Whether the pair passes.
    ///
    /// # Panics
    /// When `m` or `n` is not below [`PairTest::len`].
    pub fn agree(&self, m: usize, n: usize) -> bool {
        !self.turned_apart(&self.ends[m], &self.ends[n]) && self.chi2(m, n) <= self.limit
    }

    /// Whether the orientations alone say that χ² is above the limit: a lower bound of it is
    ///
    /// ```text
    /// chord² / tr Σ_φφ  ≤  |φ|² / tr Σ_φφ  ≤  φᵀ Σ_φφ⁻¹ φ  ≤  eᵀ Σ⁻¹ e
    /// ```
    ///
    /// Turning the frame does not change the trace, so no adjoint is needed. Never where the ends' drifts are
    /// correlated.
    #[inline(always)]
    fn turned_apart(&self, a: &End<G, N>, b: &End<G, N>) -> bool {
        let (of_a, of_b) = (&a.turns, &b.turns);
        let mut drift = (of_a.first - of_b.first).abs() + (of_a.second - of_b.second).abs();
        if drift.is_nan() {
            drift = self.turned_by_drift(a, b);
        }
        let variance = of_a.measurement + of_b.measurement + drift;
        a.first_from_second.turn_chord_sq(&b.first_from_second) > self.limit * ROUNDING * variance
    }

    /// Trace of the rotation's part of both robots' drifts, where they are no sums along a chain; not a number where
    /// they are correlated.
    #[cold]
    fn turned_by_drift(&self, a: &End<G, N>, b: &End<G, N>) -> f64 {
        match (self.first, self.second, self.same_robot) {
            (Some(first), Some(second), false) => first
                .turn_between(a.k, b.k)
                .zip(second.turn_between(a.i, b.i))
                .map_or(f64::NAN, |(f, s)| f + s),
            _ => f64::NAN,
        }
    }

    /// χ² of closures `m` and `n`, symmetric to the bit; `f64::INFINITY` when its covariance is singular.
    ///
    /// # Panics
    /// When `m` or `n` is not below [`PairTest::len`].
    pub fn chi2(&self, m: usize, n: usize) -> f64 {
        let (m, n) = (m.min(n), m.max(n));
        let (a, b) = (&self.ends[m], &self.ends[n]);
        let (Some(first), Some(second)) = (self.first, self.second) else {
            return f64::INFINITY;
        };
        let (Some(of_first), Some(of_second)) =
            (first.drift_between(a.k, b.k), second.drift_between(a.i, b.i))
        else {
            return f64::INFINITY;
        };
        let e = a.first_from_second.compose(&b.second_from_first).log();
        let mut covariance = a.measurement + b.measurement + of_first;
        G::add_congruence(&mut covariance, &a.adjoint, &of_second);
        if self.same_robot {
            let cross = self.drift_cross(first, a, b) * a.adjoint.transpose();
            covariance -= cross + cross.transpose();
        }
        mahalanobis_sq(&covariance, &e)
    }

    /// `Cov(z_k - z_l, z_i - z_j)` when both ends are one robot.
    fn drift_cross(&self, robot: &Trajectory<G, N>, a: &End<G, N>, b: &End<G, N>) -> SMatrix<f64, N, N> {
        let c = |k, l| robot.drift_covariance(k, l).unwrap_or_else(SMatrix::zeros);
        c(a.k, a.i) - c(a.k, b.i) - c(b.k, a.i) + c(b.k, b.i)
    }
}

impl<G: Pose<N>, const N: usize> End<G, N> {
    pub(crate) fn new(
        trajectories: &Trajectories<G, N>,
        index: usize,
        closure: &Closure<G, N>,
    ) -> Result<Self, Error> {
        let closure = closure.with_source_robot(closure.robots().0);
        let x_k = trajectories.of(index, closure.source)?.poses()[closure.source.index];
        let x_i = trajectories.of(index, closure.target)?.poses()[closure.target.index];
        let second_from_first = x_i.compose(&closure.target_from_source).compose(&x_k.inverse());
        let first_from_second = second_from_first.inverse();
        let measurement = transported(&x_k.adjoint(), &closure.covariance);
        let (of_first, of_second) =
            (trajectories.of(index, closure.source)?, trajectories.of(index, closure.target)?);
        let turn = |trajectory: &Trajectory<G, N>, pose: usize| match closure.is_inter_robot() {
            true => trajectory.turn_up_to(pose).unwrap_or(f64::NAN),
            false => f64::NAN,
        };
        let turns = Turns {
            measurement: (G::TRANSLATION..N).map(|row| measurement[(row, row)]).sum(),
            first: turn(of_first, closure.source.index),
            second: turn(of_second, closure.target.index),
        };
        Ok(Self {
            turns,
            k: closure.source.index,
            i: closure.target.index,
            first_from_second,
            second_from_first,
            adjoint: first_from_second.adjoint(),
            measurement,
        })
    }
}

/// The χ² limit with `N` degrees of freedom.
pub(crate) fn gate<const N: usize>(probability: f64) -> Result<f64, Error> {
    chi2::quantile(probability, N).map_err(|_| Error::Probability { value: probability })
}

/// The limit of covariances that are `scale` times as large.
pub(crate) fn scaled(limit: f64, scale: f64) -> Result<f64, Error> {
    if scale > 0.0 && scale.is_finite() { Ok(limit * scale) } else { Err(Error::Parameter { name: "scale" }) }
}

/// `eᵀ Σ⁻¹ e` by a Cholesky factor on the stack; infinite when `Σ` is not positive definite.
#[inline]
pub(crate) fn mahalanobis_sq<const N: usize>(covariance: &SMatrix<f64, N, N>, e: &SVector<f64, N>) -> f64 {
    let mut l = *covariance;
    let mut y = *e;
    let mut chi2 = 0.0;
    for j in 0..N {
        let mut diagonal = l[(j, j)];
        for p in 0..j {
            diagonal -= l[(j, p)] * l[(j, p)];
        }
        if diagonal.is_nan() || diagonal <= 0.0 {
            return f64::INFINITY;
        }
        let inverse = 1.0 / diagonal.sqrt();
        for i in j + 1..N {
            let mut v = l[(i, j)];
            for p in 0..j {
                v -= l[(i, p)] * l[(j, p)];
            }
            l[(i, j)] = v * inverse;
        }
        y[j] *= inverse;
        chi2 += y[j] * y[j];
        for i in j + 1..N {
            y[i] -= l[(i, j)] * y[j];
        }
    }
    chi2
}

#[cfg(test)]
mod tests {
    use draco_lie::LieGroup;
    use nalgebra::{Isometry2, Isometry3};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::simulate::{Planted, planted};

    /// Pairs refused by their orientations and pairs refused in all, after a check that the former are among the
    /// latter.
    fn refused<const N: usize, G: Pose<N>>(probability: f64) -> [usize; 2] {
        let team = planted::<N, G>(&Planted::default(), &mut ChaCha8Rng::seed_from_u64(3)).unwrap();
        let test = PairTest::new(&team.trajectories, &team.closures, probability).unwrap();
        let pairs = (0..test.len()).flat_map(|n| (0..n).map(move |m| (m, n)));
        let mut counts = [0; 2];
        for (m, n) in pairs {
            let (early, whole) =
                (test.turned_apart(&test.ends[m], &test.ends[n]), test.chi2(m, n) > test.limit());
            assert!(whole || !early, "{m} {n}: chi2 {}", test.chi2(m, n));
            assert_eq!(test.agree(m, n), !whole);
            counts[0] += usize::from(early);
            counts[1] += usize::from(whole);
        }
        counts
    }

    #[test]
    fn orientations_refuse_most_pairs_that_disagree_and_no_other() {
        for [early, whole] in [0.5, 0.99]
            .into_iter()
            .flat_map(|p| [refused::<3, Isometry2<f64>>(p), refused::<6, Isometry3<f64>>(p)])
        {
            assert!(early as f64 > 0.6 * whole as f64, "{early} of {whole}");
        }
    }

    #[test]
    fn the_chord_is_at_most_the_angle_and_close_to_it_where_small() {
        for angle in [0.0, 1e-9, 1e-4, 0.1, -0.1, 1.0, -2.0, 3.1, std::f64::consts::PI] {
            let chord_2 =
                Isometry2::planar(1.0, 2.0, 3.0).turn_chord_sq(&Isometry2::planar(0.0, 0.0, 3.0 + angle));
            let start = Isometry3::planar(1.0, 2.0, 3.0);
            let turned = start.compose(&Isometry3::rotation(nalgebra::Vector3::new(0.6, 0.0, -0.8) * angle));
            let chord_3 = start.turn_chord_sq(&turned);
            for (chord, share) in [(chord_2, 0.5), (chord_3, 0.25)] {
                let expected = (angle * share).sin() / share;
                assert!((chord - expected * expected).abs() < 1e-14 + 1e-12 * chord, "{angle}: {chord}");
                assert!(chord <= angle * angle * (1.0 + 1e-12) + 1e-14);
            }
        }
    }
}

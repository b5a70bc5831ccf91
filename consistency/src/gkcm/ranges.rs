use draco_lie::chi2;
use nalgebra::linalg::Cholesky;
use nalgebra::{Matrix2, Matrix2x3, Matrix4, Matrix4x2, Vector2, Vector4};

use super::{KConsistency, select};
use crate::clique::Budget;
use crate::{Error, Trajectory2, hyperclique};

/// A measured distance from one pose of a robot to a beacon whose place is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Index of the pose.
    pub pose: usize,
    /// Distance, metres.
    pub range: f64,
    /// σ of the distance, metres.
    pub sigma: f64,
}

/// Parameters of [`range_consistency`].
#[derive(Debug, Clone, PartialEq)]
pub struct RangeParams {
    /// Share of true sets of four that shall pass; default 0.99.
    pub probability: f64,
    /// Least size of a set that is believed; default 5, one more than a single test.
    pub minimum: usize,
    /// Limit of the hyperclique search; default none.
    pub budget: Budget,
}

impl Default for RangeParams {
    fn default() -> Self {
        Self { probability: 0.99, minimum: 5, budget: Budget::default() }
    }
}

/// The largest set of ranges to one beacon of which every four agree on its place.
///
/// Four ranges agree when the best beacon for all of them leaves
///
/// ```text
/// χ² = min over b of rᵀ C⁻¹ r,    r_i = |b - p_i| - z_i,    C = diag(σ²) + odometry between the four poses
/// ```
///
/// under the limit with two degrees of freedom. Two are tested before: their circles must touch within the noise.
/// Both places where two circles meet are tried as a start.
///
/// # Errors
/// [`Error::BadRange`], [`Error::UnknownPose`] (with robot 0), a bad probability.
pub fn range_consistency(
    trajectory: &Trajectory2,
    ranges: &[Range],
    params: &RangeParams,
) -> Result<KConsistency, Error> {
    let test = RangeTest::new(trajectory, ranges, params.probability)?;
    let checked = hyperclique::from_checks(ranges.len(), 4, 2, |set| match set {
        [a, b] => test.circles_touch(*a, *b),
        [a, b, c, d] => test.four_agree([*a, *b, *c, *d]),
        _ => true,
    })?;
    let best = hyperclique::maximum(&checked.hypergraph, &params.budget);
    let numbers: Vec<usize> = (0..ranges.len()).collect();
    Ok(KConsistency {
        selection: select(best.vertices, params.minimum, &numbers),
        optimal: best.optimal,
        tests: checked.tests,
    })
}

struct RangeTest<'a> {
    trajectory: &'a Trajectory2,
    ranges: &'a [Range],
    places: Vec<Vector2<f64>>,
    pair_limit: f64,
    limit: f64,
}

impl<'a> RangeTest<'a> {
    fn new(trajectory: &'a Trajectory2, ranges: &'a [Range], probability: f64) -> Result<Self, Error> {
        let quantile = |freedom| {
            chi2::quantile(probability, freedom).map_err(|_| Error::Probability { value: probability })
        };
        let mut places = Vec::with_capacity(ranges.len());
        for (index, range) in ranges.iter().enumerate() {
            let finite = range.range.is_finite() && range.sigma.is_finite();
            if !finite || range.range < 0.0 || range.sigma <= 0.0 {
                return Err(Error::BadRange { range: index });
            }
            let known = trajectory.pose(range.pose).filter(|_| trajectory.covers(range.pose));
            let unknown = Error::UnknownPose { closure: index, robot: 0, index: range.pose };
            places.push(known.ok_or(unknown)?.translation.vector);
        }
        Ok(Self { trajectory, ranges, places, pair_limit: quantile(1)?, limit: quantile(2)? })
    }

    /// Whether the two circles meet within their noise.
    fn circles_touch(&self, a: usize, b: usize) -> bool {
        let (ra, rb) = (&self.ranges[a], &self.ranges[b]);
        let apart = self.places[b] - self.places[a];
        let distance = apart.norm();
        let gap = (distance - ra.range - rb.range).max((ra.range - rb.range).abs() - distance).max(0.0);
        let along = if distance > 0.0 { apart / distance } else { Vector2::x() };
        let drift = along.dot(&(self.relative_covariance(a, b, b) * along));
        gap * gap <= self.pair_limit * (ra.sigma * ra.sigma + rb.sigma * rb.sigma + drift)
    }

    /// Covariance of the positions from which `i` and `j` were measured, both relative to the pose of `origin`: a
    /// drift `z` of the map frame moves the point `p` by `z_t + z_θ J p`.
    fn relative_covariance(&self, origin: usize, i: usize, j: usize) -> Matrix2<f64> {
        let pose = |m: usize| self.ranges[m].pose;
        let c = |k, l| self.trajectory.drift_covariance(k, l).unwrap_or_default();
        let (o, k, l) = (pose(origin), pose(i), pose(j));
        let motion = |p: &Vector2<f64>| Matrix2x3::new(1.0, 0.0, -p.y, 0.0, 1.0, p.x);
        motion(&self.places[i])
            * (c(k, l) - c(k, o) - c(o, l) + c(o, o))
            * motion(&self.places[j]).transpose()
    }

    fn four_agree(&self, set: [usize; 4]) -> bool {
        self.starts(&set).into_iter().any(|start| self.chi2(&set, start) <= self.limit)
    }

    /// Where the two circles of the set whose centres lie furthest apart meet.
    fn starts(&self, set: &[usize; 4]) -> [Vector2<f64>; 2] {
        let pairs = (0..4).flat_map(|i| (i + 1..4).map(move |j| (set[i], set[j])));
        let apart = |&(a, b): &(usize, usize)| (self.places[b] - self.places[a]).norm();
        let (a, b) = pairs.max_by(|p, q| apart(p).total_cmp(&apart(q))).unwrap_or((set[0], set[1]));
        let (ra, rb) = (self.ranges[a].range, self.ranges[b].range);
        let distance = apart(&(a, b)).max(1e-9);
        let along = (self.places[b] - self.places[a]) / distance;
        let x = ((ra * ra - rb * rb + distance * distance) / (2.0 * distance)).clamp(-ra, ra);
        // circles that only touch leave the side open: step off the line a little
        let y = (ra * ra - x * x).max(0.0).sqrt().max(0.05 * ra.min(rb));
        let across = Vector2::new(-along.y, along.x);
        let foot = self.places[a] + along * x;
        [foot + across * y, foot - across * y]
    }

    /// χ² of the best beacon near `start`, by Gauss-Newton.
    fn chi2(&self, set: &[usize; 4], start: Vector2<f64>) -> f64 {
        const STEPS: usize = 6;
        let mut beacon = start;
        let mut chi2 = f64::INFINITY;
        for _ in 0..STEPS {
            let rays = set.map(|m| beacon - self.places[m]);
            let directions = rays.map(|ray| ray / ray.norm().max(1e-9));
            let residual = Vector4::from_fn(|row, _| rays[row].norm() - self.ranges[set[row]].range);
            let jacobian = Matrix4x2::from_fn(|row, column| directions[row][column]);
            let Some(factor) = Cholesky::new(self.covariance(set, &directions)) else {
                return f64::INFINITY;
            };
            let value = residual.dot(&factor.solve(&residual));
            if value >= chi2 {
                break;
            }
            chi2 = value;
            let weighted = factor.solve(&jacobian);
            let normal = jacobian.tr_mul(&weighted) + Matrix2::identity() * 1e-9;
            let Some(inverse) = normal.try_inverse() else { break };
            let step = inverse * weighted.tr_mul(&residual);
            beacon -= step;
            if step.norm_squared() < 1e-8 {
                break;
            }
        }
        chi2
    }

    /// Covariance of the four residuals: the ranges' own noise and the odometry relative to the first pose.
    fn covariance(&self, set: &[usize; 4], directions: &[Vector2<f64>; 4]) -> Matrix4<f64> {
        let own = Vector4::from_fn(|row, _| self.ranges[set[row]].sigma.powi(2));
        let mut covariance = Matrix4::from_diagonal(&own);
        for i in 1..4 {
            for j in 1..=i {
                let block = self.relative_covariance(set[0], set[i], set[j]);
                let value = directions[i].dot(&(block * directions[j]));
                covariance[(i, j)] += value;
                if i != j {
                    covariance[(j, i)] += value;
                }
            }
        }
        covariance
    }
}

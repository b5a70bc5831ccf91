use std::f64::consts::{PI, TAU};

use draco_graphmatch::Object;
use nalgebra::{DMatrix, DVector, Isometry2, Matrix2, Matrix3, Point2, Vector2};

/// Standard deviations as the sensors of this data set have them: a bearing's, radians; a range's, metres and metres a
/// metre (far tubes appear too near).
const BEARING_SIGMA: f64 = 0.02;
const RANGE_SIGMA: f64 = 0.05;
const RANGE_SIGMA_RELATIVE: f64 = 0.05;
/// Standard deviations of odometry: metres a metre travelled, radians a radian turned, radians after a second.
const DRIFT: f64 = 0.1;
const TURN_DRIFT: f64 = 0.1;
const HEADING_DRIFT: f64 = 0.05;
/// Least drift of a coordinate in a step, metres.
const STEP_DRIFT: f64 = 0.001;
/// Squared Mahalanobis distance above which a sighting is a misread barcode: 99.9 % of χ² with 2 degrees.
const GATE: f64 = 13.8;

/// One robot's own map: an extended Kalman filter over its pose and the landmarks it has seen, in the frame of its
/// first pose. State order: x, y, θ, then x, y of every landmark.
pub(crate) struct Slam {
    state: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Number of every landmark, in order of the state, and how often it was seen.
    pub(crate) landmarks: Vec<(u32, usize)>,
}

impl Slam {
    pub(crate) fn new() -> Self {
        Self { state: DVector::zeros(3), covariance: DMatrix::zeros(3, 3), landmarks: Vec::new() }
    }

    /// Moves the pose by odometry's increment over `seconds`, in the frame of the old pose.
    pub(crate) fn predict(&mut self, step: &Isometry2<f64>, seconds: f64) {
        let theta = self.state[2];
        let (sin, cos) = theta.sin_cos();
        let (d, turn) = (step.translation.vector, step.rotation.angle());
        let moved = Vector2::new(cos * d.x - sin * d.y, sin * d.x + cos * d.y);
        self.state[0] += moved.x;
        self.state[1] += moved.y;
        self.state[2] = wrap(theta + turn);
        // Only the pose's rows and columns of F differ from the identity: F = I + e₁₂ [0 0 g].
        let n = self.state.len();
        let lever = Vector2::new(-moved.y, moved.x);
        for axis in 0..2 {
            for k in 0..n {
                let share = lever[axis] * self.covariance[(2, k)];
                self.covariance[(axis, k)] += share;
            }
            for k in 0..n {
                let share = lever[axis] * self.covariance[(k, 2)];
                self.covariance[(k, axis)] += share;
            }
        }
        let along = (DRIFT * d.norm()).powi(2) + STEP_DRIFT.powi(2);
        let heading = (TURN_DRIFT * turn).powi(2) + HEADING_DRIFT.powi(2) * seconds;
        let noise = Matrix3::from_diagonal(&nalgebra::Vector3::new(along, along, heading));
        let mut pose = self.covariance.view_mut((0, 0), (3, 3));
        pose += noise;
    }

    /// Takes in one sighting: range in metres, bearing in radians from the robot's heading.
    pub(crate) fn observe(&mut self, landmark: u32, range: f64, bearing: f64) {
        let Some(k) = self.landmarks.iter().position(|(id, _)| *id == landmark) else {
            self.add(landmark, range, bearing);
            return;
        };
        let at = 3 + 2 * k;
        let d = Vector2::new(self.state[at] - self.state[0], self.state[at + 1] - self.state[1]);
        let (q, r) = (d.norm_squared(), d.norm());
        if r < 1e-6 {
            return;
        }
        let mut h = DMatrix::zeros(2, self.state.len());
        for (column, x, y) in [(0, -d.x, -d.y), (at, d.x, d.y)] {
            h[(0, column)] = x / r;
            h[(0, column + 1)] = y / r;
            h[(1, column)] = -y / q;
            h[(1, column + 1)] = x / q;
        }
        h[(1, 2)] = -1.0;
        let innovation = Vector2::new(range - r, wrap(bearing - d.y.atan2(d.x) + self.state[2]));
        let ph = &self.covariance * h.transpose();
        let spread = &h * &ph;
        let spread = Matrix2::new(spread[(0, 0)], spread[(0, 1)], spread[(1, 0)], spread[(1, 1)])
            + sensor_noise(range);
        let Some(inverse) = spread.try_inverse() else { return };
        if innovation.dot(&(inverse * innovation)) > GATE {
            return;
        }
        let gain = &ph * inverse;
        self.state += &gain * innovation;
        self.state[2] = wrap(self.state[2]);
        self.covariance -= &gain * ph.transpose();
        self.covariance = 0.5 * (&self.covariance + self.covariance.transpose());
        self.landmarks[k].1 += 1;
    }

    fn add(&mut self, landmark: u32, range: f64, bearing: f64) {
        let n = self.state.len();
        let (sin, cos) = (self.state[2] + bearing).sin_cos();
        let place = Vector2::new(self.state[0] + range * cos, self.state[1] + range * sin);
        self.state = DVector::from_iterator(n + 2, self.state.iter().copied().chain(place.iter().copied()));
        // The new place is G · pose + L · (range, bearing).
        let mut g = DMatrix::zeros(2, n);
        g[(0, 0)] = 1.0;
        g[(1, 1)] = 1.0;
        g[(0, 2)] = -range * sin;
        g[(1, 2)] = range * cos;
        let l = Matrix2::new(cos, -range * sin, sin, range * cos);
        let noise = l * sensor_noise(range) * l.transpose();
        let cross = &g * &self.covariance;
        let own = &cross * g.transpose();
        let mut grown = DMatrix::zeros(n + 2, n + 2);
        grown.view_mut((0, 0), (n, n)).copy_from(&self.covariance);
        grown.view_mut((n, 0), (2, n)).copy_from(&cross);
        grown.view_mut((0, n), (n, 2)).copy_from(&cross.transpose());
        for row in 0..2 {
            for column in 0..2 {
                grown[(n + row, n + column)] = own[(row, column)] + noise[(row, column)];
            }
        }
        self.covariance = grown;
        self.landmarks.push((landmark, 1));
    }

    /// The landmarks as objects, without their numbers.
    ///
    /// * `floor` – metres: what the filter's covariance leaves out, such as linearisation and the tubes' thickness.
    pub(crate) fn objects(&self, floor: f64) -> Vec<Object> {
        (0..self.landmarks.len())
            .map(|k| {
                let at = 3 + 2 * k;
                let covariance =
                    self.covariance.fixed_view::<2, 2>(at, at) + Matrix2::identity() * floor * floor;
                let place = Point2::new(self.state[at], self.state[at + 1]);
                Object { covariance: Some(covariance), ..Object::new(place, 0.1, 0.1) }
            })
            .collect()
    }
}

/// Covariance of a sighting, order range, bearing.
fn sensor_noise(range: f64) -> Matrix2<f64> {
    let sigma = RANGE_SIGMA + RANGE_SIGMA_RELATIVE * range;
    Matrix2::new(sigma * sigma, 0.0, 0.0, BEARING_SIGMA * BEARING_SIGMA)
}

fn wrap(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

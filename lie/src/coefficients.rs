//! The scalar functions of the rotation angle `θ = |φ|` in the Jacobians, to the last digits for every angle.
//!
//! With `P = hat(φ)`:
//!
//! ```text
//! J_l   = A I + B P + C φφᵀ       A = sin θ / θ,  B = (1 - cos θ) / θ²,  C = (1 - A) / θ²
//! J_l⁻¹ = a I - P/2 + D φφᵀ       a = (θ/2) cot(θ/2),                    D = (1 - a) / θ²
//! ```
//!
//! The blocks of SE(3) need in addition the derivatives `F'(θ) / θ` of these, since SE(3) is SO(3) over the
//! dual numbers `φ + ε ρ`: the block is the derivative of `J_l` in the direction `ρ`.

use nalgebra::Vector3;

/// Below this `θ²` the power series, above it the closed forms: there both are good to a few 1e-16.
const SERIES_LIMIT: f64 = 2.0;
/// Enough for 1e-17 at [`SERIES_LIMIT`].
const TERMS: usize = 11;
/// Above this `θ²` the rounding of `θ` itself starts to show in what vanishes or blows up at 2π.
const ROUNDING_LIMIT: f64 = 9.0;
/// Below this `|φ|` squares underflow and every map is its first-order term.
pub(crate) const TINY: f64 = 1e-140;

const PI_SQ: f64 = 9.869_604_401_089_358;
const FOUR_PI_SQ: f64 = 39.478_417_604_357_43;

/// `(-1)^k / (2k + OFFSET)!`, the series of B (offset 2) and C (offset 3) in `θ²`.
const fn alternating(offset: usize) -> [f64; TERMS] {
    let mut coefficients = [0.0; TERMS];
    let mut factorial = 1.0;
    let mut n = 1;
    let mut k = 0;
    while k < TERMS {
        while n <= 2 * k + offset {
            factorial *= n as f64;
            n += 1;
        }
        coefficients[k] = if k % 2 == 0 { 1.0 / factorial } else { -1.0 / factorial };
        k += 1;
    }
    coefficients
}

/// The series of `F'(θ) / θ = 2 dF/d(θ²)` from that of `F`.
const fn rate<const K: usize>(series: [f64; K]) -> [f64; K] {
    let mut coefficients = [0.0; K];
    let mut k = 1;
    while k < K {
        coefficients[k - 1] = 2.0 * k as f64 * series[k];
        k += 1;
    }
    coefficients
}

const B: [f64; TERMS] = alternating(2);
const C: [f64; TERMS] = alternating(3);
const B_RATE: [f64; TERMS] = rate(B);
const C_RATE: [f64; TERMS] = rate(C);

/// `D = Σ_{k≥1} 2 / (4k²π² - θ²)` (partial fractions of the cotangent). The pole at 2π is kept as it stands; this
/// is the power series of the others, `2 (ζ(2j+2) - 1) / (4π²)^(j+1)`, good to 1e-17 up to π. All terms are
/// positive, so nothing cancels.
const D_REST: [f64; 15] = [
    0.032_672_741_512_164_45,
    1.056_411_070_533_47e-4,
    5.637_370_282_876_845e-7,
    3.357_141_926_657_451e-9,
    2.074_287_290_416_604_5e-11,
    1.300_048_213_869_897_5e-13,
    8.196_052_055_691_008e-16,
    5.180_118_196_169_724e-18,
    3.277_539_174_701_792e-20,
    2.074_740_187_859_360_4e-22,
    1.313_624_180_716_653_4e-24,
    8.318_003_195_189_264e-27,
    5.267_262_996_834_231e-29,
    3.335_484_298_822_144_3e-31,
    2.112_206_332_318_388_5e-33,
];
const D_REST_RATE: [f64; 15] = rate(D_REST);

/// Even and odd powers apart: two short chains run side by side where Horner's single one would wait.
#[inline]
fn polynomial<const K: usize>(coefficients: &[f64; K], x: f64) -> f64 {
    let square = x * x;
    let (mut even, mut odd) = (0.0, 0.0);
    for k in (0..K).rev() {
        let chain = if k % 2 == 0 { &mut even } else { &mut odd };
        *chain = *chain * square + coefficients[k];
    }
    even + x * odd
}

/// A rotation angle `theta + low >= 0`; `low` is what rounding took from `|φ|`, kept for large angles only.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Angle {
    pub(crate) theta: f64,
    low: f64,
    pub(crate) theta_sq: f64,
}

impl Angle {
    /// The size of an angle in the plane, which is known exactly.
    #[inline]
    pub(crate) fn of_plane(theta: f64) -> Self {
        Self { theta: theta.abs(), low: 0.0, theta_sq: theta * theta }
    }

    /// The size of a rotation vector.
    #[inline]
    pub(crate) fn of(phi: &Vector3<f64>) -> Self {
        let theta_sq = phi.norm_squared();
        let theta = theta_sq.sqrt();
        let low = if theta_sq > ROUNDING_LIMIT { rounding_of_norm(phi, theta) } else { 0.0 };
        Self { theta, low, theta_sq }
    }

    /// `sin(θ/2)` and `cos(θ/2)`.
    #[inline]
    pub(crate) fn half_sin_cos(&self) -> (f64, f64) {
        let (sin, cos) = (0.5 * self.theta).sin_cos();
        let low = 0.5 * self.low;
        (sin + low * cos, cos - low * sin)
    }

    fn is_small(&self) -> bool {
        self.theta_sq < SERIES_LIMIT
    }
}

/// `|φ| - theta` to first order, from squares and sums without rounding.
#[cold]
fn rounding_of_norm(phi: &Vector3<f64>, theta: f64) -> f64 {
    let squares = phi.component_mul(phi);
    let below = phi.x.mul_add(phi.x, -squares.x)
        + phi.y.mul_add(phi.y, -squares.y)
        + phi.z.mul_add(phi.z, -squares.z)
        - theta.mul_add(theta, -(theta * theta));
    let (xy, xy_below) = two_sum(squares.x, squares.y);
    let (sum, sum_below) = two_sum(xy, squares.z);
    ((sum - theta * theta) + (below + xy_below + sum_below)) / (2.0 * theta)
}

/// Sum and its rounding error, exactly (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_seen = sum - a;
    (sum, (a - (sum - b_seen)) + (b - b_seen))
}

/// A, B and C of `J_l = A I + B P + C φφᵀ`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forward {
    pub(crate) a: f64,
    pub(crate) b: f64,
    pub(crate) c: f64,
}

impl Forward {
    #[inline]
    pub(crate) fn of(angle: &Angle) -> Self {
        if angle.is_small() {
            Self::by_series(angle.theta_sq)
        } else {
            Self::closed(angle, angle.half_sin_cos())
        }
    }

    /// As [`Forward::of`] for a caller who has `sin(θ/2)` and `cos(θ/2)` already.
    #[inline]
    pub(crate) fn with_half(angle: &Angle, half: (f64, f64)) -> Self {
        if angle.is_small() { Self::by_series(angle.theta_sq) } else { Self::closed(angle, half) }
    }

    #[inline]
    fn by_series(theta_sq: f64) -> Self {
        let c = polynomial(&C, theta_sq);
        Self { a: 1.0 - theta_sq * c, b: polynomial(&B, theta_sq), c }
    }

    #[inline]
    fn closed(angle: &Angle, (sin, cos): (f64, f64)) -> Self {
        let a = 2.0 * sin * cos / angle.theta;
        Self { a, b: 2.0 * sin * sin / angle.theta_sq, c: (1.0 - a) / angle.theta_sq }
    }

    /// `B'(θ) / θ` and `C'(θ) / θ`; `A'(θ) / θ` is `C - B`.
    #[inline]
    pub(crate) fn rates(&self, angle: &Angle) -> (f64, f64) {
        let t2 = angle.theta_sq;
        if angle.is_small() {
            (polynomial(&B_RATE, t2), polynomial(&C_RATE, t2))
        } else {
            ((self.a - 2.0 * self.b) / t2, (self.b - 3.0 * self.c) / t2)
        }
    }
}

/// a and D of `J_l⁻¹ = a I - P/2 + D φφᵀ`, and their derivatives over θ.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inverse {
    pub(crate) a: f64,
    pub(crate) d: f64,
    pub(crate) a_rate: f64,
    pub(crate) d_rate: f64,
}

impl Inverse {
    #[inline]
    pub(crate) fn of(angle: &Angle) -> Self {
        if angle.theta_sq <= PI_SQ { Self::by_series(angle.theta_sq) } else { Self::closed(angle) }
    }

    /// For angles up to π, such as every logarithm has: the pole at 2π and the series of the rest.
    #[inline]
    pub(crate) fn by_series(theta_sq: f64) -> Self {
        let pole = 1.0 / (FOUR_PI_SQ - theta_sq);
        let d = 2.0 * pole + polynomial(&D_REST, theta_sq);
        let d_rate = 4.0 * pole * pole + polynomial(&D_REST_RATE, theta_sq);
        Self { a: 1.0 - d * theta_sq, d, a_rate: -(2.0 * d + d_rate * theta_sq), d_rate }
    }

    /// Beyond π, where `a <= 0`, nothing cancels in the closed form.
    #[cold]
    fn closed(angle: &Angle) -> Self {
        let (sin, cos) = angle.half_sin_cos();
        let (half, cot) = (0.5 * angle.theta, cos / sin);
        let a = half * cot;
        let d = (1.0 - a) / angle.theta_sq;
        let a_rate = (cot - half / (sin * sin)) / (2.0 * angle.theta);
        Self { a, d, a_rate, d_rate: -(a_rate + 2.0 * d) / angle.theta_sq }
    }
}

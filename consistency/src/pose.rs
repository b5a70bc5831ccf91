use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector, Vector2, Vector3, Vector6};

/// A rigid pose, SE(2) or SE(3): a [`LieGroup`] whose tangent is a translation followed by a rotation.
///
/// Implemented for [`Isometry2<f64>`](Isometry2) with `N = 3` and [`Isometry3<f64>`](Isometry3) with `N = 6`.
pub trait Pose<const N: usize>: LieGroup<N> {
    /// How many leading tangent entries are translation, metres; the rest are rotation, radians.
    const TRANSLATION: usize;

    /// The position, metres, in the leading entries; the rotation entries are zero.
    fn position(&self) -> SVector<f64, N>;

    /// The pose at `(x, y)` in the horizontal plane with the given heading, metres and radians.
    fn planar(x: f64, y: f64, heading: f64) -> Self;

    /// Whether every number of the pose is finite.
    fn is_finite(&self) -> bool;

    /// At most the square of the angle between two orientations, radians², cheaper than the angle: the square of a
    /// chord. The default is zero.
    fn turn_chord_sq(&self, _other: &Self) -> f64 {
        0.0
    }

    /// `sum += A C Aᵀ` of an adjoint and a symmetric covariance, cheaper where the adjoint has zero blocks.
    fn add_congruence(
        sum: &mut SMatrix<f64, N, N>,
        adjoint: &SMatrix<f64, N, N>,
        covariance: &SMatrix<f64, N, N>,
    ) {
        *sum += adjoint * covariance * adjoint.transpose();
    }
}

impl Pose<3> for Isometry2<f64> {
    const TRANSLATION: usize = 2;

    fn position(&self) -> SVector<f64, 3> {
        Vector3::new(self.translation.x, self.translation.y, 0.0)
    }
    fn planar(x: f64, y: f64, heading: f64) -> Self {
        Isometry2::new(Vector2::new(x, y), heading)
    }
    fn is_finite(&self) -> bool {
        let v = &self.translation.vector;
        v.x.is_finite() && v.y.is_finite() && self.rotation.re.is_finite() && self.rotation.im.is_finite()
    }
    #[inline]
    fn turn_chord_sq(&self, other: &Self) -> f64 {
        let (re, im) = (self.rotation.re - other.rotation.re, self.rotation.im - other.rotation.im);
        re * re + im * im
    }
}

impl Pose<6> for Isometry3<f64> {
    const TRANSLATION: usize = 3;

    fn position(&self) -> SVector<f64, 6> {
        let v = &self.translation.vector;
        Vector6::new(v.x, v.y, v.z, 0.0, 0.0, 0.0)
    }
    fn planar(x: f64, y: f64, heading: f64) -> Self {
        Isometry3::new(Vector3::new(x, y, 0.0), Vector3::z() * heading)
    }
    fn is_finite(&self) -> bool {
        self.translation.vector.iter().chain(self.rotation.coords.iter()).all(|v| v.is_finite())
    }
    #[inline]
    fn turn_chord_sq(&self, other: &Self) -> f64 {
        // A quaternion and its negative are one rotation, and turn by half of its angle.
        let (a, b) = (&self.rotation.coords, &other.rotation.coords);
        4.0 * (a - b).norm_squared().min((a + b).norm_squared())
    }
}

/// The diagonal covariance with `translation_sigma` (metres) and `rotation_sigma` (radians) on each axis.
///
/// Tangent order `[translation, rotation]`.
///
/// ```
/// use draco_consistency::isotropic_covariance;
/// use nalgebra::Isometry2;
/// let covariance = isotropic_covariance::<3, Isometry2<f64>>(0.1, 0.01);
/// assert!((covariance[(2, 2)] - 1e-4).abs() < 1e-18);
/// ```
pub fn isotropic_covariance<const N: usize, G: Pose<N>>(
    translation_sigma: f64,
    rotation_sigma: f64,
) -> SMatrix<f64, N, N> {
    SMatrix::from_diagonal(&SVector::from_fn(|row, _| {
        let sigma = if row < G::TRANSLATION { translation_sigma } else { rotation_sigma };
        sigma * sigma
    }))
}

/// The covariance `A C Aᵀ` made exactly symmetric.
pub(crate) fn transported<const N: usize>(
    adjoint: &SMatrix<f64, N, N>,
    covariance: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    let moved = adjoint * covariance * adjoint.transpose();
    (moved + moved.transpose()) * 0.5
}

/// A measured relative pose `Z · exp(ξ)` told the other way round: `Z⁻¹`, the covariance of ξ moved by `Ad(Z)`.
pub(crate) fn reversed<const N: usize, G: Pose<N>>(
    measured: &G,
    covariance: &SMatrix<f64, N, N>,
) -> (G, SMatrix<f64, N, N>) {
    (measured.inverse(), transported(&measured.adjoint(), covariance))
}

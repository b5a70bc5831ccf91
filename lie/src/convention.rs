//! Covariances and information matrices of other libraries, to and from the convention of this crate.
//!
//! Ours: order **translation, rotation**, perturbation on the **right** (body frame), rotation vector in radians.
//! Each function names the foreign convention; each has a counterpart for the way back. An information matrix
//! goes by the inverse rule, so it has functions of its own.
//!
//! | library | order | side and frame | rotation unit |
//! |---|---|---|---|
//! | GTSAM `Pose3` | rotation, translation | right, body | rotation vector |
//! | GTSAM `Pose2` | as ours | as ours | as ours |
//! | g2o `EDGE_SE3:QUAT` | translation, rotation | right, body | vector part of the quaternion, **half** the angle |
//! | g2o `EDGE_SE2` | as ours | as ours | as ours |
//! | ROS `PoseWithCovariance` | translation, rotation | translation and rotation in the **parent** frame, not coupled | rotation vector about the parent's axes |
//! | ROS `TwistWithCovariance` | as ours | child frame, as ours | as ours |
//! | Barfoot, and other left perturbations | translation, rotation | **left**, world | rotation vector |
//!
//! Many writers of g2o files (and GTSAM's reader) treat the rotation block as one of rotation vectors, without
//! the factor two of g2o's own residual. Files do not tell; take the quaternion rule for files that g2o itself
//! optimises.

use nalgebra::{Isometry3, Matrix6, SMatrix};

use crate::check::check_finite;
use crate::cholesky::symmetrize;
use crate::{Error, LieGroup, transport};

/// `[rotation, translation]` to `[translation, rotation]` or back: swaps the two halves of rows and columns.
///
/// Its own inverse; the same for covariance and information.
#[inline]
fn swap_halves(m: &Matrix6<f64>) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| m[((i + 3) % 6, (j + 3) % 6)])
}

/// Covariance or information of GTSAM's `Pose3` (rotation first) to ours (translation first).
///
/// GTSAM perturbs on the right as we do, so this is a permutation and one rule serves both matrices.
pub fn from_gtsam_pose3(covariance_or_information: &Matrix6<f64>) -> Matrix6<f64> {
    swap_halves(covariance_or_information)
}

/// Covariance or information of ours (translation first) to GTSAM's `Pose3` (rotation first).
pub fn to_gtsam_pose3(covariance_or_information: &Matrix6<f64>) -> Matrix6<f64> {
    swap_halves(covariance_or_information)
}

/// `S m S` with `S = diag(1, 1, 1, scale, scale, scale)`.
fn scale_rotation(m: &Matrix6<f64>, scale: f64) -> Matrix6<f64> {
    let factor = |i: usize| if i < 3 { 1.0 } else { scale };
    Matrix6::from_fn(|i, j| m[(i, j)] * factor(i) * factor(j))
}

/// Information matrix of a g2o `EDGE_SE3:QUAT` line, whose residual is `[t, q_v]` of `z⁻¹ a⁻¹ b`, to ours.
///
/// Near zero `φ = 2 q_v`, so the rotation block is a quarter of g2o's and the mixed blocks are half.
pub fn from_g2o_quaternion_information(information: &Matrix6<f64>) -> Matrix6<f64> {
    scale_rotation(information, 0.5)
}

/// Information matrix of ours to that of a g2o `EDGE_SE3:QUAT` line.
pub fn to_g2o_quaternion_information(information: &Matrix6<f64>) -> Matrix6<f64> {
    scale_rotation(information, 2.0)
}

/// Covariance of g2o's residual `[t, q_v]` to ours: the rotation block is four times g2o's.
pub fn from_g2o_quaternion_covariance(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    scale_rotation(covariance, 2.0)
}

/// Covariance of ours to that of g2o's residual `[t, q_v]`.
pub fn to_g2o_quaternion_covariance(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    scale_rotation(covariance, 0.5)
}

/// `diag(R, R) m diag(R, R)ᵀ`.
fn rotate_both(r: &nalgebra::Matrix3<f64>, m: &Matrix6<f64>) -> Matrix6<f64> {
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(r);
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(r);
    symmetrize(&(turn * m * turn.transpose()))
}

/// Covariance of a ROS `geometry_msgs/PoseWithCovariance` to ours.
///
/// ROS gives `(x, y, z, rotation about X, Y, Z)` along the fixed axes of the parent frame, and the translation is
/// not turned by the rotation's error: `t' = t + δt`, `R' = exp(δφ) R`. Seen from the body both are turned by
/// `Rᵀ`; this is **not** the group's left perturbation, use [`from_left_covariance`] for that.
///
/// * `mean` – the message's pose.
/// * `row_major` – the message's `covariance` field as it stands.
///
/// # Errors
/// [`Error::NotFinite`], [`Error::NotUnit`].
pub fn from_ros_pose_covariance(mean: &Isometry3<f64>, row_major: &[f64; 36]) -> Result<Matrix6<f64>, Error> {
    mean.check()?;
    let m = Matrix6::from_row_slice(row_major);
    check_finite(&m, "the covariance")?;
    Ok(rotate_both(&mean.rotation.inverse().to_rotation_matrix().into_inner(), &m))
}

/// Covariance of ours to the field of a ROS `geometry_msgs/PoseWithCovariance`, row-major.
pub fn to_ros_pose_covariance(mean: &Isometry3<f64>, covariance: &Matrix6<f64>) -> [f64; 36] {
    let m = rotate_both(&mean.rotation.to_rotation_matrix().into_inner(), covariance);
    std::array::from_fn(|k| m[(k / 6, k % 6)])
}

/// Covariance of a left perturbation `exp(ξ) · mean` (world frame, as in Barfoot's book) to ours,
/// `mean · exp(ξ)`: `Ad(mean⁻¹) Σ Ad(mean⁻¹)ᵀ`. Order translation then rotation on both sides.
pub fn from_left_covariance<const N: usize, G: LieGroup<N>>(
    mean: &G,
    covariance: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    transport(&mean.inverse(), covariance)
}

/// Covariance of ours, `mean · exp(ξ)`, to that of the left perturbation `exp(ξ) · mean`:
/// `Ad(mean) Σ Ad(mean)ᵀ`.
pub fn to_left_covariance<const N: usize, G: LieGroup<N>>(
    mean: &G,
    covariance: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    transport(mean, covariance)
}

/// Information of a left perturbation to ours: `Ad(mean)ᵀ Λ Ad(mean)`.
pub fn from_left_information<const N: usize, G: LieGroup<N>>(
    mean: &G,
    information: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    let a = mean.adjoint();
    symmetrize(&(a.transpose() * information * a))
}

/// Information of ours to that of a left perturbation: `Ad(mean⁻¹)ᵀ Λ Ad(mean⁻¹)`.
pub fn to_left_information<const N: usize, G: LieGroup<N>>(
    mean: &G,
    information: &SMatrix<f64, N, N>,
) -> SMatrix<f64, N, N> {
    from_left_information(&mean.inverse(), information)
}

use draco_lie::LieGroup;
use nalgebra::{
    Isometry2, Isometry3, Matrix2, Matrix3, Matrix4, Quaternion, Rotation2, Rotation3, SMatrix, SVector,
    Translation2, Translation3, UnitComplex, UnitQuaternion, Vector2, Vector3, Vector4,
};

use crate::linalg::symmetric_eigen;

/// A rigid motion of `D`-dimensional points with an `N`-dimensional tangent space.
///
/// Implemented for `Isometry2<f64>` (`D = 2`, `N = 3`) and `Isometry3<f64>` (`D = 3`, `N = 6`), so that one
/// registration serves both. Tangent order is translation, then rotation.
pub trait RigidMotion<const D: usize, const N: usize>: LieGroup<N> {
    /// The rotation as a matrix.
    fn rotation_matrix(&self) -> SMatrix<f64, D, D>;

    /// The translation.
    fn translation_vector(&self) -> SVector<f64, D>;

    /// The motion with this rotation matrix and translation.
    fn from_matrix(rotation: &SMatrix<f64, D, D>, translation: &SVector<f64, D>) -> Self;

    /// `∂(exp([ρ, φ]) r)/∂[ρ, φ]` at zero: how a point at `r` moves under a small motion.
    fn point_jacobian(r: &SVector<f64, D>) -> SMatrix<f64, D, N>;

    /// `point_jacobian(r)ᵀ v`: a force `v` at `r` and its torque.
    fn wrench(r: &SVector<f64, D>, v: &SVector<f64, D>) -> SVector<f64, N>;

    /// `point_jacobian(r)ᵀ W point_jacobian(r)` for a symmetric `W`; only the upper triangle is filled.
    fn gram(r: &SVector<f64, D>, w: &SMatrix<f64, D, D>) -> SMatrix<f64, N, N>;

    /// Turns a tangent vector's axes: `[R ρ, R φ]` (`φ` stays in the plane).
    fn turn_tangent(rotation: &SMatrix<f64, D, D>) -> SMatrix<f64, N, N>;

    /// The rotation matrix that maximises `tr(Rᵀ C)` for `C = Σ w target sourceᵀ` (Kabsch), never a reflection.
    fn best_rotation(cross_covariance: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D>;

    /// The point moved.
    fn transform(&self, point: &SVector<f64, D>) -> SVector<f64, D> {
        self.rotation_matrix() * point + self.translation_vector()
    }

    /// The motion as a homogeneous matrix, row after row.
    fn to_row_major(&self) -> Vec<f64> {
        let (r, t) = (self.rotation_matrix(), self.translation_vector());
        let mut rows = Vec::with_capacity((D + 1) * (D + 1));
        for i in 0..D {
            rows.extend((0..D).map(|j| r[(i, j)]));
            rows.push(t[i]);
        }
        rows.extend(std::iter::repeat_n(0.0, D));
        rows.push(1.0);
        rows
    }
}

impl RigidMotion<2, 3> for Isometry2<f64> {
    fn rotation_matrix(&self) -> Matrix2<f64> {
        let (c, s) = (self.rotation.re, self.rotation.im);
        Matrix2::new(c, -s, s, c)
    }
    fn translation_vector(&self) -> Vector2<f64> {
        self.translation.vector
    }
    fn from_matrix(rotation: &Matrix2<f64>, translation: &Vector2<f64>) -> Self {
        let angle = (rotation[(1, 0)] - rotation[(0, 1)]).atan2(rotation[(0, 0)] + rotation[(1, 1)]);
        Isometry2::from_parts(Translation2::from(*translation), UnitComplex::new(angle))
    }
    #[inline]
    fn point_jacobian(r: &Vector2<f64>) -> SMatrix<f64, 2, 3> {
        SMatrix::<f64, 2, 3>::new(1.0, 0.0, -r.y, 0.0, 1.0, r.x)
    }
    #[inline]
    fn wrench(r: &Vector2<f64>, v: &Vector2<f64>) -> Vector3<f64> {
        Vector3::new(v.x, v.y, r.x * v.y - r.y * v.x)
    }
    #[inline]
    fn gram(r: &Vector2<f64>, w: &Matrix2<f64>) -> Matrix3<f64> {
        // the last column of W J: W applied to the quarter turn of r
        let b = Vector2::new(w.m12 * r.x - w.m11 * r.y, w.m22 * r.x - w.m12 * r.y);
        Matrix3::new(w.m11, w.m12, b.x, 0.0, w.m22, b.y, 0.0, 0.0, r.x * b.y - r.y * b.x)
    }
    fn turn_tangent(rotation: &Matrix2<f64>) -> Matrix3<f64> {
        let mut m = Matrix3::identity();
        m.fixed_view_mut::<2, 2>(0, 0).copy_from(rotation);
        m
    }
    fn best_rotation(c: &Matrix2<f64>) -> Matrix2<f64> {
        let angle = (c[(1, 0)] - c[(0, 1)]).atan2(c[(0, 0)] + c[(1, 1)]);
        Rotation2::new(angle).into_inner()
    }
}

impl RigidMotion<3, 6> for Isometry3<f64> {
    fn rotation_matrix(&self) -> Matrix3<f64> {
        self.rotation.to_rotation_matrix().into_inner()
    }
    fn translation_vector(&self) -> Vector3<f64> {
        self.translation.vector
    }
    fn from_matrix(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
        Isometry3::from_parts(Translation3::from(*translation), q)
    }
    #[inline]
    fn point_jacobian(r: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
        let mut j = SMatrix::<f64, 3, 6>::identity();
        (j[(0, 4)], j[(0, 5)]) = (r.z, -r.y);
        (j[(1, 3)], j[(1, 5)]) = (-r.z, r.x);
        (j[(2, 3)], j[(2, 4)]) = (r.y, -r.x);
        j
    }
    #[inline]
    fn wrench(r: &Vector3<f64>, v: &Vector3<f64>) -> SVector<f64, 6> {
        let t = r.cross(v);
        SVector::<f64, 6>::new(v.x, v.y, v.z, t.x, t.y, t.z)
    }
    #[inline]
    fn gram(r: &Vector3<f64>, w: &Matrix3<f64>) -> SMatrix<f64, 6, 6> {
        // the last three columns of W J: W applied to the cross products of the axes with r
        let (x, y, z) = (r.x, r.y, r.z);
        let b = [
            Vector3::new(w.m13 * y - w.m12 * z, w.m23 * y - w.m22 * z, w.m33 * y - w.m23 * z),
            Vector3::new(w.m11 * z - w.m13 * x, w.m12 * z - w.m23 * x, w.m13 * z - w.m33 * x),
            Vector3::new(w.m12 * x - w.m11 * y, w.m22 * x - w.m12 * y, w.m23 * x - w.m13 * y),
        ];
        let mut m = SMatrix::<f64, 6, 6>::zeros();
        (m[(0, 0)], m[(0, 1)], m[(0, 2)]) = (w.m11, w.m12, w.m13);
        (m[(1, 1)], m[(1, 2)], m[(2, 2)]) = (w.m22, w.m23, w.m33);
        for (k, column) in b.iter().enumerate() {
            (m[(0, 3 + k)], m[(1, 3 + k)], m[(2, 3 + k)]) = (column.x, column.y, column.z);
            m[(3, 3 + k)] = y * column.z - z * column.y;
            if k > 0 {
                m[(4, 3 + k)] = z * column.x - x * column.z;
            }
            if k > 1 {
                m[(5, 3 + k)] = x * column.y - y * column.x;
            }
        }
        m
    }
    fn turn_tangent(rotation: &Matrix3<f64>) -> SMatrix<f64, 6, 6> {
        let mut m = SMatrix::<f64, 6, 6>::zeros();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
        m.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
        m
    }
    fn best_rotation(c: &Matrix3<f64>) -> Matrix3<f64> {
        best_quaternion(c).to_rotation_matrix().into_inner()
    }
}

/// The unit quaternion of the rotation that maximises `tr(Rᵀ C)`; of several the one nearest to none.
///
/// **Source**: Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987: the eigenvector of
/// the largest eigenvalue of a symmetric matrix of four rows.
fn best_quaternion(c: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let s = c.transpose();
    let (a, b, d) = (s.m23 - s.m32, s.m31 - s.m13, s.m12 - s.m21);
    let (e, f, g) = (s.m12 + s.m21, s.m31 + s.m13, s.m23 + s.m32);
    let n = Matrix4::new(
        s.m11 + s.m22 + s.m33,
        a,
        b,
        d,
        a,
        s.m11 - s.m22 - s.m33,
        e,
        f,
        b,
        e,
        s.m22 - s.m11 - s.m33,
        g,
        d,
        f,
        g,
        s.m33 - s.m11 - s.m22,
    );
    let (values, vectors) = symmetric_eigen(&n);
    let near_top = values[3] - 1e-12 * values.amax();
    let best: Vector4<f64> =
        (0..4).filter(|&k| values[k] >= near_top).map(|k| vectors.column(k) * vectors[(0, k)]).sum();
    // all best ones turn by half a circle: any of them serves
    let q = best.try_normalize(1e-6).unwrap_or_else(|| vectors.column(3).into_owned());
    UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn check<const D: usize, const N: usize, G: RigidMotion<D, N>>(
        r: SVector<f64, D>,
        a: SMatrix<f64, D, D>,
    ) {
        let w = a + a.transpose();
        let j = G::point_jacobian(&r);
        let (expected, found) = (j.transpose() * w * j, G::gram(&r, &w));
        for (i, k) in (0..N).flat_map(|i| (i..N).map(move |k| (i, k))) {
            assert!((expected[(i, k)] - found[(i, k)]).abs() < 1e-12, "{i} {k}: {expected} {found}");
        }
    }

    proptest! {
        /// No rotation beats the answer: of a dense sample of them, and of small turns about it.
        #[test]
        fn best_rotation_is_the_best(
            v in prop::array::uniform9(-1.0..1.0f64),
            flat in prop_oneof![Just(0.0), Just(1e-9), Just(1e-3), Just(1.0)],
        ) {
            let m = Matrix3::from_row_slice(&v);
            let c = m * Matrix3::from_diagonal(&Vector3::new(1.0, flat, flat * flat)) * m.transpose() * m;
            let best = Isometry3::best_rotation(&c);
            prop_assert!((best.transpose() * best - Matrix3::identity()).norm() < 1e-12);
            prop_assert!(best.determinant() > 0.0);
            let value = (best.transpose() * c).trace();
            for k in 0..500 {
                let axis = Vector3::new((1.3 * f64::from(k)).sin(), (2.1 * f64::from(k)).cos(), (0.7 * f64::from(k)).sin());
                let turn = Rotation3::new(axis.normalize() * (0.37 * f64::from(k)).rem_euclid(6.3)).into_inner();
                let small = Rotation3::new(axis * 1e-3).into_inner();
                for other in [turn, small * best] {
                    prop_assert!((other.transpose() * c).trace() <= value + 1e-12 * c.norm());
                }
            }
        }

        #[test]
        fn gram_is_the_product_of_the_jacobians(v in prop::array::uniform12(-1.0..1.0f64)) {
            check::<2, 3, Isometry2<f64>>(Vector2::new(v[0], v[1]), Matrix2::from_row_slice(&v[2..6]));
            check::<3, 6, Isometry3<f64>>(Vector3::new(v[0], v[1], v[2]), Matrix3::from_row_slice(&v[3..12]));
        }
    }
}

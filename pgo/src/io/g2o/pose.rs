use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, Quaternion, Translation2, Translation3, UnitComplex, UnitQuaternion};

/// Poses that the g2o format knows.
pub trait G2oPose<const N: usize>: LieGroup<N> {
    /// Tag of a pose.
    const VERTEX: &'static str;
    /// Tag of a relative pose.
    const EDGE: &'static str;
    /// Tag of a measurement of a pose itself.
    const PRIOR: &'static str;
    /// Tag of a sensor offset, whose number follows the id of a prior; empty where priors have none.
    const OFFSET: &'static str;
    /// Numbers a pose takes.
    const NUMBERS: usize;
    /// The pose of its numbers in a file, or what is wrong with them.
    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str>;
    /// The numbers of a pose in a file; [`G2oPose::from_numbers`] of them gives the same bits again wherever
    /// the pose came from a file.
    fn to_numbers(&self) -> Vec<f64>;
}

impl G2oPose<3> for Isometry2<f64> {
    const VERTEX: &'static str = "VERTEX_SE2";
    const EDGE: &'static str = "EDGE_SE2";
    const PRIOR: &'static str = "EDGE_PRIOR_SE2";
    const OFFSET: &'static str = "";
    const NUMBERS: usize = 3;

    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str> {
        match numbers {
            [x, y, angle] => Ok(Isometry2::from_parts(Translation2::new(*x, *y), UnitComplex::new(*angle))),
            _ => Err("a pose in the plane takes 3 numbers"),
        }
    }

    fn to_numbers(&self) -> Vec<f64> {
        // the angle next to the arc tangent that gives back the same sine and cosine
        let near = self.rotation.angle();
        let steps = [0i64, 1, -1, 2, -2, 3, -3, 4, -4];
        let exact = steps
            .into_iter()
            .map(|step| f64::from_bits(near.to_bits().wrapping_add_signed(step)))
            .find(|angle| UnitComplex::new(*angle) == self.rotation);
        vec![self.translation.x, self.translation.y, exact.unwrap_or(near)]
    }
}

impl G2oPose<6> for Isometry3<f64> {
    const VERTEX: &'static str = "VERTEX_SE3:QUAT";
    const EDGE: &'static str = "EDGE_SE3:QUAT";
    const PRIOR: &'static str = "EDGE_SE3_PRIOR";
    const OFFSET: &'static str = "PARAMS_SE3OFFSET";
    const NUMBERS: usize = 7;

    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str> {
        let [x, y, z, i, j, k, w] = numbers else { return Err("a pose in space takes 7 numbers") };
        let q = Quaternion::new(*w, *i, *j, *k);
        let norm_sq = q.norm_squared();
        if norm_sq.is_nan() || norm_sq < 1e-12 {
            return Err("the quaternion is zero");
        }
        if norm_sq.is_infinite() {
            return Err("the quaternion is too large to normalise");
        }
        // normalising a unit quaternion again would change its last bits
        let rotation = if (norm_sq - 1.0).abs() <= 4.0 * f64::EPSILON {
            UnitQuaternion::new_unchecked(q)
        } else {
            UnitQuaternion::new_normalize(q)
        };
        Ok(Isometry3::from_parts(Translation3::new(*x, *y, *z), rotation))
    }

    fn to_numbers(&self) -> Vec<f64> {
        let (t, q) = (&self.translation, &self.rotation);
        vec![t.x, t.y, t.z, q.i, q.j, q.k, q.w]
    }
}

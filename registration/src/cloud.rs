use nalgebra::{SMatrix, SVector};

use crate::Error;
use crate::kd_tree::KdTree;
use crate::linalg::symmetric_eigen;
use crate::normals;

/// Finite points in `D` dimensions with optional normals and covariances.
///
/// Points are metres in one frame, usually the sensor's.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cloud<const D: usize> {
    points: Vec<SVector<f64, D>>,
    normals: Option<Vec<SVector<f64, D>>>,
    covariances: Option<Vec<SMatrix<f64, D, D>>>,
}

impl<const D: usize> Cloud<D> {
    /// A cloud of these points.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`] for the first point with a NaN or infinite coordinate.
    pub fn new(points: Vec<SVector<f64, D>>) -> Result<Self, Error> {
        match points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            Some(index) => Err(Error::NonFinitePoint { index }),
            None => Ok(Self { points, normals: None, covariances: None }),
        }
    }

    /// The same cloud with these unit normals, one a point.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] or [`Error::NonFinite`].
    pub fn with_normals(mut self, normals: Vec<SVector<f64, D>>) -> Result<Self, Error> {
        if normals.len() != self.points.len() {
            return Err(Error::LengthMismatch {
                what: "normals",
                found: normals.len(),
                expected: self.points.len(),
            });
        }
        if normals.iter().any(|n| !n.iter().all(|v| v.is_finite())) {
            return Err(Error::NonFinite { what: "a normal" });
        }
        self.normals = Some(normals);
        Ok(self)
    }

    /// The same cloud with normals from the `neighbors` nearest points (the point itself included), turned
    /// towards `viewpoint` (the sensor, in the frame of the points).
    ///
    /// A point with fewer than `D` distinct neighbours gets the direction to the viewpoint.
    ///
    /// # Errors
    /// [`Error::Parameter`] when `neighbors` is smaller than `D`.
    pub fn estimate_normals(mut self, neighbors: usize, viewpoint: &SVector<f64, D>) -> Result<Self, Error> {
        let tree = KdTree::new(&self.points)?;
        self.normals = Some(normals::estimate(&self.points, &tree, neighbors, viewpoint)?);
        Ok(self)
    }

    /// The same cloud with these covariances of the points, m², in the axes of the points, one a point; see
    /// [`crate::RangeBearingNoise`] for those of a sonar.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::NonFinite`], or [`Error::NotPositiveDefinite`].
    pub fn with_covariances(mut self, covariances: Vec<SMatrix<f64, D, D>>) -> Result<Self, Error> {
        if covariances.len() != self.points.len() {
            return Err(Error::LengthMismatch {
                what: "covariances",
                found: covariances.len(),
                expected: self.points.len(),
            });
        }
        for covariance in &covariances {
            if !covariance.iter().all(|v| v.is_finite()) {
                return Err(Error::NonFinite { what: "a covariance of a point" });
            }
            let asymmetry = (covariance - covariance.transpose()).norm();
            if asymmetry > 1e-9 * covariance.norm() || symmetric_eigen(covariance).0[0] <= 0.0 {
                return Err(Error::NotPositiveDefinite { what: "a covariance of a point" });
            }
        }
        self.covariances = Some(covariances);
        Ok(self)
    }

    /// The same cloud with covariances from the `neighbors` nearest points (the point itself included): their
    /// scatter about their mean, and `noise`² (metres) along every axis.
    ///
    /// # Errors
    /// [`Error::Parameter`] when `neighbors` is smaller than 2 or `noise` is not positive.
    pub fn estimate_covariances(mut self, neighbors: usize, noise: f64) -> Result<Self, Error> {
        let tree = KdTree::new(&self.points)?;
        self.covariances = Some(normals::covariances(&self.points, &tree, neighbors, noise)?);
        Ok(self)
    }

    /// The points.
    pub fn points(&self) -> &[SVector<f64, D>] {
        &self.points
    }

    /// The unit normals, one a point, if there are any.
    pub fn normals(&self) -> Option<&[SVector<f64, D>]> {
        self.normals.as_deref()
    }

    /// The covariances of the points, m², if there are any.
    pub fn covariances(&self) -> Option<&[SMatrix<f64, D, D>]> {
        self.covariances.as_deref()
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

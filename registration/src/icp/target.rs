use nalgebra::{SMatrix, SVector};

use crate::cloud::Cloud;
use crate::error::check;
use crate::kd_tree::KdTree;
use crate::motion::RigidMotion;
use crate::{Error, IcpParams, Registration};

/// A cloud made ready to be aligned to: centred, with its tree.
///
/// Build it once and align many sources to it.
#[derive(Debug, Clone)]
pub struct Target<const D: usize> {
    /// Mean of the points; everything inside is relative to it, so that large coordinates cost no digits.
    pub(crate) origin: SVector<f64, D>,
    pub(crate) tree: KdTree<D>,
    /// Normals in tree order.
    pub(crate) normals: Option<Vec<SVector<f64, D>>>,
    /// Covariances of the points in tree order.
    pub(crate) covariances: Option<Vec<SMatrix<f64, D, D>>>,
}

/// Shares of points that have a partner in the other cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// Share of the source points with a target point within the radius.
    pub source: f64,
    /// Share of the target points with a source point within the radius.
    pub target: f64,
}

impl Overlap {
    /// The smaller share.
    pub fn symmetric(&self) -> f64 {
        self.source.min(self.target)
    }
}

impl<const D: usize> Target<D> {
    /// Prepares a cloud.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for an empty cloud.
    pub fn new(cloud: &Cloud<D>) -> Result<Self, Error> {
        if cloud.is_empty() {
            return Err(Error::TooFewPoints { what: "the target", found: 0, needed: 1 });
        }
        let (origin, centred) = centre(cloud.points());
        let tree = KdTree::new(&centred)?;
        let normals = cloud.normals().map(|n| tree.order().iter().map(|&i| n[i as usize]).collect());
        let covariances = cloud.covariances().map(|c| tree.order().iter().map(|&i| c[i as usize]).collect());
        Ok(Self { origin, tree, normals, covariances })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// Always `false`: an empty cloud cannot be a target.
    pub fn is_empty(&self) -> bool {
        self.tree.is_empty()
    }

    /// Aligns `source` to this target by ICP.
    ///
    /// * `initial` – `target_from_source` to start from.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for an empty source, [`Error::MissingNormals`] or [`Error::MissingCovariances`] when
    /// the residual or a rejector needs what a cloud does not have, [`Error::Parameter`], [`Error::NonFinite`] for a start pose with
    /// NaN.
    pub fn align<const N: usize, G: RigidMotion<D, N>>(
        &self,
        source: &Cloud<D>,
        initial: &G,
        params: &IcpParams,
    ) -> Result<Registration<G, N>, Error> {
        super::align::align(self, source, initial, params)
    }

    /// Shares of the points of both clouds with a partner within `radius` metres at this pose.
    ///
    /// # Errors
    /// [`Error::Parameter`], [`Error::TooFewPoints`] for an empty source.
    pub fn overlap<const N: usize, G: RigidMotion<D, N>>(
        &self,
        source: &Cloud<D>,
        target_from_source: &G,
        radius: f64,
    ) -> Result<Overlap, Error> {
        check("radius", radius, radius > 0.0 && radius.is_finite(), "more than 0")?;
        if source.is_empty() {
            return Err(Error::TooFewPoints { what: "the source", found: 0, needed: 1 });
        }
        let (r, t) = (target_from_source.rotation_matrix(), target_from_source.translation_vector());
        let moved: Vec<_> = source.points().iter().map(|p| r * p + t - self.origin).collect();
        let near = |tree: &KdTree<D>, p| tree.nearest_within(p, radius).is_some();
        let source_tree = KdTree::new(&moved)?;
        let hits = moved.iter().filter(|p| near(&self.tree, p)).count();
        let back = (0..self.len()).filter(|&i| near(&source_tree, self.tree.point_at(i))).count();
        Ok(Overlap { source: hits as f64 / moved.len() as f64, target: back as f64 / self.len() as f64 })
    }
}

/// The mean of the points, and the points relative to it.
pub(crate) fn centre<const D: usize>(points: &[SVector<f64, D>]) -> (SVector<f64, D>, Vec<SVector<f64, D>>) {
    let first = points.first().copied().unwrap_or_else(SVector::zeros);
    // summed about the first point: the sum of coordinates far from zero would lose digits
    let mean = first + points.iter().map(|p| p - first).sum::<SVector<f64, D>>() / points.len().max(1) as f64;
    (mean, points.iter().map(|p| p - mean).collect())
}

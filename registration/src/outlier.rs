use nalgebra::SVector;

use crate::Error;
use crate::error::check;
use crate::kd_tree::KdTree;

/// Indices of the points that have at least `min_neighbors` other points within `radius` metres, in order.
///
/// # Errors
/// [`Error::Parameter`], [`Error::NonFinitePoint`].
pub fn radius_outlier_indices<const D: usize>(
    points: &[SVector<f64, D>],
    radius: f64,
    min_neighbors: usize,
) -> Result<Vec<usize>, Error> {
    check("radius", radius, radius >= 0.0 && radius.is_finite(), "0 or more")?;
    let tree = KdTree::new(points)?;
    let enough = min_neighbors + 1; // a point finds itself
    Ok((0..points.len()).filter(|&i| tree.count_within(&points[i], radius, enough) >= enough).collect())
}

/// The points that have at least `min_neighbors` other points within `radius` metres.
///
/// # Errors
/// [`Error::Parameter`], [`Error::NonFinitePoint`].
///
/// ```
/// use nalgebra::Vector2;
/// let points = [Vector2::new(0.0, 0.0), Vector2::new(0.3, 0.0), Vector2::new(9.0, 9.0)];
/// assert_eq!(draco_registration::radius_outlier_filter(&points, 1.0, 1)?, points[..2]);
/// # Ok::<(), draco_registration::Error>(())
/// ```
pub fn radius_outlier_filter<const D: usize>(
    points: &[SVector<f64, D>],
    radius: f64,
    min_neighbors: usize,
) -> Result<Vec<SVector<f64, D>>, Error> {
    Ok(radius_outlier_indices(points, radius, min_neighbors)?.into_iter().map(|i| points[i]).collect())
}

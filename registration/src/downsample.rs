use nalgebra::SVector;

use crate::Error;
use crate::error::check;

/// Indices of one real point per occupied cell of a grid: the medoid, which lies nearest to the mean of the
/// cell's points (ties to the lower index).
///
/// * `cell` – edge of the cubic cells, metres, more than 0. Cells are aligned with the origin.
///
/// The indices come in the order of the cells, row after row. Cost O(n log n).
///
/// # Errors
/// [`Error::Parameter`], [`Error::NonFinitePoint`].
pub fn medoid_indices<const D: usize>(points: &[SVector<f64, D>], cell: f64) -> Result<Vec<usize>, Error> {
    let mut kept = Vec::new();
    for_each_cell(points, cell, |members| {
        let mean = mean_of(points, members);
        let medoid = members.iter().map(|(_, i)| *i as usize).min_by(|&a, &b| {
            let (da, db) = ((points[a] - mean).norm_squared(), (points[b] - mean).norm_squared());
            da.total_cmp(&db).then(a.cmp(&b))
        });
        kept.extend(medoid);
    })?;
    Ok(kept)
}

/// One real point per occupied cell: see [`medoid_indices`].
///
/// # Errors
/// [`Error::Parameter`], [`Error::NonFinitePoint`].
///
/// ```
/// use nalgebra::Vector2;
/// let points = [Vector2::new(0.1, 0.1), Vector2::new(0.2, 0.2), Vector2::new(0.4, 0.4), Vector2::new(7.0, 0.0)];
/// let kept = draco_registration::medoid_downsample(&points, 0.5)?;
/// assert_eq!(kept, [points[1], points[3]]);
/// # Ok::<(), draco_registration::Error>(())
/// ```
pub fn medoid_downsample<const D: usize>(
    points: &[SVector<f64, D>],
    cell: f64,
) -> Result<Vec<SVector<f64, D>>, Error> {
    Ok(medoid_indices(points, cell)?.into_iter().map(|i| points[i]).collect())
}

/// The mean of the points of each occupied cell; less noisy than the medoid, but not a measured point.
///
/// # Errors
/// [`Error::Parameter`], [`Error::NonFinitePoint`].
pub fn mean_downsample<const D: usize>(
    points: &[SVector<f64, D>],
    cell: f64,
) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut kept = Vec::new();
    for_each_cell(points, cell, |members| kept.push(mean_of(points, members)))?;
    Ok(kept)
}

fn mean_of<const D: usize>(points: &[SVector<f64, D>], members: &[([i64; D], u32)]) -> SVector<f64, D> {
    let sum: SVector<f64, D> = members.iter().map(|(_, i)| points[*i as usize]).sum();
    sum / members.len() as f64
}

fn for_each_cell<const D: usize>(
    points: &[SVector<f64, D>],
    cell: f64,
    mut visit: impl FnMut(&[([i64; D], u32)]),
) -> Result<(), Error> {
    check("cell", cell, cell > 0.0 && cell.is_finite(), "more than 0")?;
    if let Some(index) = points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(Error::NonFinitePoint { index });
    }
    let inverse = 1.0 / cell;
    let mut keyed: Vec<([i64; D], u32)> = points
        .iter()
        .zip(0u32..)
        .map(|(p, i)| (std::array::from_fn(|a| (p[a] * inverse).floor() as i64), i))
        .collect();
    keyed.sort_unstable();
    for members in keyed.chunk_by(|a, b| a.0 == b.0) {
        visit(members);
    }
    Ok(())
}

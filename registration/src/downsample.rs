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
        let medoid = members.iter().map(|i| *i as usize).min_by(|&a, &b| {
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

fn mean_of<const D: usize>(points: &[SVector<f64, D>], members: &[u32]) -> SVector<f64, D> {
    let sum: SVector<f64, D> = members.iter().map(|i| points[*i as usize]).sum();
    sum / members.len() as f64
}

fn for_each_cell<const D: usize>(
    points: &[SVector<f64, D>],
    cell: f64,
    visit: impl FnMut(&[u32]),
) -> Result<(), Error> {
    check("cell", cell, cell > 0.0 && cell.is_finite(), "more than 0")?;
    if let Some(index) = points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(Error::NonFinitePoint { index });
    }
    let inverse = 1.0 / cell;
    let cell_of =
        |p: &SVector<f64, D>| -> [i64; D] { std::array::from_fn(|a| (p[a] * inverse).floor() as i64) };
    match packing(points, cell_of) {
        Some((low, counts)) => {
            // one number a cell in the order of the arrays: sorts several times as fast
            let key = |c: [i64; D]| (0..D).fold(0u64, |k, a| k * counts[a] + c[a].abs_diff(low[a]));
            visit_groups(points, |p| key(cell_of(p)), visit);
        }
        None => visit_groups(points, cell_of, visit),
    }
    Ok(())
}

/// The lowest cell and the number of cells along each axis, if all cells can be numbered.
fn packing<const D: usize>(
    points: &[SVector<f64, D>],
    cell_of: impl Fn(&SVector<f64, D>) -> [i64; D],
) -> Option<([i64; D], [u64; D])> {
    let (mut low, mut high) = ([i64::MAX; D], [i64::MIN; D]);
    for cell in points.iter().map(cell_of) {
        for axis in 0..D {
            low[axis] = low[axis].min(cell[axis]);
            high[axis] = high[axis].max(cell[axis]);
        }
    }
    if points.is_empty() {
        return None;
    }
    let counts: [u64; D] = std::array::from_fn(|a| high[a].abs_diff(low[a]).saturating_add(1));
    counts.iter().try_fold(1u64, |total, count| total.checked_mul(*count))?;
    Some((low, counts))
}

fn visit_groups<const D: usize, K: Ord + Copy>(
    points: &[SVector<f64, D>],
    key: impl Fn(&SVector<f64, D>) -> K,
    mut visit: impl FnMut(&[u32]),
) {
    let mut keyed: Vec<(K, u32)> = points.iter().zip(0u32..).map(|(p, i)| (key(p), i)).collect();
    keyed.sort_unstable();
    let mut members = Vec::new();
    for group in keyed.chunk_by(|a, b| a.0 == b.0) {
        members.clear();
        members.extend(group.iter().map(|(_, index)| *index));
        visit(&members);
    }
}

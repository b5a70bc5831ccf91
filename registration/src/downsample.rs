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

/// The largest whole number not above `value`; the processor's own cut is towards zero.
fn floor(value: f64) -> i64 {
    let cut = value as i64;
    cut.saturating_sub(i64::from((cut as f64) > value))
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
    let cell_of = |p: &SVector<f64, D>| -> [i64; D] { std::array::from_fn(|a| floor(p[a] * inverse)) };
    let cells: Vec<[i64; D]> = points.iter().map(cell_of).collect();
    match packing(&cells) {
        Some((low, counts)) => {
            // one number a cell in the order of the arrays: sorts several times as fast
            let key = |c: [i64; D]| (0..D).fold(0u64, |k, a| k * counts[a] + c[a].abs_diff(low[a]));
            let mut keyed: Vec<(u64, u32)> = cells.iter().map(|c| key(*c)).zip(0u32..).collect();
            radix_sort(&mut keyed, counts.iter().product());
            visit_groups(&keyed, visit);
        }
        None => {
            let mut keyed: Vec<([i64; D], u32)> = cells.into_iter().zip(0u32..).collect();
            keyed.sort_unstable();
            visit_groups(&keyed, visit);
        }
    }
    Ok(())
}

/// Sorts by key, all keys being below `limit`, and keeps the order of equal ones: digit after digit, the lowest first.
pub(crate) fn radix_sort(items: &mut Vec<(u64, u32)>, limit: u64) {
    const BITS: u32 = 11;
    if items.len() < 1 << BITS {
        return items.sort_unstable();
    }
    let digit = |key: u64, shift: u32| (key >> shift) as usize & ((1 << BITS) - 1);
    let mut other = vec![(0, 0); items.len()];
    let mut shift = 0;
    while shift < u64::BITS && limit >> shift > 0 {
        let mut places = [0usize; 1 << BITS];
        items.iter().for_each(|item| places[digit(item.0, shift)] += 1);
        let mut begin = 0;
        for place in &mut places {
            begin += std::mem::replace(place, begin);
        }
        for item in items.iter() {
            let place = &mut places[digit(item.0, shift)];
            other[*place] = *item;
            *place += 1;
        }
        std::mem::swap(items, &mut other);
        shift += BITS;
    }
}

/// The lowest cell and the number of cells along each axis, if all cells can be numbered.
fn packing<const D: usize>(cells: &[[i64; D]]) -> Option<([i64; D], [u64; D])> {
    let (mut low, mut high) = ([i64::MAX; D], [i64::MIN; D]);
    for cell in cells {
        for axis in 0..D {
            low[axis] = low[axis].min(cell[axis]);
            high[axis] = high[axis].max(cell[axis]);
        }
    }
    if cells.is_empty() {
        return None;
    }
    let counts: [u64; D] = std::array::from_fn(|a| high[a].abs_diff(low[a]).saturating_add(1));
    counts.iter().try_fold(1u64, |total, count| total.checked_mul(*count))?;
    Some((low, counts))
}

fn visit_groups<K: PartialEq>(keyed: &[(K, u32)], mut visit: impl FnMut(&[u32])) {
    let mut members = Vec::new();
    for group in keyed.chunk_by(|a, b| a.0 == b.0) {
        members.clear();
        members.extend(group.iter().map(|(_, index)| *index));
        visit(&members);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn radix_sort_sorts(mut keys in prop::collection::vec(any::<u64>(), 0..5000), shift in 0u32..64) {
            keys.iter_mut().for_each(|k| *k >>= shift);
            let mut items: Vec<(u64, u32)> = keys.into_iter().zip(0..).collect();
            let mut expected = items.clone();
            expected.sort();
            let limit = items.iter().map(|i| i.0).max().unwrap_or(0).saturating_add(1);
            radix_sort(&mut items, limit);
            prop_assert_eq!(items, expected);
        }
    }
}

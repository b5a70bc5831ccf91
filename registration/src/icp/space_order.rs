use nalgebra::SVector;

use crate::downsample::radix_sort;

/// Fewer points are left as they come: a scan is in order of angle, and sorting would cost more than it saves.
const FEWEST: usize = 2048;

/// Bits of a coordinate.
const BITS: u32 = 8;

/// Indices of the points so that neighbours in the order lie close together: along the Z-curve of a grid of 256 cells a
/// side.
pub(super) fn space_order<const D: usize>(points: &[SVector<f64, D>]) -> Vec<u32> {
    let in_turn = || (0..points.len() as u32).collect();
    let Some(first) = points.first() else { return Vec::new() };
    if points.len() < FEWEST || D as u32 * BITS > u64::BITS {
        return in_turn();
    }
    let (mut low, mut high) = (*first, *first);
    for point in points {
        (low, high) = (low.inf(point), high.sup(point));
    }
    let cells = f64::from((1u32 << BITS) - 1);
    let per_metre = cells / (high - low).amax().max(f64::MIN_POSITIVE);
    let spread: [u64; 1 << BITS] =
        std::array::from_fn(|cell| (0..BITS).map(|b| (cell as u64 >> b & 1) << (b * D as u32)).sum());
    let key = |p: &SVector<f64, D>| {
        (0..D).map(|axis| spread[((p[axis] - low[axis]) * per_metre) as u8 as usize] << axis).sum::<u64>()
    };
    let mut keyed: Vec<(u64, u32)> = points.iter().zip(0u32..).map(|(p, index)| (key(p), index)).collect();
    radix_sort(&mut keyed, 1 << (D as u32 * BITS - 1));
    keyed.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn neighbours_in_the_order_are_near_and_none_is_lost() {
        // a lattice in an order that jumps about
        let side = 16;
        let count = side * side * side;
        let at =
            |i: usize| Vector3::new((i % side) as f64, (i / side % side) as f64, (i / side / side) as f64);
        let points: Vec<_> = (0..count).map(|i| at(i * 1789 % count)).collect();
        let order = space_order(&points);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().zip(0u32..).all(|(a, b)| *a == b));
        let jump = |order: &[u32]| {
            order.windows(2).map(|w| (points[w[0] as usize] - points[w[1] as usize]).norm()).sum::<f64>()
                / count as f64
        };
        assert!(jump(&order) < 2.0, "{}", jump(&order));
        assert!(jump(&(0..count as u32).collect::<Vec<_>>()) > 5.0);
    }
}

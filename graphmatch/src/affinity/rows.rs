use super::banded::Banded;
use crate::lanes::LANES;

/// Rows of a small matrix, eight of like length side by side, so that a product only reads: edge by edge it would write four
/// places for each value.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Pairs, those with most entries first.
    order: Vec<u16>,
    /// Entries of rows `order[8 k..8 k + 8]` are `start[k]..start[k + 1]`.
    start: Vec<usize>,
    column: Vec<[u16; LANES]>,
    value: Vec<[f64; LANES]>,
}

/// Pairs, at most; a power of two. Larger matrices outgrow the cache.
const PAIRS: usize = 4096;
/// Entries, at most.
const ENTRIES: usize = 1 << 18;

impl Rows {
    /// `None` if the matrix is large.
    pub(super) fn new(banded: &Banded, columns: usize, weights: &[f64]) -> Option<Self> {
        if weights.len() > PAIRS || 4 * banded.stored() > ENTRIES {
            return None;
        }
        let mut length = vec![0_usize; weights.len()];
        banded.for_each(columns, |p, q, _| {
            // Of what is ruled out nothing is stored.
            let counts = usize::from((weights[p] > 0.0) & (weights[q] > 0.0));
            length[p] += counts;
            length[q] += counts;
        });
        let mut order: Vec<usize> = (0..weights.len()).collect();
        order.sort_by_key(|&p| std::cmp::Reverse(length[p]));
        let mut start = vec![0];
        // Of each row's next entry, lanes and all.
        let mut place = vec![0_u32; weights.len()];
        for rows in order.chunks(LANES) {
            let from = start[start.len() - 1];
            rows.iter().enumerate().for_each(|(lane, &p)| place[p] = (from * LANES + lane) as u32);
            start.push(from + length[rows[0]]);
        }
        let entries = start[start.len() - 1];
        let (mut column, mut value) = (vec![[0; LANES]; entries], vec![[0.0; LANES]; entries]);
        let (columns_flat, values_flat) = (column.as_flattened_mut(), value.as_flattened_mut());
        banded.for_each(columns, |p, q, v| {
            if (weights[p] > 0.0) & (weights[q] > 0.0) {
                for (p, q) in [(p, q), (q, p)] {
                    let at = place[p] as usize;
                    columns_flat[at] = q as u16;
                    values_flat[at] = v * weights[p] * weights[q];
                    place[p] += LANES as u32;
                }
            }
        });
        let order = order.into_iter().map(|p| p as u16).collect();
        Some(Self { order, start, column, value })
    }

    /// `y = S x`.
    #[inline(always)]
    pub(super) fn multiply(&self, x: &[f64], y: &mut [f64]) {
        // A table of half the size leaves the cache to the entries.
        if x.len() <= PAIRS / 2 {
            self.multiply_padded::<{ PAIRS / 2 }>(x, y);
        } else {
            self.multiply_padded::<PAIRS>(x, y);
        }
    }

    /// The product with `x` padded to `SIZE`, a power of two.
    #[inline(always)]
    fn multiply_padded<const SIZE: usize>(&self, x: &[f64], y: &mut [f64]) {
        let mut padded = [0.0; SIZE];
        padded[..x.len()].copy_from_slice(x);
        for (k, rows) in self.order.chunks(LANES).enumerate() {
            let run = self.start[k]..self.start[k + 1];
            let mut sums = [0.0; LANES];
            for (column, value) in self.column[run.clone()].iter().zip(&self.value[run]) {
                // Below `SIZE` as it is: this spares the check. All are read before any is summed, so that the machine's
                // instruction for scattered reads serves where it has one.
                let mut gathered = [0.0; LANES];
                for lane in 0..LANES {
                    gathered[lane] = padded[usize::from(column[lane]) % SIZE];
                }
                for lane in 0..LANES {
                    sums[lane] += value[lane] * gathered[lane];
                }
            }
            for (&p, sum) in rows.iter().zip(sums) {
                y[usize::from(p)] = sum;
            }
        }
    }
}

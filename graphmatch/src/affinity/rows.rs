use super::banded::Banded;

/// Rows of a small matrix, four of like length side by side, so that a product only reads: edge by edge it would write four
/// places for each value.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Pairs, those with most entries first, filled up to fours.
    order: Vec<u16>,
    /// Entries of rows `order[4 k..4 k + 4]` are `start[k]..start[k + 1]`.
    start: Vec<usize>,
    /// Columns of four entries, sixteen bits each.
    column: Vec<u64>,
    value: Vec<[f64; 4]>,
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
        banded.for_each(columns, |p, _, _| length[p] += 1);
        let mut order: Vec<usize> = (0..weights.len()).collect();
        order.sort_by_key(|&p| std::cmp::Reverse(length[p]));
        let mut start = vec![0];
        let mut place = vec![(0_usize, 0_usize); weights.len()];
        for four in order.chunks(4) {
            let from = start[start.len() - 1];
            four.iter().enumerate().for_each(|(lane, &p)| place[p] = (from, lane));
            // Even, for two sums.
            start.push(from + length[four[0]].next_multiple_of(2));
        }
        let entries = start[start.len() - 1];
        let (mut column, mut value) = (vec![0; entries], vec![[0.0; 4]; entries]);
        banded.for_each(columns, |p, q, v| {
            let (at, lane) = &mut place[p];
            column[*at] |= (q as u64) << (16 * *lane);
            value[*at][*lane] = v * weights[p] * weights[q];
            *at += 1;
        });
        let order = order.into_iter().map(|p| p as u16).collect();
        Some(Self { order, start, column, value })
    }

    /// `y = S x`.
    #[inline(always)]
    pub(super) fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let mut padded = [0.0; PAIRS];
        padded[..x.len()].copy_from_slice(x);
        for (k, four) in self.order.chunks(4).enumerate() {
            let run = self.start[k]..self.start[k + 1];
            let (columns, values) = (&self.column[run.clone()], &self.value[run]);
            // Two sums a row, as one would wait for itself.
            let mut sums = [[0.0; 4]; 2];
            for (columns, values) in columns.chunks_exact(2).zip(values.chunks_exact(2)) {
                for (sums, (&column, value)) in sums.iter_mut().zip(columns.iter().zip(values)) {
                    for lane in 0..4 {
                        // Below `PAIRS` as it is: this spares the check.
                        sums[lane] += value[lane] * padded[(column >> (16 * lane)) as usize % PAIRS];
                    }
                }
            }
            let [even, odd] = sums;
            for ((&p, even), odd) in four.iter().zip(even).zip(odd) {
                y[p as usize] = even + odd;
            }
        }
    }
}

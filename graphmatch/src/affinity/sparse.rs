use nalgebra::DMatrix;

use super::AffinityParams;

/// Rows of the pairs that the attributes admit; upper triangle.
#[derive(Debug, Clone)]
pub(super) struct Sparse {
    /// Admitted pairs, ascending.
    pairs: Vec<u32>,
    /// Entries of pair `k` are `start[k]..start[k + 1]`, their columns index `pairs` and exceed `k`.
    start: Vec<usize>,
    column: Vec<u32>,
    value: Vec<f64>,
}

impl Sparse {
    pub(super) fn new(
        lengths1: &DMatrix<f64>,
        lengths2: &DMatrix<f64>,
        weights: &[f64],
        params: &AffinityParams,
    ) -> Self {
        let columns = lengths2.nrows();
        let reach = params.kernel.reach();
        let pairs: Vec<u32> = (0..weights.len() as u32).filter(|&p| weights[p as usize] > 0.0).collect();
        let ends: Vec<(usize, usize)> =
            pairs.iter().map(|&p| (p as usize / columns, p as usize % columns)).collect();
        let (mut start, mut column, mut value) = (vec![0], Vec::new(), Vec::new());
        for (k, &(i, a)) in ends.iter().enumerate() {
            let (from1, from2) = (lengths1.column(i), lengths2.column(a));
            for (l, &(j, b)) in ends.iter().enumerate().skip(k + 1) {
                let (d1, d2) = (from1[j], from2[b]);
                // A pair sharing one object has one length 0 and passes only if the other is within reach of it.
                let close = (d1 - d2).abs() <= reach && d1.min(d2) >= params.min_edge;
                if close && i != j && a != b {
                    let weight = weights[pairs[k] as usize] * weights[pairs[l] as usize];
                    column.push(l as u32);
                    value.push(params.kernel.value(d1 - d2) * weight);
                }
            }
            start.push(column.len());
        }
        Self { pairs, start, column, value }
    }

    pub(super) fn stored(&self) -> usize {
        self.value.len()
    }

    pub(super) fn drop_exact_ones(
        &mut self,
        lengths1: &DMatrix<f64>,
        lengths2: &DMatrix<f64>,
        columns: usize,
    ) {
        let ends = |k: usize| (self.pairs[k] as usize / columns, self.pairs[k] as usize % columns);
        for k in 0..self.pairs.len() {
            let (i, a) = ends(k);
            for e in self.start[k]..self.start[k + 1] {
                let (j, b) = ends(self.column[e] as usize);
                if lengths1[(i, j)] == lengths2[(a, b)] {
                    self.value[e] = 0.0;
                }
            }
        }
    }

    pub(super) fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let packed: Vec<f64> = self.pairs.iter().map(|&p| x[p as usize]).collect();
        let mut result = vec![0.0; packed.len()];
        for k in 0..packed.len() {
            let (own, mut sum) = (packed[k], 0.0);
            let run = self.start[k]..self.start[k + 1];
            for (&l, &v) in self.column[run.clone()].iter().zip(&self.value[run]) {
                sum += v * packed[l as usize];
                result[l as usize] += v * own;
            }
            result[k] += sum;
        }
        y.fill(0.0);
        for (&p, r) in self.pairs.iter().zip(result) {
            y[p as usize] = r;
        }
    }
}

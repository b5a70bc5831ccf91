use nalgebra::DMatrix;

use pulp::{Arch, NullaryFnOnce};

use super::{AffinityParams, Kernel};
use crate::lanes::{LANES, Lanes};

/// Kernel values along runs of edges of map 2, one run for each edge of map 1.
#[derive(Debug, Clone)]
pub(super) struct Banded {
    /// Ends of the edges of either map, shortest first.
    edges1: Vec<Edge>,
    edges2: Vec<Edge>,
    /// First partner of each edge of map 1, and where its values start (one more than edges, the last the total).
    first: Vec<u32>,
    start: Vec<usize>,
    values: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Edge {
    length: f64,
    ends: [u32; 2],
}

impl Banded {
    pub(super) fn new(lengths1: &DMatrix<f64>, lengths2: &DMatrix<f64>, params: &AffinityParams) -> Self {
        let (edges1, edges2) = (edges(lengths1, params.min_edge), edges(lengths2, params.min_edge));
        let reach = params.kernel.reach();
        let (mut first, mut start) = (Vec::new(), vec![0]);
        let (mut low, mut high) = (0, 0);
        for edge in &edges1 {
            while low < edges2.len() && edges2[low].length < edge.length - reach {
                low += 1;
            }
            high = high.max(low);
            while high < edges2.len() && edges2[high].length <= edge.length + reach {
                high += 1;
            }
            first.push(low as u32);
            start.push(start[start.len() - 1] + high - low);
        }
        let mut values = vec![0.0; start[start.len() - 1]];
        let lengths = |edges: &[Edge]| -> Vec<f64> { edges.iter().map(|e| e.length).collect() };
        Arch::new().dispatch(Values {
            kernel: params.kernel,
            lengths1: &lengths(&edges1),
            lengths2: &lengths(&edges2),
            first: &first,
            start: &start,
            values: &mut values,
        });
        Self { edges1, edges2, first, start, values }
    }

    pub(super) fn stored(&self) -> usize {
        self.values.len()
    }

    /// Calls `visit` with row, column and value of every entry, without the weights of pairs; of an entry and its mirror image once.
    pub(super) fn for_each(&self, columns: usize, mut visit: impl FnMut(usize, usize, f64)) {
        for (k, edge) in self.edges1.iter().enumerate() {
            let [i, j] = edge.ends.map(|e| e as usize * columns);
            let partners = &self.edges2[self.first[k] as usize..];
            for (value, partner) in self.values[self.start[k]..self.start[k + 1]].iter().zip(partners) {
                let [a, b] = partner.ends.map(|e| e as usize);
                for (p, q) in [(i + a, j + b), (i + b, j + a)] {
                    visit(p, q, *value);
                }
            }
        }
    }

    pub(super) fn drop_exact_ones(&mut self) {
        for (k, edge) in self.edges1.iter().enumerate() {
            let partners = &self.edges2[self.first[k] as usize..];
            for (value, partner) in self.values[self.start[k]..self.start[k + 1]].iter_mut().zip(partners) {
                if partner.length == edge.length {
                    *value = 0.0;
                }
            }
        }
    }

    /// `y = S x` without the weights of pairs.
    #[inline(always)]
    pub(super) fn multiply(&self, columns: usize, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (k, edge) in self.edges1.iter().enumerate() {
            // Ends ascend, so row j starts behind row i.
            let [i, j] = edge.ends.map(|e| e as usize * columns);
            let (xi, xj) = (&x[i..i + columns], &x[j..j + columns]);
            let (head, tail) = y.split_at_mut(j);
            let (yi, yj) = (&mut head[i..i + columns], &mut tail[..columns]);
            let partners = &self.edges2[self.first[k] as usize..];
            for (value, partner) in self.values[self.start[k]..self.start[k + 1]].iter().zip(partners) {
                let [a, b] = partner.ends.map(|e| e as usize);
                yi[a] += value * xj[b];
                yj[b] += value * xi[a];
                yi[b] += value * xj[a];
                yj[a] += value * xi[b];
            }
        }
    }
}

/// Fills in the kernel's values.
struct Values<'a> {
    kernel: Kernel,
    lengths1: &'a [f64],
    lengths2: &'a [f64],
    first: &'a [u32],
    start: &'a [usize],
    values: &'a mut [f64],
}

impl NullaryFnOnce for Values<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (k, length) in self.lengths1.iter().enumerate() {
            let run = &mut self.values[self.start[k]..self.start[k + 1]];
            let partners = &self.lengths2[self.first[k] as usize..][..run.len()];
            for (values, partners) in run.chunks_mut(LANES).zip(partners.chunks(LANES)) {
                let mut differences: Lanes = [0.0; LANES];
                differences.iter_mut().zip(partners).for_each(|(d, partner)| *d = length - partner);
                values.copy_from_slice(&self.kernel.values(&differences)[..values.len()]);
            }
        }
    }
}

fn edges(lengths: &DMatrix<f64>, shortest: f64) -> Vec<Edge> {
    let n = lengths.nrows();
    let mut edges: Vec<Edge> = (0..n)
        .flat_map(|j| (0..j).map(move |i| (i, j)))
        .map(|(i, j)| Edge { length: lengths[(i, j)], ends: [i as u32, j as u32] })
        .filter(|edge| edge.length >= shortest)
        .collect();
    edges.sort_unstable_by(|a, b| a.length.total_cmp(&b.length).then(a.ends.cmp(&b.ends)));
    edges
}

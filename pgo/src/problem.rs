use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::key_table::KeyTable;
use crate::linearise::{BetweenModel, between_model, prior_model, quadratic};
use crate::sparse::{BlockMatrix, Cholesky, Symbolic};
use crate::{CustomFactor, Error, Factor, FactorId, Kernel, Key, Measurement, PoseGraph};

/// Column of a pose that does not move.
pub(crate) const HELD: u32 = u32::MAX;

/// Where the off-diagonal block of two columns is kept.
#[derive(Debug, Clone, Copy)]
struct Pair {
    index: u32,
    /// Whether the stored block is the transpose of (row of the first, column of the second).
    transpose: bool,
}

#[derive(Debug, Clone)]
struct Between<G, const N: usize> {
    id: FactorId,
    slots: [u32; 2],
    /// Multiplies the cost; 1 but for graduated non-convexity.
    scale: f64,
    pair: Pair,
    /// The graph's own factor, a relative pose.
    factor: Arc<Factor<G, N>>,
}

impl<const N: usize, G: LieGroup<N>> Between<G, N> {
    /// The relative pose measured.
    #[inline(always)]
    fn measured(&self) -> G {
        match &self.factor.measurement {
            Measurement::Between { measured, .. } => *measured,
            _ => G::identity(),
        }
    }

    #[inline(always)]
    fn model(&self, poses: &[G]) -> BetweenModel<N> {
        let [a, b] = self.slots.map(|s| &poses[s as usize]);
        between_model(&self.measured(), &self.factor.information, self.factor.kernel, a, b)
    }

    /// The kernel's cost at `poses`.
    fn cost(&self, poses: &[G]) -> f64 {
        let [a, b] = self.slots.map(|s| &poses[s as usize]);
        let e = self.measured().between(&a.between(b)).log();
        self.factor.kernel.weigh(quadratic(&self.factor.information, &e)).rho
    }
}

#[derive(Debug, Clone)]
struct Prior<G, const N: usize> {
    slot: u32,
    kernel: Kernel,
    measured: G,
    information: SMatrix<f64, N, N>,
}

#[derive(Debug, Clone)]
struct Custom<G, const N: usize> {
    slots: Vec<u32>,
    /// One entry per pair of positions `(i, j)`, `i < j`, in lexicographic order.
    pairs: Vec<Pair>,
    kernel: Kernel,
    factor: Arc<dyn CustomFactor<G, N>>,
    /// Memory for the poses, the residual, and the Jacobians by each pose, row-major.
    at: Vec<G>,
    residual: Vec<f64>,
    jacobians: Vec<Vec<f64>>,
}

impl<const N: usize, G: LieGroup<N>> Custom<G, N> {
    /// Evaluates the residual; returns its squared norm.
    fn evaluate(&mut self, poses: &[G]) -> f64 {
        self.at.clear();
        self.at.extend(self.slots.iter().map(|s| poses[*s as usize]));
        self.residual.fill(0.0);
        self.factor.residual(&self.at, &mut self.residual);
        self.residual.iter().map(|r| r * r).sum()
    }
}

/// A graph laid out for optimisation: factors by kind in flat lists, free poses numbered as block columns, and
/// the Hessian and gradient they sum into. No Jacobian matrix is ever formed.
#[derive(Debug, Clone)]
pub(crate) struct Problem<G, const N: usize> {
    /// Block column of each slot of the graph, or [`HELD`].
    pub(crate) columns: Vec<u32>,
    /// Slot of each block column.
    pub(crate) slots: Vec<u32>,
    /// Off-diagonal blocks of the Hessian as (row, column).
    pub(crate) pairs: Vec<(u32, u32)>,
    pub(crate) hessian: BlockMatrix<N>,
    pub(crate) gradient: Vec<SVector<f64, N>>,
    betweens: Vec<Between<G, N>>,
    priors: Vec<Prior<G, N>>,
    customs: Vec<Custom<G, N>>,
    /// Models of the relative poses, by factor.
    #[cfg(feature = "rayon")]
    models: Vec<BetweenModel<N>>,
}

impl<const N: usize, G: LieGroup<N>> Problem<G, N> {
    /// Lays out the graph; poses that are fixed or in `held` do not move.
    pub(crate) fn new(graph: &PoseGraph<G, N>, held: &[Key]) -> Result<Self, Error> {
        let mut columns = vec![0; graph.keys.len()];
        for (column, fixed) in columns.iter_mut().zip(&graph.fixed) {
            *column = if *fixed { HELD } else { 0 };
        }
        for key in held {
            columns[graph.slot(*key)?] = HELD;
        }
        let mut slots = Vec::with_capacity(columns.len());
        for (slot, column) in columns.iter_mut().enumerate().filter(|(_, c)| **c != HELD) {
            *column = slots.len() as u32;
            slots.push(slot as u32);
        }
        let mut problem = Self {
            columns,
            slots,
            pairs: Vec::new(),
            hessian: BlockMatrix { diagonal: Vec::new(), off_diagonal: Vec::new() },
            gradient: Vec::new(),
            betweens: Vec::with_capacity(graph.factor_count()),
            priors: Vec::new(),
            customs: Vec::new(),
            #[cfg(feature = "rayon")]
            models: Vec::new(),
        };
        problem.take_factors(graph)?;
        problem.number_pairs();
        let (n, zero) = (problem.slots.len(), SMatrix::zeros());
        problem.hessian =
            BlockMatrix { diagonal: vec![zero; n], off_diagonal: vec![zero; problem.pairs.len()] };
        problem.gradient = vec![SVector::zeros(); n];
        Ok(problem)
    }

    fn take_factors(&mut self, graph: &PoseGraph<G, N>) -> Result<(), Error> {
        let unset = Pair { index: HELD, transpose: false };
        let slots = KeyTable::new(graph);
        for (id, factor) in graph.shared_factors() {
            let (information, kernel) = (factor.information, factor.kernel);
            match &factor.measurement {
                Measurement::Prior { key, measured } => {
                    let slot = slots.slot(*key)?;
                    self.priors.push(Prior { slot, kernel, measured: *measured, information });
                }
                Measurement::Between { from, to, .. } => {
                    let slots = [slots.slot(*from)?, slots.slot(*to)?];
                    let factor = factor.clone();
                    self.betweens.push(Between { id, slots, scale: 1.0, pair: unset, factor });
                }
                Measurement::Custom(custom) => {
                    let keys = custom.keys();
                    let slots = keys.iter().map(|k| slots.slot(*k)).collect::<Result<Vec<u32>, Error>>()?;
                    let pairs = vec![unset; slots.len() * (slots.len() - 1) / 2];
                    let (m, k) = (custom.dimension(), slots.len());
                    self.customs.push(Custom {
                        slots,
                        pairs,
                        kernel,
                        factor: custom.clone(),
                        at: Vec::with_capacity(k),
                        residual: vec![0.0; m],
                        jacobians: vec![vec![0.0; m * N]; k],
                    });
                }
            }
        }
        Ok(())
    }

    /// Numbers the pairs of columns that some factor joins, each once, sorted.
    fn number_pairs(&mut self) {
        let Self { columns, betweens, customs, pairs, .. } = self;
        let mut wanted: Vec<(u64, &mut Pair)> = Vec::with_capacity(betweens.len());
        let mut want = |a: u32, b: u32, pair| {
            let (a, b) = (columns[a as usize], columns[b as usize]);
            if a != HELD && b != HELD {
                let code = (u64::from(a.max(b)) << 32) | u64::from(a.min(b));
                wanted.push((code, pair));
                wanted.last_mut().into_iter().for_each(|(_, pair)| pair.transpose = a < b);
            }
        };
        for factor in betweens {
            want(factor.slots[0], factor.slots[1], &mut factor.pair);
        }
        for factor in customs {
            let mut list = factor.pairs.iter_mut();
            for (i, a) in factor.slots.iter().enumerate() {
                for b in &factor.slots[i + 1..] {
                    list.by_ref().take(1).for_each(|pair| want(*a, *b, pair));
                }
            }
        }
        wanted.sort_unstable_by_key(|(code, _)| *code);
        let mut last = None;
        for (code, pair) in wanted {
            if last != Some(code) {
                pairs.push(((code >> 32) as u32, code as u32));
                last = Some(code);
            }
            pair.index = pairs.len() as u32 - 1;
        }
    }

    /// The relative poses in the order they are kept.
    pub(crate) fn between_ids(&self) -> impl Iterator<Item = FactorId> + '_ {
        self.betweens.iter().map(|f| f.id)
    }

    /// Scales the cost of the `index`-th relative pose.
    pub(crate) fn set_scale(&mut self, index: usize, scale: f64) {
        self.betweens[index].scale = scale;
    }

    /// Number of free poses.
    pub(crate) fn free(&self) -> usize {
        self.slots.len()
    }

    /// Orders and analyses the Hessian, and makes room for its factor.
    pub(crate) fn cholesky(&self) -> Cholesky<N> {
        Cholesky::new(Arc::new(Symbolic::new(self.free(), &self.pairs, N)), &self.pairs)
    }

    /// The cost `½ Σ ρ` at `poses` (by slot).
    pub(crate) fn cost(&mut self, poses: &[G]) -> f64 {
        let mut sum = 0.0;
        for f in &self.betweens {
            sum += f.scale * f.cost(poses);
        }
        for f in &self.priors {
            let e = f.measured.between(&poses[f.slot as usize]).log();
            sum += f.kernel.weigh(quadratic(&f.information, &e)).rho;
        }
        for f in &mut self.customs {
            let chi2 = f.evaluate(poses);
            sum += f.kernel.weigh(chi2).rho;
        }
        0.5 * sum
    }

    /// Sets Hessian and gradient to those of the Gauss-Newton model at `poses` and returns the cost there.
    /// Kernels enter by their weights (iteratively reweighted least squares).
    pub(crate) fn linearise(&mut self, poses: &[G]) -> f64 {
        self.hessian.diagonal.fill(SMatrix::zeros());
        self.hessian.off_diagonal.fill(SMatrix::zeros());
        self.gradient.fill(SVector::zeros());
        let Self { columns, hessian, gradient, betweens, priors, customs, .. } = self;
        let mut sum = 0.0;
        #[cfg(not(feature = "rayon"))]
        for f in betweens.iter() {
            sum += add_between(f, &f.model(poses), columns, hessian, gradient);
        }
        // models on all threads, sums in the order of the factors: the same bits
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            betweens.par_iter().with_min_len(256).map(|f| f.model(poses)).collect_into_vec(&mut self.models);
            for (f, model) in betweens.iter().zip(&self.models) {
                sum += add_between(f, model, columns, hessian, gradient);
            }
        }
        for f in priors {
            let model = prior_model(&f.measured, &f.information, f.kernel, &poses[f.slot as usize]);
            sum += model.rho;
            let column = columns[f.slot as usize];
            if column != HELD {
                hessian.diagonal[column as usize] += model.hessian;
                gradient[column as usize] += model.gradient;
            }
        }
        for f in customs {
            sum += linearise_custom(f, poses, columns, hessian, gradient);
        }
        0.5 * sum
    }
}

/// Adds one relative pose.
#[inline(always)]
fn add_between<const N: usize, G: LieGroup<N>>(
    f: &Between<G, N>,
    model: &BetweenModel<N>,
    columns: &[u32],
    hessian: &mut BlockMatrix<N>,
    gradient: &mut [SVector<f64, N>],
) -> f64 {
    let [column_a, column_b] = f.slots.map(|s| columns[s as usize]);
    if column_b != HELD {
        hessian.diagonal[column_b as usize] += model.bb * f.scale;
        gradient[column_b as usize] += model.gradient_b * f.scale;
    }
    if column_a != HELD {
        hessian.diagonal[column_a as usize] += model.aa * f.scale;
        gradient[column_a as usize] += model.gradient_a * f.scale;
        if column_b != HELD {
            let target = &mut hessian.off_diagonal[f.pair.index as usize];
            if f.pair.transpose {
                *target += model.ab.transpose() * f.scale;
            } else {
                *target += model.ab * f.scale;
            }
        }
    }
    f.scale * model.rho
}

fn linearise_custom<const N: usize, G: LieGroup<N>>(
    f: &mut Custom<G, N>,
    poses: &[G],
    columns: &[u32],
    hessian: &mut BlockMatrix<N>,
    gradient: &mut [SVector<f64, N>],
) -> f64 {
    let weighed = f.kernel.weigh(f.evaluate(poses));
    let Custom { slots, pairs, factor, at, residual, jacobians, .. } = f;
    for (which, jacobian) in jacobians.iter_mut().enumerate() {
        jacobian.fill(0.0);
        factor.jacobian(at, which, jacobian);
    }
    let mut pairs = pairs.iter();
    for (i, ji) in jacobians.iter().enumerate() {
        let column = columns[slots[i] as usize];
        if column != HELD {
            hessian.diagonal[column as usize] += product(ji, ji) * weighed.weight;
            for (row, r) in ji.chunks_exact(N).zip(residual.iter()) {
                for (g, d) in gradient[column as usize].iter_mut().zip(row) {
                    *g += d * r * weighed.weight;
                }
            }
        }
        for jj in &jacobians[i + 1..] {
            let Some(pair) = pairs.next().filter(|pair| pair.index != HELD) else { continue };
            let block = if pair.transpose { product(jj, ji) } else { product(ji, jj) };
            hessian.off_diagonal[pair.index as usize] += block * weighed.weight;
        }
    }
    weighed.rho
}

/// `AᵀB` of row-major matrices with `N` columns.
fn product<const N: usize>(a: &[f64], b: &[f64]) -> SMatrix<f64, N, N> {
    let mut sum = SMatrix::zeros();
    for (left, right) in a.chunks_exact(N).zip(b.chunks_exact(N)) {
        for (j, y) in right.iter().enumerate() {
            for (i, x) in left.iter().enumerate() {
                sum[(i, j)] += x * y;
            }
        }
    }
    sum
}

use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::sparse::{BlockMatrix, Cholesky, Symbolic};
use crate::{CustomFactor, Error, FactorId, Kernel, Key, Measurement, PoseGraph};

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
    kernel: Kernel,
    measured: G,
    information: SMatrix<f64, N, N>,
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
        for (id, factor) in graph.factors() {
            let (information, kernel) = (factor.information, factor.kernel);
            match &factor.measurement {
                Measurement::Prior { key, measured } => {
                    let slot = graph.slot(*key)? as u32;
                    self.priors.push(Prior { slot, kernel, measured: *measured, information });
                }
                Measurement::Between { from, to, measured } => {
                    let slots = [graph.slot(*from)? as u32, graph.slot(*to)? as u32];
                    let measured = *measured;
                    let scale = 1.0;
                    let between = Between { id, slots, scale, pair: unset, kernel, measured, information };
                    self.betweens.push(between);
                }
                Measurement::Custom(custom) => {
                    let keys = custom.keys();
                    let slots = keys
                        .iter()
                        .map(|k| Ok(graph.slot(*k)? as u32))
                        .collect::<Result<Vec<u32>, Error>>()?;
                    let pairs = vec![unset; slots.len() * (slots.len() - 1) / 2];
                    self.customs.push(Custom { slots, pairs, kernel, factor: custom.clone() });
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

    /// Squared whitened residual of the `index`-th relative pose.
    pub(crate) fn between_chi2(&self, index: usize, poses: &[G]) -> f64 {
        let f = &self.betweens[index];
        quadratic(&f.information, &between_residual(f, poses))
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
    pub(crate) fn cost(&self, poses: &[G]) -> f64 {
        let mut sum = 0.0;
        for f in &self.betweens {
            let e = between_residual(f, poses);
            sum += f.scale * f.kernel.weigh(quadratic(&f.information, &e)).rho;
        }
        for f in &self.priors {
            let e = f.measured.between(&poses[f.slot as usize]).log();
            sum += f.kernel.weigh(quadratic(&f.information, &e)).rho;
        }
        for f in &self.customs {
            let at: Vec<G> = f.slots.iter().map(|s| poses[*s as usize]).collect();
            let mut residual = DVector::zeros(f.factor.dimension());
            f.factor.residual(&at, residual.as_mut_slice());
            sum += f.kernel.weigh(residual.norm_squared()).rho;
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
        for f in betweens {
            sum += linearise_between(f, poses, columns, hessian, gradient);
        }
        for f in priors {
            let e = f.measured.between(&poses[f.slot as usize]).log();
            let weighed = f.kernel.weigh(quadratic(&f.information, &e));
            sum += weighed.rho;
            let column = columns[f.slot as usize];
            if column != HELD {
                let j = G::right_jacobian_inverse(&e);
                let jw = j.transpose() * f.information * weighed.weight;
                hessian.diagonal[column as usize] += jw * j;
                gradient[column as usize] += jw * e;
            }
        }
        for f in customs {
            sum += linearise_custom(f, poses, columns, hessian, gradient);
        }
        0.5 * sum
    }
}

fn quadratic<const N: usize>(information: &SMatrix<f64, N, N>, e: &SVector<f64, N>) -> f64 {
    e.dot(&(information * e))
}

fn between_residual<const N: usize, G: LieGroup<N>>(f: &Between<G, N>, poses: &[G]) -> SVector<f64, N> {
    let [a, b] = f.slots.map(|s| &poses[s as usize]);
    f.measured.between(&a.between(b)).log()
}

/// Adds one relative pose. With `e = log(z⁻¹ a⁻¹ b)` the Jacobian by `b` is `J = J_r⁻¹(e)` and by `a` it is
/// `-J Ad(b⁻¹ a)`, so with `A = Ad(b⁻¹ a)` all blocks follow from `H = Jᵀ Ω J`: `-Aᵀ H` and `Aᵀ H A`.
fn linearise_between<const N: usize, G: LieGroup<N>>(
    f: &Between<G, N>,
    poses: &[G],
    columns: &[u32],
    hessian: &mut BlockMatrix<N>,
    gradient: &mut [SVector<f64, N>],
) -> f64 {
    let [a, b] = f.slots.map(|s| &poses[s as usize]);
    let b_from_a = b.between(a);
    let e = f.measured.between(&b_from_a.inverse()).log();
    let weighed = f.kernel.weigh(quadratic(&f.information, &e));
    let j = G::right_jacobian_inverse(&e);
    let jw = j.tr_mul(&f.information) * (weighed.weight * f.scale);
    let (h, g) = (jw * j, jw * e);
    let [column_a, column_b] = f.slots.map(|s| columns[s as usize]);
    if column_b != HELD {
        hessian.diagonal[column_b as usize] += h;
        gradient[column_b as usize] += g;
    }
    if column_a != HELD {
        let adjoint = b_from_a.adjoint();
        let ah = adjoint.tr_mul(&h);
        hessian.diagonal[column_a as usize] += ah * adjoint;
        gradient[column_a as usize] -= adjoint.tr_mul(&g);
        if column_b != HELD {
            let target = &mut hessian.off_diagonal[f.pair.index as usize];
            if f.pair.transpose {
                *target -= ah.transpose();
            } else {
                *target -= ah;
            }
        }
    }
    f.scale * weighed.rho
}

fn linearise_custom<const N: usize, G: LieGroup<N>>(
    f: &Custom<G, N>,
    poses: &[G],
    columns: &[u32],
    hessian: &mut BlockMatrix<N>,
    gradient: &mut [SVector<f64, N>],
) -> f64 {
    let at: Vec<G> = f.slots.iter().map(|s| poses[*s as usize]).collect();
    let m = f.factor.dimension();
    let mut residual = DVector::zeros(m);
    f.factor.residual(&at, residual.as_mut_slice());
    let weighed = f.kernel.weigh(residual.norm_squared());
    let mut buffer = vec![0.0; m * N];
    let jacobians: Vec<DMatrix<f64>> = (0..at.len())
        .map(|which| {
            buffer.fill(0.0);
            f.factor.jacobian(&at, which, &mut buffer);
            DMatrix::from_row_slice(m, N, &buffer)
        })
        .collect();
    let mut pairs = f.pairs.iter();
    for (i, ji) in jacobians.iter().enumerate() {
        let column = columns[f.slots[i] as usize];
        if column != HELD {
            hessian.diagonal[column as usize] += ji.tr_mul(ji) * weighed.weight;
            gradient[column as usize] += ji.tr_mul(&residual) * weighed.weight;
        }
        for jj in &jacobians[i + 1..] {
            let Some(pair) = pairs.next().filter(|pair| pair.index != HELD) else { continue };
            let block = if pair.transpose { jj.tr_mul(ji) } else { ji.tr_mul(jj) };
            hessian.off_diagonal[pair.index as usize] += block * weighed.weight;
        }
    }
    weighed.rho
}

use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::key_table::KeyTable;
use crate::linearise::{BetweenModel, between_model, prior_model, quadratic};
use crate::pattern::{Elimination, HELD, Pattern};
use crate::sparse::{BlockMatrix, Cholesky};
use crate::{CustomFactor, Error, Factor, FactorId, FactorModel, Kernel, Key, Measurement, PoseGraph};

#[derive(Debug, Clone)]
struct Between<G, const N: usize> {
    id: FactorId,
    slots: [u32; 2],
    /// Multiplies the cost; 1 but for graduated non-convexity.
    scale: f64,
    /// Index of the off-diagonal block, or [`HELD`]; its row is that of the larger column.
    pair: u32,
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
    /// Index of the off-diagonal block of each pair of positions `(i, j)`, `i < j`, in lexicographic order, or [`HELD`].
    pairs: Vec<u32>,
    kernel: Kernel,
    factor: Arc<dyn CustomFactor<G, N>>,
    /// Memory for the poses, the residual, and the Jacobians by each pose, row-major.
    at: Vec<G>,
    residual: Vec<f64>,
    jacobians: Vec<Vec<f64>>,
    model: FactorModel<N>,
}

impl<const N: usize, G: LieGroup<N>> Custom<G, N> {
    fn new(slots: Vec<u32>, kernel: Kernel, factor: &Arc<dyn CustomFactor<G, N>>) -> Self {
        let (m, k) = (factor.dimension(), slots.len());
        Self {
            slots,
            pairs: vec![HELD; k * (k - 1) / 2],
            kernel,
            factor: factor.clone(),
            at: Vec::with_capacity(k),
            residual: vec![0.0; m],
            jacobians: vec![vec![0.0; m * N]; k],
            model: FactorModel::zeros(k),
        }
    }

    /// Its pairs of slots, in the order of [`Custom::pairs`].
    fn joints(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let slots = &self.slots;
        slots.iter().enumerate().flat_map(move |(i, a)| slots[i + 1..].iter().map(move |b| [*a, *b]))
    }

    /// Adds the products of the Jacobians at the poses of the last [`Custom::evaluate`] to the model.
    fn model_by_jacobians(&mut self) {
        let Custom { factor, at, residual, jacobians, model, .. } = self;
        for (which, jacobian) in jacobians.iter_mut().enumerate() {
            jacobian.fill(0.0);
            factor.jacobian(at, which, jacobian);
        }
        for (i, ji) in jacobians.iter().enumerate() {
            let gradient = model.gradient_mut(i);
            for (row, r) in ji.chunks_exact(N).zip(residual.iter()) {
                for (g, d) in gradient.iter_mut().zip(row) {
                    *g += d * r;
                }
            }
            for (j, jj) in jacobians.iter().enumerate().skip(i) {
                *model.hessian_mut(i, j) += product(ji, jj);
            }
        }
    }

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
    /// Where the blocks of the Hessian stand.
    pub(crate) pattern: Pattern,
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
        let mut stays = graph.fixed.clone();
        for key in held {
            stays[graph.slot(*key)?] = true;
        }
        let (mut betweens, mut priors, mut customs) =
            (Vec::with_capacity(graph.factor_count()), Vec::new(), Vec::new());
        let slots = KeyTable::new(graph);
        for (id, factor) in graph.shared_factors() {
            let (information, kernel) = (factor.information, factor.kernel);
            match &factor.measurement {
                Measurement::Prior { key, measured } => {
                    let slot = slots.slot(*key)?;
                    priors.push(Prior { slot, kernel, measured: *measured, information });
                }
                Measurement::Between { from, to, .. } => {
                    let slots = [slots.slot(*from)?, slots.slot(*to)?];
                    let factor = factor.clone();
                    betweens.push(Between { id, slots, scale: 1.0, pair: HELD, factor });
                }
                Measurement::Custom(custom) => {
                    let keys = custom.keys();
                    let slots = keys.iter().map(|k| slots.slot(*k)).collect::<Result<Vec<u32>, Error>>()?;
                    customs.push(Custom::new(slots, kernel, custom));
                }
            }
        }
        let joints = betweens.iter().map(|f| f.slots).chain(customs.iter().flat_map(Custom::joints));
        let (pattern, places) = Pattern::new(stays, joints);
        let mut places = places.into_iter();
        let targets = betweens.iter_mut().map(|f| &mut f.pair);
        for (pair, place) in targets.chain(customs.iter_mut().flat_map(|f| &mut f.pairs)).zip(&mut places) {
            *pair = place;
        }
        let (n, zero) = (pattern.slots.len(), SMatrix::zeros());
        Ok(Self {
            hessian: BlockMatrix { diagonal: vec![zero; n], off_diagonal: vec![zero; pattern.pairs.len()] },
            gradient: vec![SVector::zeros(); n],
            pattern,
            betweens,
            priors,
            customs,
            #[cfg(feature = "rayon")]
            models: Vec::new(),
        })
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
        self.pattern.slots.len()
    }

    /// Makes room for the factor of the Hessian, in the order that `elimination` knows or finds.
    pub(crate) fn cholesky(&self, elimination: &Elimination) -> Cholesky<N> {
        Cholesky::new(elimination.symbolic(&self.pattern, N), &self.pattern.pairs)
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
        let Self { pattern, hessian, gradient, betweens, priors, customs, .. } = self;
        let columns = &pattern.columns;
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
            let target = &mut hessian.off_diagonal[f.pair as usize];
            if column_a < column_b {
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
    f.model.clear();
    if !f.factor.add_model(&f.at, &mut f.model) {
        f.model_by_jacobians();
    }
    let Custom { slots, pairs, model, .. } = f;
    let (mut pairs, mut blocks) = (pairs.iter(), model.hessian.iter());
    for (i, gradient_i) in model.gradient.iter().enumerate() {
        let column = columns[slots[i] as usize];
        let diagonal = blocks.next();
        if let Some(block) = diagonal.filter(|_| column != HELD) {
            hessian.diagonal[column as usize] += block * weighed.weight;
            gradient[column as usize] += gradient_i * weighed.weight;
        }
        for slot in &slots[i + 1..] {
            let (Some(block), Some(pair)) = (blocks.next(), pairs.next()) else { continue };
            if *pair != HELD {
                let block = if column < columns[*slot as usize] { block.transpose() } else { *block };
                hessian.off_diagonal[*pair as usize] += block * weighed.weight;
            }
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

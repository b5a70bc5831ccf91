use draco_lie::LieGroup;
use nalgebra::{SMatrix, SVector};

use crate::linearise::{between_model, prior_model};
use crate::{CustomFactor, Factor, Kernel, Measurement, PoseGraph};

/// The Gauss-Newton model of one factor at fixed poses.
///
/// `values` holds the Hessian over the free poses in `slots`, lower triangle, diagonal blocks in full, with minus
/// the gradient as one more row: column-major, `slots.len() · N + 1` rows. A clique's Schur complement has the
/// same layout, so one routine sums both.
#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    pub(crate) slots: Vec<u32>,
    pub(crate) values: Vec<f64>,
    /// Weight that the kernel gave.
    pub(crate) weight: f64,
}

/// What decides how much a factor counts.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Weighing {
    /// A kernel, in place of the factor's own.
    Kernel(Kernel),
    /// A given weight.
    Frozen(f64),
}

impl Model {
    /// Models `factor` at `poses` (by slot of `graph`).
    pub(crate) fn set<const N: usize, G: LieGroup<N>>(
        &mut self,
        graph: &PoseGraph<G, N>,
        factor: &Factor<G, N>,
        weighing: Weighing,
        poses: &[G],
    ) {
        self.slots.clear();
        let free = |slot: &usize| !graph.fixed[*slot];
        let (information, kernel, frozen) = match weighing {
            Weighing::Kernel(kernel) => (factor.information, kernel, None),
            Weighing::Frozen(weight) => (factor.information * weight, Kernel::None, Some(weight)),
        };
        match &factor.measurement {
            Measurement::Prior { key, measured } => {
                let Some(slot) = graph.slot(*key).ok().filter(free) else { return };
                let model = prior_model(measured, &information, kernel, &poses[slot]);
                self.resize::<N>(&[slot]);
                self.weight = frozen.unwrap_or(model.weight);
                self.put(0, 0, &model.hessian);
                self.put_gradient(0, &model.gradient);
            }
            Measurement::Between { from, to, measured } => {
                let (Ok(a), Ok(b)) = (graph.slot(*from), graph.slot(*to)) else { return };
                let model = between_model(measured, &information, kernel, &poses[a], &poses[b]);
                self.weight = frozen.unwrap_or(model.weight);
                match (free(&a), free(&b)) {
                    (true, true) => {
                        self.resize::<N>(&[a, b]);
                        self.put(0, 0, &model.aa);
                        self.put(1, 0, &model.ab.transpose());
                        self.put(1, 1, &model.bb);
                        self.put_gradient(0, &model.gradient_a);
                        self.put_gradient(1, &model.gradient_b);
                    }
                    (true, false) => {
                        self.resize::<N>(&[a]);
                        self.put(0, 0, &model.aa);
                        self.put_gradient(0, &model.gradient_a);
                    }
                    (false, true) => {
                        self.resize::<N>(&[b]);
                        self.put(0, 0, &model.bb);
                        self.put_gradient(0, &model.gradient_b);
                    }
                    (false, false) => {}
                }
            }
            Measurement::Custom(custom) => self.set_custom(graph, custom.as_ref(), weighing, poses),
        }
    }

    fn set_custom<const N: usize, G: LieGroup<N>>(
        &mut self,
        graph: &PoseGraph<G, N>,
        custom: &dyn CustomFactor<G, N>,
        weighing: Weighing,
        poses: &[G],
    ) {
        let slots: Vec<usize> = custom.keys().iter().filter_map(|key| graph.slot(*key).ok()).collect();
        let at: Vec<G> = slots.iter().map(|slot| poses[*slot]).collect();
        let m = custom.dimension();
        let mut residual = vec![0.0; m];
        custom.residual(&at, &mut residual);
        self.weight = match weighing {
            Weighing::Kernel(kernel) => kernel.weigh(residual.iter().map(|r| r * r).sum()).weight,
            Weighing::Frozen(weight) => weight,
        };
        let free: Vec<usize> = (0..slots.len()).filter(|which| !graph.fixed[slots[*which]]).collect();
        self.resize::<N>(&free.iter().map(|which| slots[*which]).collect::<Vec<usize>>());
        let jacobians: Vec<Vec<f64>> = free
            .iter()
            .map(|which| {
                let mut jacobian = vec![0.0; m * N];
                custom.jacobian(&at, *which, &mut jacobian);
                jacobian
            })
            .collect();
        for (column, right) in jacobians.iter().enumerate() {
            for (row, left) in jacobians.iter().enumerate().skip(column) {
                let block = SMatrix::<f64, N, N>::from_fn(|i, j| {
                    self.weight * (0..m).map(|k| left[k * N + i] * right[k * N + j]).sum::<f64>()
                });
                self.put(row, column, &block);
            }
            let gradient = SVector::<f64, N>::from_fn(|i, _| {
                self.weight * (0..m).map(|k| right[k * N + i] * residual[k]).sum::<f64>()
            });
            self.put_gradient(column, &gradient);
        }
    }

    fn resize<const N: usize>(&mut self, slots: &[usize]) {
        self.slots.extend(slots.iter().map(|slot| *slot as u32));
        let width = slots.len() * N;
        self.values.clear();
        self.values.resize((width + 1) * width, 0.0);
    }

    fn put<const N: usize>(&mut self, row: usize, column: usize, block: &SMatrix<f64, N, N>) {
        let height = self.slots.len() * N + 1;
        for j in 0..N {
            let begin = (column * N + j) * height + row * N;
            self.values[begin..begin + N].copy_from_slice(block.column(j).as_slice());
        }
    }

    fn put_gradient<const N: usize>(&mut self, column: usize, gradient: &SVector<f64, N>) {
        let height = self.slots.len() * N + 1;
        for j in 0..N {
            self.values[(column * N + j) * height + height - 1] = -gradient[j];
        }
    }
}

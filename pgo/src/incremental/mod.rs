//! Incremental smoothing: a solver that follows a growing graph.

mod anchors;
mod covariance;
mod elimination;
mod front;
mod model;
mod params;
mod removal;
mod tree;

use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector};

use self::anchors::Anchors;
use self::model::{Model, Weighing};
use self::tree::{Factors, Tree};
use crate::{CustomFactor, Error, Factor, FactorId, Kernel, Key, PoseGraph};

pub use params::{IncrementalMode, IncrementalParams, IncrementalUpdate};

/// An incremental smoother in the plane.
pub type Incremental2 = Incremental<Isometry2<f64>, 3>;
/// An incremental smoother in space.
pub type Incremental3 = Incremental<Isometry3<f64>, 6>;

/// A pose graph that is optimised while it grows.
///
/// Add poses and factors, remove factors, then call [`Incremental::update`]: it redoes only that part of the
/// factorisation which the changes reach, and moves only poses whose estimate they change. Between updates
/// [`Incremental::graph`] is the graph with the present estimates.
///
/// Each connected part needs a prior or a fixed pose: there is no pose to hold silently, because parts may meet
/// later.
///
/// Use [`crate::solve`] where the whole graph is at hand: one batch solution costs as much as a few large
/// updates.
///
/// **Source**: Kaess, Johannsson, Roberts, Ila, Leonard, Dellaert, *iSAM2: Incremental smoothing and mapping
/// using the Bayes tree*, 2012. We differ in keeping Hessian instead of Jacobian blocks and in eliminating factors
/// and orphaned subtrees alike by minimum degree on their common quotient graph.
///
/// ```
/// use draco_pgo::{Incremental2, IncrementalParams, Kernel, Key};
/// use nalgebra::{Isometry2, Matrix3, Vector2};
///
/// let information = Matrix3::from_diagonal_element(100.0);
/// let step = Isometry2::new(Vector2::new(2.0, 0.0), std::f64::consts::FRAC_PI_2);
/// let mut smoother = Incremental2::new(IncrementalParams::default())?;
/// smoother.add_pose(Key::new(0, 0), Isometry2::identity())?;
/// smoother.add_prior(Key::new(0, 0), Isometry2::identity(), information, Kernel::None)?;
/// for i in 1..4 {
///     let last = *smoother.graph().pose(Key::new(0, i - 1)).unwrap();
///     smoother.add_pose(Key::new(0, i), last * step)?;
///     smoother.add_between(Key::new(0, i - 1), Key::new(0, i), step, information, Kernel::None)?;
///     smoother.update()?;
/// }
/// smoother.add_between(Key::new(0, 3), Key::new(0, 0), step, information, Kernel::None)?;
/// smoother.update()?;
/// assert!(smoother.graph().cost() < 1e-18);
/// assert!(smoother.covariance(Key::new(0, 2))?[(0, 0)] > 0.0);
/// # Ok::<(), draco_pgo::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Incremental<G, const N: usize> {
    params: IncrementalParams,
    /// Poses are the estimates: linearisation points moved by the steps of the tree.
    graph: PoseGraph<G, N>,
    linearised: Vec<G>,
    tree: Tree<N>,
    anchors: Anchors,
    /// By factor: its model, and by what factor its kernel is widened at present.
    models: Vec<Model>,
    widened: Vec<f64>,
    /// Factors on each free slot, as the tree knows them or is about to.
    touching: Vec<Vec<u32>>,
    /// Factors whose kernels are still wide.
    graduating: Vec<FactorId>,
    /// Factors not yet seen by an update.
    new_factors: Vec<FactorId>,
    /// Slots whose factors changed since the last successful update, and those to eliminate last.
    involved: Vec<u32>,
    late: Vec<u32>,
    /// Slots to linearise anew.
    drifted: Vec<u32>,
    changed: Vec<u32>,
    is_listed: Vec<bool>,
}

impl<const N: usize, G: LieGroup<N>> Incremental<G, N> {
    /// A smoother without poses.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn new(params: IncrementalParams) -> Result<Self, Error> {
        Self::from_graph(PoseGraph::new(), params)
    }

    /// A smoother that goes on from `graph`, best at its optimum; the first update takes it in.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn from_graph(graph: PoseGraph<G, N>, params: IncrementalParams) -> Result<Self, Error> {
        params.check()?;
        let mut smoother = Self {
            params,
            linearised: graph.poses.clone(),
            tree: Tree::new(),
            anchors: Anchors::default(),
            models: Vec::new(),
            widened: Vec::new(),
            graduating: Vec::new(),
            touching: Vec::new(),
            new_factors: graph.factors().map(|(id, _)| id).collect(),
            involved: Vec::new(),
            late: Vec::new(),
            drifted: Vec::new(),
            changed: Vec::new(),
            is_listed: Vec::new(),
            graph,
        };
        smoother
            .involved
            .extend((0..smoother.linearised.len() as u32).filter(|s| !smoother.graph.fixed[*s as usize]));
        Ok(smoother)
    }

    /// The graph with the present estimates as its poses.
    pub fn graph(&self) -> &PoseGraph<G, N> {
        &self.graph
    }

    /// Gives up the smoother for its graph.
    pub fn into_graph(self) -> PoseGraph<G, N> {
        self.graph
    }

    /// Adds a pose with its first guess; the next update needs factors that hold it.
    ///
    /// # Errors
    /// Those of [`PoseGraph::add_pose`].
    pub fn add_pose(&mut self, key: Key, initial: G) -> Result<(), Error> {
        self.graph.add_pose(key, initial)?;
        self.linearised.push(initial);
        self.involved.push(self.linearised.len() as u32 - 1);
        Ok(())
    }

    /// Adds a pose that does not move.
    ///
    /// # Errors
    /// Those of [`PoseGraph::add_pose`].
    pub fn add_fixed_pose(&mut self, key: Key, pose: G) -> Result<(), Error> {
        self.graph.add_pose(key, pose)?;
        self.graph.set_fixed(key, true)?;
        self.linearised.push(pose);
        Ok(())
    }

    /// Adds the measurement of a pose itself, as [`PoseGraph::add_prior`].
    ///
    /// # Errors
    /// Those of [`PoseGraph::add_prior`].
    pub fn add_prior(
        &mut self,
        key: Key,
        measured: G,
        information: SMatrix<f64, N, N>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        let id = self.graph.add_prior(key, measured, information, kernel)?;
        self.new_factors.push(id);
        Ok(id)
    }

    /// Adds a relative pose, as [`PoseGraph::add_between`].
    ///
    /// # Errors
    /// Those of [`PoseGraph::add_between`].
    pub fn add_between(
        &mut self,
        from: Key,
        to: Key,
        measured: G,
        information: SMatrix<f64, N, N>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        let id = self.graph.add_between(from, to, measured, information, kernel)?;
        self.new_factors.push(id);
        Ok(id)
    }

    /// Adds a user-defined factor, as [`PoseGraph::add_custom`].
    ///
    /// # Errors
    /// Those of [`PoseGraph::add_custom`].
    pub fn add_custom(
        &mut self,
        custom: Arc<dyn CustomFactor<G, N>>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        let id = self.graph.add_custom(custom, kernel)?;
        self.new_factors.push(id);
        Ok(id)
    }

    /// Takes a factor out and returns it. Poses that nothing holds then make the next update fail.
    ///
    /// # Errors
    /// [`Error::UnknownFactor`].
    pub fn remove_factor(&mut self, id: FactorId) -> Result<Factor<G, N>, Error> {
        let factor = self.graph.remove_factor(id)?;
        self.anchors.forget();
        if let Some(at) = self.new_factors.iter().position(|new| *new == id) {
            self.new_factors.remove(at);
        } else if let Some(model) = self.models.get_mut(id.0) {
            let model = std::mem::take(model);
            for slot in &model.slots {
                self.touching[*slot as usize].retain(|f| *f as usize != id.0);
            }
            self.involved.extend_from_slice(&model.slots);
        }
        Ok(factor)
    }

    /// Takes in what was added and removed since the last update.
    ///
    /// # Errors
    /// [`Error::EmptyGraph`]; [`Error::NoGauge`]; [`Error::Indefinite`]. Estimates are then as before, and the
    /// changes wait for the next update, before which more can be added or removed.
    pub fn update(&mut self) -> Result<IncrementalUpdate, Error> {
        if self.graph.pose_count() == 0 {
            return Err(Error::EmptyGraph);
        }
        self.grow();
        self.anchors.check(&self.graph, &self.new_factors)?;
        let mut report =
            IncrementalUpdate { new_factors: self.take_new_factors(), ..IncrementalUpdate::default() };
        let mut touched: Vec<u32> = Vec::new();
        let mut settling = if self.graduating.is_empty() { 0 } else { SETTLING };
        loop {
            self.relinearise(&mut report);
            if self.involved.is_empty() {
                break;
            }
            let factors = Factors { models: &self.models, touching: &self.touching };
            report.eliminated += self
                .tree
                .update(&self.involved, &self.late, &factors)
                .map_err(|slot| Error::Indefinite { key: self.graph.keys[slot as usize] })?;
            self.involved.clear();
            self.move_poses(&mut touched);
            report.iterations += 1;
            let again = match self.params.mode {
                _ if !self.graduating.is_empty() => self.narrow(),
                IncrementalMode::Exact => true,
                IncrementalMode::Fluid if settling > 0 => {
                    settling -= 1;
                    true
                }
                IncrementalMode::Fluid => false,
            };
            if !again || report.iterations >= self.params.max_iterations {
                break;
            }
        }
        report.converged = self.drifted.is_empty() && self.graduating.is_empty();
        self.late.clear();
        self.list_touched(touched, &mut report);
        Ok(report)
    }

    fn grow(&mut self) {
        let (slots, factors) = (self.linearised.len(), self.graph.factors.len());
        self.tree.grow(slots);
        self.touching.resize(slots, Vec::new());
        self.is_listed.resize(factors.max(slots), false);
        self.models.resize(factors, Model::default());
        self.widened.resize(factors, 1.0);
    }

    /// Models the new factors; returns how many there are.
    fn take_new_factors(&mut self) -> usize {
        let new = std::mem::take(&mut self.new_factors);
        for id in &new {
            let Some(factor) = self.graph.factor(*id) else { continue };
            if let Some(rate) = self.params.graduation
                && factor.kernel != Kernel::None
            {
                let chi2 = self.graph.chi2(*id).unwrap_or(0.0);
                self.widened[id.0] = widening(factor.kernel, chi2, rate);
                if self.widened[id.0] > 1.0 {
                    self.graduating.push(*id);
                }
            }
            let kernel = factor.kernel.widened(self.widened[id.0]);
            let model = &mut self.models[id.0];
            model.set(&self.graph, factor, Weighing::Kernel(kernel), &self.linearised);
            for slot in &model.slots {
                self.touching[*slot as usize].push(id.0 as u32);
            }
            self.involved.extend_from_slice(&model.slots);
            self.late.extend(model.slots.iter().max());
        }
        new.len()
    }

    /// Moves the linearisation points that their estimates have left, and models their factors anew.
    fn relinearise(&mut self, report: &mut IncrementalUpdate) {
        let Self { graph, drifted, linearised, tree, touching, models, involved, is_listed, .. } = self;
        let mut factors = Vec::new();
        for slot in drifted.drain(..) {
            let at = slot as usize;
            report.relinearised += 1;
            linearised[at] = graph.poses[at];
            tree.delta[at] = SVector::zeros();
            for factor in &touching[at] {
                if !is_listed[*factor as usize] {
                    is_listed[*factor as usize] = true;
                    factors.push(*factor);
                }
            }
        }
        for id in factors {
            let at = id as usize;
            is_listed[at] = false;
            let Some(factor) = graph.factor(FactorId(at)) else { continue };
            // while a new factor pulls with a wide kernel, what was believed before keeps its weight: it would let
            // go else, and not find back
            let frozen = !self.graduating.is_empty() && self.widened[at] == 1.0;
            let weighing = match factor.kernel {
                Kernel::None => Weighing::Kernel(Kernel::None),
                _ if frozen => Weighing::Frozen(models[at].weight),
                kernel => Weighing::Kernel(kernel.widened(self.widened[at])),
            };
            models[at].set(graph, factor, weighing, linearised);
            involved.extend_from_slice(&models[at].slots);
        }
    }

    /// Back-substitutes, moves the estimates and lists those that have left their linearisation points.
    fn move_poses(&mut self, touched: &mut Vec<u32>) {
        let (wildfire, limit) = self.params.thresholds();
        let Self { graph, drifted, linearised, tree, changed, models, touching, is_listed, .. } = self;
        tree.back_substitute(wildfire, changed);
        for slot in changed.iter() {
            let at = *slot as usize;
            graph.poses[at] = linearised[at].plus(&tree.delta[at]);
            if tree.delta[at].amax() > limit && !is_listed[at] {
                is_listed[at] = true;
                drifted.push(*slot);
            }
        }
        // a robust factor is also out of date when its weight is
        let thawed = self.graduating.is_empty();
        for slot in changed.iter().filter(|_| thawed) {
            for id in &touching[*slot as usize] {
                let Some(factor) = graph.factor(FactorId(*id as usize)) else { continue };
                if factor.kernel == Kernel::None {
                    continue;
                }
                let kernel = factor.kernel.widened(self.widened[*id as usize]);
                let weight = kernel.weigh(graph.chi2(FactorId(*id as usize)).unwrap_or(0.0)).weight;
                if (weight - models[*id as usize].weight).abs() > WEIGHT_TOLERANCE {
                    for slot in &models[*id as usize].slots {
                        if !is_listed[*slot as usize] {
                            is_listed[*slot as usize] = true;
                            drifted.push(*slot);
                        }
                    }
                }
            }
        }
        drifted.iter().for_each(|slot| is_listed[*slot as usize] = false);
        touched.extend_from_slice(changed);
    }

    /// Narrows the kernels that are still wide by one step; always asks for a further iteration.
    fn narrow(&mut self) -> bool {
        let rate = self.params.graduation.unwrap_or(f64::INFINITY);
        for id in &self.graduating {
            let widened = &mut self.widened[id.0];
            *widened = if *widened < rate * 1.001 { 1.0 } else { *widened / rate };
            for slot in &self.models[id.0].slots {
                if !self.drifted.contains(slot) {
                    self.drifted.push(*slot);
                }
            }
        }
        self.graduating.retain(|id| self.widened[id.0] > 1.0);
        true
    }

    fn list_touched(&mut self, mut touched: Vec<u32>, report: &mut IncrementalUpdate) {
        touched.sort_unstable();
        touched.dedup();
        report.touched = touched.iter().map(|slot| self.graph.keys[*slot as usize]).collect();
        report.touched.sort_unstable();
    }
}

/// Iterations that follow the narrowing of kernels, while something is left to linearise anew.
const SETTLING: usize = 5;

/// Change of a robust weight that calls for a new linearisation.
const WEIGHT_TOLERANCE: f64 = 0.05;

/// By how much to widen a kernel, in whole steps, so that it is nearly quadratic at the squared residual `chi2`.
fn widening(kernel: Kernel, chi2: f64, rate: f64) -> f64 {
    let mut widened = 1.0;
    while kernel.widened(widened).weigh(chi2).weight < 0.9 && widened < 1e12 {
        widened *= rate;
    }
    widened
}

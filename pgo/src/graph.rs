use std::collections::BTreeMap;
use std::sync::Arc;

use draco_lie::LieGroup;
use nalgebra::{Cholesky, Const, DVector, Isometry2, Isometry3, SMatrix};

use crate::pattern::Elimination;
use crate::{CustomFactor, Error, Factor, FactorId, Kernel, Key, Measurement};

/// A pose graph: poses with a first guess, and factors that say what was measured.
///
/// The cost is `½ Σ ρ(eᵀ Ω e)` with `e = log(z⁻¹ x)` for priors and `e = log(z⁻¹ a⁻¹ b)` for relative poses,
/// tangent order translation then rotation, metres and radians.
#[derive(Debug, Clone)]
pub struct PoseGraph<G, const N: usize> {
    pub(crate) keys: Vec<Key>,
    pub(crate) poses: Vec<G>,
    pub(crate) fixed: Vec<bool>,
    pub(crate) slots: BTreeMap<Key, u32>,
    /// Shared with copies of the graph and with solvers.
    pub(crate) factors: Vec<Option<Arc<Factor<G, N>>>>,
    live_factors: usize,
    pub(crate) elimination: Elimination,
}

/// A pose graph in the plane.
pub type PoseGraph2 = PoseGraph<Isometry2<f64>, 3>;
/// A pose graph in space.
pub type PoseGraph3 = PoseGraph<Isometry3<f64>, 6>;

/// A connected part of a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Component {
    /// Its poses, ascending.
    pub keys: Vec<Key>,
    /// Whether a prior or a fixed pose holds it in place.
    pub anchored: bool,
}

impl<const N: usize, G: LieGroup<N>> Default for PoseGraph<G, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize, G: LieGroup<N>> PoseGraph<G, N> {
    /// A graph without poses.
    pub fn new() -> Self {
        Self {
            keys: Vec::new(),
            poses: Vec::new(),
            fixed: Vec::new(),
            slots: BTreeMap::new(),
            factors: Vec::new(),
            live_factors: 0,
            elimination: Elimination::default(),
        }
    }

    /// Adds a pose with its first guess `initial`.
    ///
    /// # Errors
    /// [`Error::DuplicateKey`], [`Error::NotFinite`].
    pub fn add_pose(&mut self, key: Key, initial: G) -> Result<(), Error> {
        check_pose(&initial, "pose", key)?;
        if self.slots.contains_key(&key) {
            return Err(Error::DuplicateKey { key });
        }
        self.slots.insert(key, self.keys.len() as u32);
        self.keys.push(key);
        self.poses.push(initial);
        self.fixed.push(false);
        Ok(())
    }

    /// Adds the measurement of a pose itself: `measured` with information in the body frame of `measured`,
    /// order translation then rotation.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], [`Error::NotFinite`], [`Error::Information`], [`Error::KernelParameter`].
    pub fn add_prior(
        &mut self,
        key: Key,
        measured: G,
        information: SMatrix<f64, N, N>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        self.slot(key)?;
        check_pose(&measured, "prior", key)?;
        check_information(&information, key)?;
        check_kernel(kernel, key)?;
        Ok(self.push(Factor { measurement: Measurement::Prior { key, measured }, information, kernel }))
    }

    /// Adds a relative pose.
    ///
    /// * `measured` – `z = from_from_to`, the pose of `to` seen from `from`.
    /// * `information` – inverse covariance of `log(z⁻¹ from⁻¹ to)`, in the frame of the measured `to`, order
    ///   translation then rotation.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], [`Error::SelfEdge`], [`Error::NotFinite`], [`Error::Information`],
    /// [`Error::KernelParameter`].
    pub fn add_between(
        &mut self,
        from: Key,
        to: Key,
        measured: G,
        information: SMatrix<f64, N, N>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        self.slot(from)?;
        self.slot(to)?;
        if from == to {
            return Err(Error::SelfEdge { key: from });
        }
        check_pose(&measured, "relative pose", from)?;
        check_information(&information, from)?;
        check_kernel(kernel, from)?;
        Ok(self.push(Factor {
            measurement: Measurement::Between { from, to, measured },
            information,
            kernel,
        }))
    }

    /// Adds a user-defined factor.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], [`Error::KernelParameter`], [`Error::CustomFactor`] when it names no pose, one
    /// pose twice or an empty residual.
    pub fn add_custom(
        &mut self,
        custom: Arc<dyn CustomFactor<G, N>>,
        kernel: Kernel,
    ) -> Result<FactorId, Error> {
        let keys = custom.keys();
        let Some(first) = keys.first() else {
            return Err(Error::CustomFactor { reason: "names no pose".into() });
        };
        for (i, key) in keys.iter().enumerate() {
            self.slot(*key)?;
            if keys[..i].contains(key) {
                return Err(Error::CustomFactor { reason: format!("names pose {key} twice") });
            }
        }
        if custom.dimension() == 0 {
            return Err(Error::CustomFactor { reason: "has an empty residual".into() });
        }
        check_kernel(kernel, *first)?;
        let information = SMatrix::identity();
        Ok(self.push(Factor { measurement: Measurement::Custom(custom), information, kernel }))
    }

    pub(crate) fn push(&mut self, factor: Factor<G, N>) -> FactorId {
        self.factors.push(Some(Arc::new(factor)));
        self.live_factors += 1;
        FactorId(self.factors.len() - 1)
    }

    /// Takes a factor out of the graph and returns it.
    ///
    /// # Errors
    /// [`Error::UnknownFactor`].
    pub fn remove_factor(&mut self, id: FactorId) -> Result<Factor<G, N>, Error> {
        let removed = self.factors.get_mut(id.0).and_then(Option::take);
        self.live_factors -= usize::from(removed.is_some());
        removed.map(Arc::unwrap_or_clone).ok_or(Error::UnknownFactor { factor: id })
    }

    /// Puts a factor that was taken out back in its place.
    pub(crate) fn restore_factor(&mut self, id: FactorId, factor: Factor<G, N>) {
        if let Some(place @ None) = self.factors.get_mut(id.0) {
            *place = Some(Arc::new(factor));
            self.live_factors += 1;
        }
    }

    /// Takes a pose out of the graph together with every factor on it; returns those factors' ids.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn remove_pose(&mut self, key: Key) -> Result<Vec<FactorId>, Error> {
        let slot = self.slot(key)?;
        let ids: Vec<FactorId> =
            self.factors().filter(|(_, factor)| factor.keys().contains(&key)).map(|(id, _)| id).collect();
        for id in &ids {
            self.remove_factor(*id)?;
        }
        self.keys.remove(slot);
        self.poses.remove(slot);
        self.fixed.remove(slot);
        self.slots = self.keys.iter().enumerate().map(|(i, k)| (*k, i as u32)).collect();
        Ok(ids)
    }

    /// Holds a pose at its present value (`true`) or lets it move again.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn set_fixed(&mut self, key: Key, fixed: bool) -> Result<(), Error> {
        let slot = self.slot(key)?;
        self.fixed[slot] = fixed;
        Ok(())
    }

    /// Whether a pose is held at its present value; `false` for keys the graph does not hold.
    pub fn is_fixed(&self, key: Key) -> bool {
        self.slot(key).is_ok_and(|slot| self.fixed[slot])
    }

    /// Replaces the present value of a pose.
    ///
    /// # Errors
    /// [`Error::UnknownKey`], [`Error::NotFinite`].
    pub fn set_pose(&mut self, key: Key, pose: G) -> Result<(), Error> {
        check_pose(&pose, "pose", key)?;
        let slot = self.slot(key)?;
        self.poses[slot] = pose;
        Ok(())
    }

    /// Replaces the kernel of a factor.
    ///
    /// # Errors
    /// [`Error::UnknownFactor`], [`Error::KernelParameter`].
    pub fn set_kernel(&mut self, id: FactorId, kernel: Kernel) -> Result<(), Error> {
        let factor = self.factors.get_mut(id.0).and_then(Option::as_mut);
        let factor = factor.ok_or(Error::UnknownFactor { factor: id })?;
        if let Some(key) = factor.keys().first() {
            check_kernel(kernel, *key)?;
        }
        Arc::make_mut(factor).kernel = kernel;
        Ok(())
    }

    /// The present value of a pose.
    pub fn pose(&self, key: Key) -> Option<&G> {
        self.slots.get(&key).map(|slot| &self.poses[*slot as usize])
    }

    /// All poses, ascending by key.
    pub fn poses(&self) -> impl Iterator<Item = (Key, &G)> {
        self.slots.iter().map(|(key, slot)| (*key, &self.poses[*slot as usize]))
    }

    /// One factor.
    pub fn factor(&self, id: FactorId) -> Option<&Factor<G, N>> {
        self.factors.get(id.0).and_then(Option::as_deref)
    }

    /// All factors in the order they were added.
    pub fn factors(&self) -> impl Iterator<Item = (FactorId, &Factor<G, N>)> {
        self.shared_factors().map(|(id, factor)| (id, factor.as_ref()))
    }

    pub(crate) fn shared_factors(&self) -> impl Iterator<Item = (FactorId, &Arc<Factor<G, N>>)> {
        self.factors.iter().enumerate().filter_map(|(i, f)| f.as_ref().map(|f| (FactorId(i), f)))
    }

    /// Number of poses.
    pub fn pose_count(&self) -> usize {
        self.keys.len()
    }

    /// Number of factors.
    pub fn factor_count(&self) -> usize {
        self.live_factors
    }

    /// Squared whitened residual norm `eᵀ Ω e` of a factor at the present poses, before its kernel.
    pub fn chi2(&self, id: FactorId) -> Option<f64> {
        self.factor(id).map(|factor| self.factor_chi2(factor))
    }

    /// The cost `½ Σ ρ(eᵀ Ω e)` at the present poses.
    pub fn cost(&self) -> f64 {
        0.5 * self.factors().map(|(_, f)| f.kernel.weigh(self.factor_chi2(f)).rho).sum::<f64>()
    }

    fn factor_chi2(&self, factor: &Factor<G, N>) -> f64 {
        let at = |key: &Key| self.slots.get(key).map(|slot| self.poses[*slot as usize]);
        let residual = match &factor.measurement {
            Measurement::Prior { key, measured } => at(key).map(|x| measured.between(&x).log()),
            Measurement::Between { from, to, measured } => {
                at(from).zip(at(to)).map(|(a, b)| measured.between(&a.between(&b)).log())
            }
            Measurement::Custom(custom) => {
                let poses: Vec<G> = custom.keys().iter().filter_map(at).collect();
                let mut residual = DVector::zeros(custom.dimension());
                custom.residual(&poses, residual.as_mut_slice());
                return residual.norm_squared();
            }
        };
        residual.map_or(0.0, |e| (e.transpose() * factor.information * e)[0])
    }

    /// The connected parts of the graph, ordered by their smallest key. Fixed poses join parts like any other.
    pub fn components(&self) -> Vec<Component> {
        let mut parent: Vec<u32> = (0..self.keys.len() as u32).collect();
        let mut anchored: Vec<bool> = self.fixed.clone();
        for (_, factor) in self.factors() {
            let keys = factor.keys();
            let slots: Vec<u32> = keys.iter().filter_map(|k| self.slots.get(k).copied()).collect();
            for pair in slots.windows(2) {
                union(&mut parent, pair[0], pair[1]);
            }
            if let (true, Some(slot)) = (factor.anchors(), slots.first()) {
                anchored[*slot as usize] = true;
            }
        }
        let mut groups: BTreeMap<u32, usize> = BTreeMap::new();
        let mut components: Vec<Component> = Vec::new();
        for (key, slot) in &self.slots {
            let root = find(&mut parent, *slot);
            let index = *groups.entry(root).or_insert_with(|| {
                components.push(Component { keys: Vec::new(), anchored: false });
                components.len() - 1
            });
            components[index].keys.push(*key);
            components[index].anchored |= anchored[*slot as usize];
        }
        components
    }

    /// Checks that the graph is one connected part.
    ///
    /// # Errors
    /// [`Error::EmptyGraph`], [`Error::Disconnected`] with the first pose that hangs loose.
    pub fn check_connected(&self) -> Result<(), Error> {
        let components = self.components();
        let root = components.first().and_then(|c| c.keys.first()).copied().ok_or(Error::EmptyGraph)?;
        match components.get(1).and_then(|c| c.keys.first().map(|key| (*key, c.keys.len()))) {
            Some((key, size)) => Err(Error::Disconnected { key, size, root }),
            None => Ok(()),
        }
    }

    /// Checks that every connected part is held in place by a prior or a fixed pose.
    ///
    /// # Errors
    /// [`Error::NoGauge`] with the smallest key of the first loose part.
    pub fn check_gauge(&self) -> Result<(), Error> {
        let loose = self.components().into_iter().find(|c| !c.anchored);
        match loose.and_then(|c| c.keys.first().map(|key| (*key, c.keys.len()))) {
            Some((key, size)) => Err(Error::NoGauge { key, size }),
            None => Ok(()),
        }
    }

    pub(crate) fn slot(&self, key: Key) -> Result<usize, Error> {
        self.slots.get(&key).map(|slot| *slot as usize).ok_or(Error::UnknownKey { key })
    }
}

pub(crate) fn find(parent: &mut [u32], mut x: u32) -> u32 {
    while parent[x as usize] != x {
        parent[x as usize] = parent[parent[x as usize] as usize];
        x = parent[x as usize];
    }
    x
}

pub(crate) fn union(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parent, a), find(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

fn check_pose<const N: usize, G: LieGroup<N>>(pose: &G, what: &'static str, key: Key) -> Result<(), Error> {
    if pose.log().iter().all(|x| x.is_finite()) { Ok(()) } else { Err(Error::NotFinite { what, key }) }
}

fn check_kernel(kernel: Kernel, key: Key) -> Result<(), Error> {
    if kernel.is_valid() { Ok(()) } else { Err(Error::KernelParameter { key }) }
}

/// Largest asymmetry, relative to the largest entry, that rounding in a file may leave.
const ASYMMETRY_TOLERANCE: f64 = 1e-9;

fn check_information<const N: usize>(information: &SMatrix<f64, N, N>, key: Key) -> Result<(), Error> {
    if !information.iter().all(|x| x.is_finite()) {
        return Err(Error::NotFinite { what: "information matrix", key });
    }
    let asymmetry = (information - information.transpose()).amax();
    if asymmetry > ASYMMETRY_TOLERANCE * information.amax()
        || Cholesky::<f64, Const<N>>::new(*information).is_none()
    {
        return Err(Error::Information { key });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector2};

    fn at(x: f64) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(x, 0.0), 0.0)
    }

    #[test]
    fn bad_input_is_named() {
        let mut g = PoseGraph2::new();
        let (a, b) = (Key::new(1, 0), Key::new(1, 1));
        g.add_pose(a, at(0.0)).unwrap();
        assert_eq!(g.add_pose(a, at(1.0)), Err(Error::DuplicateKey { key: a }));
        let omega = Matrix3::identity();
        assert_eq!(g.add_between(a, b, at(1.0), omega, Kernel::None), Err(Error::UnknownKey { key: b }));
        assert_eq!(g.add_between(a, a, at(1.0), omega, Kernel::None), Err(Error::SelfEdge { key: a }));
        assert!(matches!(g.add_pose(b, at(f64::NAN)), Err(Error::NotFinite { .. })));
        g.add_pose(b, at(1.0)).unwrap();
        let mut singular = omega;
        singular[(2, 2)] = 0.0;
        assert_eq!(g.add_between(a, b, at(1.0), singular, Kernel::None), Err(Error::Information { key: a }));
        assert_eq!(g.check_gauge(), Err(Error::NoGauge { key: a, size: 1 }));
        assert_eq!(g.check_connected(), Err(Error::Disconnected { key: b, size: 1, root: a }));
        let bad = Kernel::Cauchy(0.0);
        assert_eq!(g.add_between(a, b, at(1.0), omega, bad), Err(Error::KernelParameter { key: a }));
    }

    #[test]
    fn removing_a_pose_takes_its_factors_along() {
        let mut g = PoseGraph2::new();
        let keys: Vec<Key> = (0..3).map(|i| Key::new(0, i)).collect();
        for k in &keys {
            g.add_pose(*k, at(k.index as f64)).unwrap();
        }
        let omega = Matrix3::identity();
        let first = g.add_between(keys[0], keys[1], at(1.0), omega, Kernel::None).unwrap();
        let second = g.add_between(keys[1], keys[2], at(1.5), omega, Kernel::None).unwrap();
        assert_eq!(g.remove_pose(keys[0]).unwrap(), vec![first]);
        assert_eq!((g.pose_count(), g.factor_count()), (2, 1));
        assert!((g.chi2(second).unwrap() - 0.25).abs() < 1e-12);
        assert!(g.remove_factor(first).is_err());
    }
}

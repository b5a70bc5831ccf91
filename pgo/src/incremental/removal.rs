use std::sync::Arc;

use draco_lie::LieGroup;

use super::Incremental;
use crate::condense::{eliminate, extract};
use crate::quadratic::Quadratic;
use crate::{Error, FactorId, Kernel, Key};

impl<const N: usize, G: LieGroup<N>> Incremental<G, N> {
    /// Takes a pose out together with every factor on it, and what those said is lost; returns their ids. Poses that
    /// nothing holds then make the next update fail.
    ///
    /// Costs a pass over the tree, on top of what the removed factors make the next update do.
    ///
    /// # Errors
    /// [`Error::UnknownKey`].
    pub fn remove_pose(&mut self, key: Key) -> Result<Vec<FactorId>, Error> {
        let slot = self.graph.slot(key)? as u32;
        self.grow();
        let ids = self.factors_on(key);
        for id in &ids {
            self.remove_factor(*id)?;
        }
        if !self.graph.fixed[slot as usize] {
            // with the poses that shared a factor with this one no clique is left that holds it
            self.involved.push(slot);
            self.involved = self.tree.detach(&self.involved);
        }
        self.graph.remove_pose(key)?;
        self.remove_slot(slot);
        Ok(ids)
    }

    /// Takes a pose out and keeps what its factors say about the others: they are replaced by one factor, the
    /// quadratic model of their cost at the present estimates with the pose at its best. Estimates and covariances of
    /// the other poses stay what they are; from then on that model is not linearised anew, and kernels in it keep
    /// their present weights. Returns the new factor; `None` when the pose's factors named no other pose that can
    /// move.
    ///
    /// The new factor joins all poses that shared a factor with the one taken out, so taking out every pose but a few
    /// leaves those few densely joined. Best at the optimum: right after an [`Incremental::update`].
    ///
    /// # Errors
    /// [`Error::UnknownKey`]; [`Error::Indefinite`] when its factors do not determine the pose from the others.
    /// Nothing has changed then.
    pub fn marginalise(&mut self, key: Key) -> Result<Option<FactorId>, Error> {
        self.graph.slot(key)?;
        let part = extract(&self.graph, &self.factors_on(key))?;
        let around: Vec<Key> =
            part.poses().map(|(key, _)| key).filter(|k| *k != key && !part.is_fixed(*k)).collect();
        let poses: Vec<(Key, G)> =
            part.poses().filter(|(k, _)| around.contains(k)).map(|(k, pose)| (k, *pose)).collect();
        let factor = if around.is_empty() {
            None
        } else {
            let model = eliminate(&part, around)?;
            Quadratic::new(&poses, &model.information, &model.gradient)
        };
        self.remove_pose(key)?;
        factor.map(|factor| self.add_custom(Arc::new(factor), Kernel::None)).transpose()
    }

    fn factors_on(&self, key: Key) -> Vec<FactorId> {
        self.graph.factors().filter(|(_, factor)| factor.keys().contains(&key)).map(|(id, _)| id).collect()
    }

    /// Forgets a slot that the graph has given up; the slots after it move up.
    fn remove_slot(&mut self, slot: u32) {
        self.tree.remove_slot(slot);
        self.linearised.remove(slot as usize);
        self.touching.remove(slot as usize);
        for list in [&mut self.involved, &mut self.late, &mut self.drifted] {
            list.retain(|other| *other != slot);
        }
        let lists = [&mut self.involved, &mut self.late, &mut self.drifted].into_iter().flatten();
        let models = self.models.iter_mut().flat_map(|model| &mut model.slots);
        lists.chain(models).filter(|other| **other > slot).for_each(|other| *other -= 1);
        self.changed.clear();
        self.anchors.forget();
    }
}

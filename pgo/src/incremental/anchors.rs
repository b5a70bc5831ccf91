use draco_lie::LieGroup;

use crate::graph::{find, union};
use crate::{Error, FactorId, Measurement, PoseGraph};

/// Which poses are joined, and which parts are held in place; kept up to date as factors come.
#[derive(Debug, Clone, Default)]
pub(crate) struct Anchors {
    parent: Vec<u32>,
    /// By slot; of a part, the entry of its root counts.
    anchored: Vec<bool>,
    /// Whether something was removed, so that all must be found anew.
    outdated: bool,
}

impl Anchors {
    /// Tells that factors were removed.
    pub(crate) fn forget(&mut self) {
        self.outdated = true;
    }

    /// Takes in new factors, and all new poses of the graph.
    ///
    /// # Errors
    /// [`Error::NoGauge`] with the smallest key of a part that nothing holds in place.
    pub(crate) fn check<const N: usize, G: LieGroup<N>>(
        &mut self,
        graph: &PoseGraph<G, N>,
        new: &[FactorId],
    ) -> Result<(), Error> {
        let mut first_new = self.parent.len();
        if self.outdated {
            first_new = 0;
            self.parent.clear();
            self.anchored.clear();
        }
        for slot in self.parent.len()..graph.keys.len() {
            self.parent.push(slot as u32);
            self.anchored.push(graph.fixed[slot]);
        }
        if self.outdated {
            graph.factors().for_each(|(id, _)| self.join(graph, id));
        } else {
            new.iter().for_each(|id| self.join(graph, *id));
        }
        for slot in first_new..self.parent.len() {
            let root = find(&mut self.parent, slot as u32);
            if !self.anchored[root as usize] {
                self.outdated = true;
                return Err(self.loose(graph, root));
            }
        }
        self.outdated = false;
        Ok(())
    }

    fn join<const N: usize, G: LieGroup<N>>(&mut self, graph: &PoseGraph<G, N>, id: FactorId) {
        let Some(factor) = graph.factor(id) else { return };
        let slots: Vec<u32> =
            factor.keys().iter().filter_map(|key| graph.slot(*key).ok()).map(|slot| slot as u32).collect();
        let alone = matches!(factor.measurement, Measurement::Custom(_)) && slots.len() == 1;
        let anchor = alone || factor.anchors();
        let Some(first) = slots.first() else { return };
        let mut anchored = anchor;
        for slot in &slots {
            let root = find(&mut self.parent, *slot);
            anchored |= self.anchored[root as usize];
            union(&mut self.parent, *first, *slot);
        }
        let root = find(&mut self.parent, *first);
        self.anchored[root as usize] = anchored;
    }

    fn loose<const N: usize, G: LieGroup<N>>(&mut self, graph: &PoseGraph<G, N>, root: u32) -> Error {
        let part: Vec<usize> =
            (0..self.parent.len()).filter(|slot| find(&mut self.parent, *slot as u32) == root).collect();
        let key = part.iter().map(|slot| graph.keys[*slot]).min().unwrap_or_default();
        Error::NoGauge { key, size: part.len() }
    }
}

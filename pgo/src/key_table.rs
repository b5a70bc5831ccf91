use std::collections::BTreeMap;

use draco_lie::LieGroup;

use crate::{Error, Key, PoseGraph};

/// Finds the slots of many keys: where a robot's indices leave few gaps, by one look into a table.
pub(crate) struct KeyTable<'a> {
    slots: &'a BTreeMap<Key, u32>,
    /// Robot, its first index, and the slots of the indices from there on, or [`KeyTable::GAP`].
    robots: Vec<(u32, u64, Vec<u32>)>,
}

impl<'a> KeyTable<'a> {
    const GAP: u32 = u32::MAX;

    pub(crate) fn new<const N: usize, G: LieGroup<N>>(graph: &'a PoseGraph<G, N>) -> Self {
        let mut robots: Vec<(u32, u64, Vec<u32>)> = Vec::new();
        for (key, slot) in &graph.slots {
            let robot = key.robot;
            if robots.last().is_none_or(|last| last.0 != robot) {
                robots.push((robot, key.index, Vec::new()));
            }
            let Some((_, first, table)) = robots.last_mut() else { continue };
            // keys ascend, so the gap that this key would leave is known
            let at = key.index - *first;
            if at <= 2 * table.len() as u64 + 16 {
                table.resize(at as usize, Self::GAP);
                table.push(*slot);
            }
        }
        Self { slots: &graph.slots, robots }
    }

    pub(crate) fn slot(&self, key: Key) -> Result<u32, Error> {
        let robot = key.robot;
        let table = match self.robots.as_slice() {
            [only] if only.0 == robot => Some(only),
            many => many.binary_search_by_key(&robot, |r| r.0).ok().map(|at| &many[at]),
        };
        let inside = table.and_then(|(_, first, table)| {
            let at = usize::try_from(key.index.checked_sub(*first)?).ok()?;
            table.get(at).copied().filter(|slot| *slot != Self::GAP)
        });
        inside.or_else(|| self.slots.get(&key).copied()).ok_or(Error::UnknownKey { key })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry2;

    use super::*;

    #[test]
    fn the_table_knows_what_the_graph_knows() {
        let mut graph = PoseGraph::new();
        let indices = [3, 0, 1, 7, 90, 91, 1 << 40, (1 << 40) + 1, u64::MAX];
        for key in [5, 0, 70_000].iter().flat_map(|robot| indices.map(|index| Key::new(*robot, index))) {
            graph.add_pose(key, Isometry2::identity()).unwrap();
        }
        let table = KeyTable::new(&graph);
        for robot in [0, 1, 5, 70_000] {
            for index in (0..120).chain(indices).chain([(1 << 40) + 2]) {
                let key = Key::new(robot, index);
                assert_eq!(table.slot(key), graph.slot(key).map(|slot| slot as u32), "{key}");
            }
        }
    }
}

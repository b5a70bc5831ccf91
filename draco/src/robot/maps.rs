//! Maps as updates: what changed since the last version, on both ends.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::message::{CellMap, CellUpdate, ObjectEntry, ObjectUpdate};
use crate::objects::Object;

impl From<&Object> for ObjectEntry {
    fn from(object: &Object) -> Self {
        let Object { id, centroid, length, breadth, .. } = *object;
        ObjectEntry { id, centroid, length, breadth }
    }
}

/// The maps as others know them from this robot's updates.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct SentMaps {
    cell_version: u32,
    cells: BTreeSet<[i32; 2]>,
    object_version: u32,
    objects: BTreeMap<u32, ObjectEntry>,
}

impl SentMaps {
    /// Makes the next updates whole maps.
    pub(crate) fn forget(&mut self) {
        self.cells.clear();
        self.objects.clear();
    }

    pub(crate) fn cell_update(&mut self, map: &CellMap) -> CellUpdate {
        let cells: BTreeSet<[i32; 2]> = map.cells.iter().copied().collect();
        self.cell_version += 1;
        let update = CellUpdate {
            version: self.cell_version,
            whole: self.cells.is_empty(),
            size: map.size,
            keyframes: map.keyframes,
            added: cells.difference(&self.cells).copied().collect(),
            removed: self.cells.difference(&cells).copied().collect(),
        };
        self.cells = cells;
        update
    }

    /// What is new since the last update; `None` if nothing is.
    ///
    /// * `resend_m` – how far an object has to move, or its sides to change, to be worth telling, metres.
    pub(crate) fn object_update(&mut self, objects: &[Object], resend_m: f64) -> Option<ObjectUpdate> {
        let whole = self.objects.is_empty();
        let current: BTreeMap<u32, ObjectEntry> = objects.iter().map(|o| (o.id, o.into())).collect();
        let removed: Vec<u32> = self.objects.keys().filter(|id| !current.contains_key(id)).copied().collect();
        self.objects.retain(|id, _| current.contains_key(id));
        let mut changed = Vec::new();
        for (id, new) in current {
            let is_news = |old: &ObjectEntry| {
                (old.centroid - new.centroid).norm() > resend_m
                    || (old.length - new.length).abs().max((old.breadth - new.breadth).abs()) > 2.0 * resend_m
            };
            if self.objects.get(&id).is_none_or(is_news) {
                self.objects.insert(id, new.clone());
                changed.push(new);
            }
        }
        // an empty map is news to a partner that had asked for it whole
        let is_first = self.object_version == 0;
        if changed.is_empty() && removed.is_empty() && (is_first || !whole) {
            return None;
        }
        self.object_version += 1;
        Some(ObjectUpdate { version: self.object_version, whole, changed, removed })
    }
}

/// An update that does not apply to the version at hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mismatch;

/// Versions of a partner's cells kept at most until they are compared with; of more, half of them, evenly spaced, stay.
const MOST_VERSIONS: usize = 8;

/// A partner's maps, put together from its updates.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct ReceivedMaps {
    cell_version: u32,
    /// Row and column, the order in which cells are compared.
    cells: BTreeSet<(i32, i32)>,
    size: f64,
    keyframes: u32,
    /// Versions of the cells that have grown and have not been compared with yet.
    new_cells: Vec<CellMap>,
    object_version: u32,
    objects: BTreeMap<u32, ObjectEntry>,
    /// Whether whole maps have been asked for and have not come yet.
    pub(crate) asked: bool,
}

impl ReceivedMaps {
    /// The partner's cells, if there are any.
    pub(crate) fn cells(&self) -> Option<CellMap> {
        let cells = self.cells.iter().map(|&(row, column)| [column, row]).collect();
        (self.cell_version > 0).then_some(CellMap { size: self.size, keyframes: self.keyframes, cells })
    }

    /// The versions of the partner's cells, each of more keyframes than the one before, that have come since the last
    /// call, the newest one last; of more than `most`, as many evenly spaced.
    pub(crate) fn take_new_cells(&mut self, most: usize) -> Vec<CellMap> {
        let mut new = std::mem::take(&mut self.new_cells);
        let (count, parts) = (new.len(), most.max(1).min(new.len()));
        let chosen: BTreeSet<usize> = (1..=parts).map(|part| part * count / parts - 1).collect();
        let mut index = 0;
        new.retain(|_| {
            index += 1;
            chosen.contains(&(index - 1))
        });
        new
    }

    /// The partner's objects, ascending in number.
    pub(crate) fn objects(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.objects.values()
    }

    /// Versions of cells and objects; they only grow.
    pub(crate) fn versions(&self) -> (u32, u32) {
        (self.cell_version, self.object_version)
    }

    pub(crate) fn take_cells(&mut self, update: CellUpdate) -> Result<(), Mismatch> {
        let swap = |[column, row]: [i32; 2]| (row, column);
        let removed: Vec<_> = update.removed.into_iter().map(swap).collect();
        if update.whole && update.version > self.cell_version {
            self.cells.clear();
            self.asked = false;
        } else if Some(update.version) != self.cell_version.checked_add(1)
            || update.size != self.size
            || !removed.iter().all(|cell| self.cells.contains(cell))
        {
            return Err(Mismatch);
        }
        for cell in removed {
            self.cells.remove(&cell);
        }
        self.cells.extend(update.added.into_iter().map(swap));
        // a map told again is no news to those who did not ask for it
        let has_grown = update.keyframes > self.keyframes;
        (self.cell_version, self.size, self.keyframes) = (update.version, update.size, update.keyframes);
        if has_grown {
            self.new_cells.extend(self.cells());
        }
        if self.new_cells.len() > MOST_VERSIONS {
            self.new_cells = self.take_new_cells(MOST_VERSIONS / 2);
        }
        Ok(())
    }

    pub(crate) fn take_objects(&mut self, update: ObjectUpdate) -> Result<(), Mismatch> {
        if update.whole && update.version > self.object_version {
            self.objects.clear();
        } else if Some(update.version) != self.object_version.checked_add(1)
            || !update.removed.iter().all(|id| self.objects.contains_key(id))
        {
            return Err(Mismatch);
        }
        for id in &update.removed {
            self.objects.remove(id);
        }
        self.objects.extend(update.changed.into_iter().map(|object| (object.id, object)));
        self.object_version = update.version;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Point2};
    use proptest::prelude::*;

    use super::*;

    fn map(cells: &BTreeSet<[i32; 2]>) -> CellMap {
        CellMap { size: 2.0, keyframes: 5, cells: cells.iter().copied().collect() }
    }

    fn object(id: u32, x: f64) -> Object {
        let centroid = Point2::new(x, 0.0);
        let (covariance, corners) = (Matrix2::identity(), [centroid; 4]);
        Object { id, centroid, covariance, length: 4.0, breadth: 1.0, corners, keyframes: vec![0], points: 9 }
    }

    proptest! {
        #[test]
        fn updates_rebuild_every_version(
            versions in prop::collection::vec(prop::collection::btree_set((-4..4i32, -4..4i32).prop_map(|(a, b)| [a, b]), 0..12), 1..10),
            lost in prop::collection::vec(any::<bool>(), 10),
        ) {
            let (mut sent, mut received) = (SentMaps::default(), ReceivedMaps::default());
            for (cells, lost) in versions.iter().zip(lost) {
                let update = sent.cell_update(&map(cells));
                if lost {
                    continue;
                }
                if received.take_cells(update).is_err() {
                    sent.forget();
                    received.take_cells(sent.cell_update(&map(cells))).unwrap();
                }
                let there: BTreeSet<_> = received.cells().unwrap().cells.into_iter().collect();
                prop_assert_eq!(&there, cells);
            }
        }
    }

    #[test]
    fn new_versions_are_given_out_once_and_evenly() {
        let told = |counts: &[u32], most| {
            let (mut sent, mut received) = (SentMaps::default(), ReceivedMaps::default());
            for &keyframes in counts {
                let cells = (0..keyframes as i32).map(|k| [k, 0]).collect();
                let update = sent.cell_update(&CellMap { size: 2.0, keyframes, cells });
                received.take_cells(update).unwrap();
            }
            let new: Vec<u32> = received.take_new_cells(most).iter().map(|cells| cells.keyframes).collect();
            assert_eq!(received.take_new_cells(most), []);
            new
        };
        assert_eq!(told(&[5, 10, 15, 20, 25, 30], 3), [10, 20, 30]);
        assert_eq!(told(&[5, 10, 15], 0), [15]);
        assert_eq!(told(&[5, 10], 3), [5, 10]);
        // the same map once more
        assert_eq!(told(&[5, 10, 10], 3), [5, 10]);
        // more than are kept
        let long: Vec<u32> = (1..=100).collect();
        let kept = told(&long, 100);
        assert!(kept.len() <= MOST_VERSIONS && kept.last() == Some(&100), "{kept:?}");
    }

    #[test]
    fn only_what_changed_is_sent() {
        let (mut sent, mut received) = (SentMaps::default(), ReceivedMaps::default());
        let first = sent.object_update(&[object(1, 0.0), object(2, 10.0)], 0.5).unwrap();
        assert!(first.whole && first.changed.len() == 2);
        received.take_objects(first).unwrap();
        let second = sent.object_update(&[object(1, 0.4), object(3, 20.0)], 0.5).unwrap();
        assert_eq!(second.changed.iter().map(|o| o.id).collect::<Vec<_>>(), [3]);
        assert_eq!(second.removed, [2]);
        received.take_objects(second.clone()).unwrap();
        assert_eq!(received.objects().map(|o| o.id).collect::<Vec<_>>(), [1, 3]);
        assert_eq!(received.take_objects(second), Err(Mismatch));
        // small steps add up
        let third = sent.object_update(&[object(1, 0.6), object(3, 20.0)], 0.5).unwrap();
        assert_eq!(third.changed.len(), 1);
        assert_eq!(sent.object_update(&[object(1, 0.6), object(3, 20.0)], 0.5), None);
    }
}

use std::sync::{Arc, Mutex, PoisonError};

use crate::sparse::{Symbolic, minimum_fill};

/// Column of a pose that does not move.
pub(crate) const HELD: u32 = u32::MAX;

/// Which poses of a graph move, numbered as block columns, and which pairs of them factors join.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    /// Block column of each slot of the graph, or [`HELD`].
    pub(crate) columns: Vec<u32>,
    /// Slot of each block column, ascending.
    pub(crate) slots: Vec<u32>,
    /// Off-diagonal blocks as (row, column), the row the larger, each once, sorted.
    pub(crate) pairs: Vec<(u32, u32)>,
    /// All pairs of slots that are joined, those that do not move among them.
    joined: Vec<(u32, u32)>,
}

impl Pattern {
    /// * `held` – by slot, whether the pose stays.
    /// * `joints` – pairs of different slots, in any order and orientation.
    ///
    /// Returns with the pattern the index in [`Pattern::pairs`] of each joint, [`HELD`] where an end stays.
    pub(crate) fn new(
        held: impl IntoIterator<Item = bool>,
        joints: impl Iterator<Item = [u32; 2]>,
    ) -> (Self, Vec<u32>) {
        let mut slots = Vec::new();
        let columns: Vec<u32> = held
            .into_iter()
            .zip(0u32..)
            .map(|(held, slot)| {
                if held {
                    return HELD;
                }
                slots.push(slot);
                slots.len() as u32 - 1
            })
            .collect();
        let mut wanted: Vec<(u64, u32)> = joints
            .zip(0u32..)
            .map(|([a, b], index)| ((u64::from(a.max(b)) << 32) | u64::from(a.min(b)), index))
            .collect();
        wanted.sort_unstable();
        let mut places = vec![HELD; wanted.len()];
        let (mut pairs, mut joined) = (Vec::with_capacity(wanted.len()), Vec::with_capacity(wanted.len()));
        for (code, index) in wanted {
            let (row, column) = ((code >> 32) as u32, code as u32);
            let pair = (columns[row as usize], columns[column as usize]);
            let moves = pair.0 != HELD && pair.1 != HELD;
            if joined.last() != Some(&(row, column)) {
                joined.push((row, column));
                if moves {
                    pairs.push(pair);
                }
            }
            if moves {
                places[index as usize] = pairs.len() as u32 - 1;
            }
        }
        (Self { columns, slots, pairs, joined }, places)
    }

    /// Column of a pose that moves.
    pub(crate) fn column(&self, slot: u32) -> Option<usize> {
        Some(self.columns[slot as usize]).filter(|c| *c != HELD).map(|c| c as usize)
    }
}

/// The order in which the poses of a graph are eliminated and the patterns of the factors that follow from it, found
/// when first wanted and kept for whoever asks next: the chordal start, the solver, marginals, the certificate.
///
/// It only remembers: what it answers depends on the pattern asked for alone.
#[derive(Debug, Default)]
pub(crate) struct Elimination {
    known: Mutex<Known>,
}

#[derive(Debug, Clone, Default)]
struct Known {
    ordered: Option<Arc<Ordered>>,
    /// The last ones, [`KEPT`] at most.
    analysed: Vec<Arc<Analysed>>,
}

/// That of the solver, in which some poses stay, and that of the certificate, in which all move.
const KEPT: usize = 2;

/// An order of all poses; those that stay are passed over, which never adds fill.
#[derive(Debug)]
struct Ordered {
    nodes: usize,
    joined: Vec<(u32, u32)>,
    order: Vec<u32>,
}

#[derive(Debug)]
struct Analysed {
    slots: Vec<u32>,
    block: usize,
    symbolic: Arc<Symbolic>,
}

impl Clone for Elimination {
    /// A copy knows what the original knows.
    fn clone(&self) -> Self {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Self { known: Mutex::new(known) }
    }
}

impl Elimination {
    /// The pattern of the factor of a matrix with blocks at `pattern`, `block` scalars wide.
    pub(crate) fn symbolic(&self, pattern: &Pattern, block: usize) -> Arc<Symbolic> {
        let (free, nodes) = (pattern.slots.len(), pattern.columns.len());
        if 2 * free < nodes {
            // an order of all poses costs more than one of the few that move, and need not be good for them
            return Arc::new(Symbolic::new(free, &pattern.pairs, block));
        }
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let serves = |o: &&Arc<Ordered>| o.nodes == nodes && o.joined == pattern.joined;
        let ordered = match known.ordered.as_ref().filter(serves) {
            Some(ordered) => ordered.clone(),
            None => {
                let order = minimum_fill(nodes, &pattern.joined);
                let ordered = Arc::new(Ordered { nodes, joined: pattern.joined.clone(), order });
                *known = Known { ordered: Some(ordered.clone()), analysed: Vec::new() };
                ordered
            }
        };
        if let Some(found) = known.analysed.iter().find(|a| a.block == block && a.slots == pattern.slots) {
            return found.symbolic.clone();
        }
        let order = ordered.order.iter().map(|slot| pattern.columns[*slot as usize]);
        let order = order.filter(|column| *column != HELD).collect();
        let symbolic = Arc::new(Symbolic::with_order(order, &pattern.pairs, block));
        known.analysed.truncate(KEPT - 1);
        let analysed = Analysed { slots: pattern.slots.clone(), block, symbolic: symbolic.clone() };
        known.analysed.insert(0, Arc::new(analysed));
        symbolic
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn joints(nodes: u32, seed: u64) -> Vec<[u32; 2]> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let chain = (1..nodes).map(|i| [i - 1, i]);
        let mut more = Vec::new();
        while more.len() < nodes as usize / 2 {
            let [a, b] = [0; 2].map(|_| rng.random_range(0..nodes));
            more.extend((a != b).then_some([a, b]));
        }
        chain.chain(more).collect()
    }

    #[test]
    fn every_joint_knows_its_pair() {
        let joints = joints(40, 1);
        let held: Vec<bool> = (0..40).map(|slot| slot % 7 == 3).collect();
        let (pattern, places) = Pattern::new(held.iter().copied(), joints.iter().copied());
        for ([a, b], place) in joints.iter().zip(&places) {
            let ends = [*a, *b].map(|slot| held[slot as usize]);
            assert_eq!(*place == HELD, ends[0] || ends[1]);
            if *place != HELD {
                let (row, column) = pattern.pairs[*place as usize];
                let slots = [row, column].map(|c| pattern.slots[c as usize]);
                assert_eq!(slots, [*a.max(b), *a.min(b)]);
            }
        }
        assert!(pattern.pairs.is_sorted() && pattern.pairs.iter().all(|(row, column)| row > column));
        for (slot, held) in held.iter().enumerate() {
            assert_eq!(pattern.column(slot as u32).is_none(), *held);
        }
    }

    #[test]
    fn an_order_is_found_once_and_does_not_depend_on_what_was_asked_before() {
        let (first, _) = Pattern::new((0..60).map(|slot| slot == 0), joints(60, 2).into_iter());
        let (all, _) = Pattern::new([false; 60], joints(60, 2).into_iter());
        let (other, _) = Pattern::new((0..60).map(|slot| slot == 0), joints(60, 3).into_iter());
        let fresh = |pattern: &Pattern, block| Elimination::default().symbolic(pattern, block);
        let elimination = Elimination::default();
        let solver = elimination.symbolic(&first, 3);
        assert!(Arc::ptr_eq(&solver, &elimination.symbolic(&first, 3)));
        let certificate = elimination.symbolic(&all, 4);
        assert!(Arc::ptr_eq(&certificate, &elimination.symbolic(&all, 4)));
        assert!(Arc::ptr_eq(&solver, &elimination.clone().symbolic(&first, 3)));
        assert_eq!(certificate.order, fresh(&all, 4).order);
        assert_eq!(solver.order, fresh(&first, 3).order);
        assert_eq!(elimination.symbolic(&other, 3).order, fresh(&other, 3).order);
        assert_eq!(elimination.symbolic(&first, 3).order, solver.order);
    }
}

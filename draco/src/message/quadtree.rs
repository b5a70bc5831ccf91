//! Sets of cells of a lattice in few bits: a quadtree, level by level, in an adaptive arithmetic code.
//!
//! Each level tells which quarters of the squares before are occupied. What a quarter borders on is known from the level
//! before, and occupied quarters border on occupied squares: walls go on. The probability of a quarter is learnt for each
//! number of occupied squares that it borders on and of occupied quarters of its own square.
//!
//! Two bits and a half a cell for maps of a harbour, seven bits a point for scans thinned to half a metre.
//!
//! **Source**: octree coding of point clouds with neighbour-dependent contexts (D. Garcia, T. Fonseca, R. Ferreira, R.
//! de Queiroz, *Geometry coding for dynamic voxelized point clouds using octrees and multiple contexts*, 2020), in the
//! plane and with counts for contexts. The arithmetic coder is the range coder of `constriction`.

use std::borrow::Borrow;
use std::num::NonZeroU16;

use constriction::stream::model::{DecoderModel, EncoderModel, EntropyModel};
use constriction::stream::queue::{SmallRangeDecoder, SmallRangeEncoder};
use constriction::stream::{Decode, Encode};

/// Bits of a probability.
const PRECISION: usize = 12;
const ONE: u16 = 1 << PRECISION;

/// Cells of a set at most, so that no message makes a listener remember more.
const MOST_CELLS: usize = 1 << 16;

/// Levels at most: cells of 0.1 m within 100 km of the origin.
const MOST_LEVELS: u8 = 21;

/// What a quarter is counted under: the lowest level or one above, occupied squares that it borders on from outside its own,
/// occupied quarters of its own so far, whether it is the last.
const CONTEXTS: usize = 2 * 4 * 4 * 2;

/// Counts of a context past which both are halved, so that what came last counts most.
const MOST_COUNTED: u32 = 1024;

/// How often quarters were empty and occupied.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    empty: u32,
    occupied: u32,
}

impl Seen {
    /// Probability that the next one is empty, of [`ONE`]; with two fifths of a count more for each side (a
    /// Krichevsky-Trofimov estimate, a little bolder).
    fn empty(self) -> u16 {
        let (part, whole) = (5 * self.empty + 2, 5 * (self.empty + self.occupied) + 4);
        ((part << PRECISION) / whole).clamp(1, u32::from(ONE) - 1) as u16
    }

    fn count(&mut self, occupied: bool) {
        *(if occupied { &mut self.occupied } else { &mut self.empty }) += 1;
        if self.empty + self.occupied > MOST_COUNTED {
            *self = Seen { empty: self.empty / 2, occupied: self.occupied / 2 };
        }
    }

    fn interval(self, occupied: bool) -> (u16, NonZeroU16) {
        let empty = self.empty();
        let (left, size) = if occupied { (empty, ONE - empty) } else { (0, empty) };
        (left, NonZeroU16::new(size).unwrap_or(NonZeroU16::MIN))
    }
}

impl EntropyModel<PRECISION> for Seen {
    type Symbol = bool;
    type Probability = u16;
}

impl EncoderModel<PRECISION> for Seen {
    fn left_cumulative_and_probability(&self, symbol: impl Borrow<bool>) -> Option<(u16, NonZeroU16)> {
        Some(self.interval(*symbol.borrow()))
    }
}

impl DecoderModel<PRECISION> for Seen {
    fn quantile_function(&self, quantile: u16) -> (bool, u16, NonZeroU16) {
        let occupied = quantile >= self.empty();
        let (left, size) = self.interval(occupied);
        (occupied, left, size)
    }
}

/// Why bytes are no set of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corrupt;

/// Levels that a square of cells needs to hold these, and their code. `None` for more than [`MOST_CELLS`] or cells too far
/// out.
///
/// * `cells` – offsets from the lower left cell, in any order; equal ones count once.
pub(super) fn encode(cells: impl Iterator<Item = [u32; 2]>) -> Option<(u8, Vec<u8>)> {
    let mut widest = 0;
    let code = |[x, y]: [u32; 2]| {
        widest = x.max(y).max(widest);
        spread(x) << 1 | spread(y)
    };
    let mut codes: Vec<u64> = cells.map(code).collect();
    codes.sort_unstable();
    codes.dedup();
    let levels = (u32::BITS - widest.leading_zeros()) as u8;
    if levels > MOST_LEVELS || codes.len() > MOST_CELLS {
        return None;
    }
    let mut coder = SmallRangeEncoder::new();
    descend(levels, |level, quarter, seen| {
        let occupied = codes.binary_search_by_key(&quarter, |code| code >> (2 * level)).is_ok();
        if let Some(seen) = seen {
            coder.encode_symbol(occupied, *seen).map_err(|_| Corrupt)?;
        }
        Ok(occupied)
    })
    .ok()?;
    let words = coder.into_compressed().ok()?;
    Some((levels, words.into_iter().flat_map(u16::to_le_bytes).collect()))
}

/// The cells again, ascending in the order of the tree.
pub(super) fn decode(levels: u8, bytes: &[u8]) -> Result<Vec<[u32; 2]>, Corrupt> {
    if levels > MOST_LEVELS || !bytes.len().is_multiple_of(2) {
        return Err(Corrupt);
    }
    let words: Vec<u16> = bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    let mut coder = SmallRangeDecoder::from_compressed(words).map_err(|_| Corrupt)?;
    let codes = descend(levels, |_, _, seen| match seen {
        Some(seen) => coder.decode_symbol(*seen).map_err(|_| Corrupt),
        None => Ok(true),
    })?;
    if !coder.maybe_exhausted() {
        return Err(Corrupt);
    }
    Ok(codes.into_iter().map(|code| [gathered(code >> 1), gathered(code)]).collect())
}

/// Goes down the tree from one square, asking which quarters are occupied; of those the codes of the lowest level.
///
/// * `ask` – gets level, code of the quarter and what quarters like it were, `None` if it has to be occupied.
fn descend(
    levels: u8,
    mut ask: impl FnMut(u8, u64, Option<&Seen>) -> Result<bool, Corrupt>,
) -> Result<Vec<u64>, Corrupt> {
    let mut seen = [Seen::default(); CONTEXTS];
    let mut squares = vec![0];
    for level in (0..levels).rev() {
        let mut next = Vec::with_capacity(2 * squares.len());
        for &square in &squares {
            let around = Around::new(square, &squares);
            let mut found = 0;
            for place in 0..4 {
                let quarter = square << 2 | place;
                // a square without anything in it would not be there
                if place == 3 && found == 0 {
                    ask(level, quarter, None)?;
                    next.push(quarter);
                    continue;
                }
                let beside = around.beside(place);
                let context =
                    ((usize::from(level > 0) * 4 + beside) * 4 + found) * 2 + usize::from(place == 3);
                let occupied = ask(level, quarter, Some(&seen[context]))?;
                seen[context].count(occupied);
                if occupied {
                    found += 1;
                    next.push(quarter);
                }
            }
        }
        if next.len() > MOST_CELLS {
            return Err(Corrupt);
        }
        squares = next;
    }
    Ok(squares)
}

/// Which of the eight squares around one are occupied, `[x + 1][y + 1]`.
struct Around([[bool; 3]; 3]);

impl Around {
    /// * `squares` – ascending.
    fn new(square: u64, squares: &[u64]) -> Self {
        let mut occupied = [[false; 3]; 3];
        for (dx, row) in occupied.iter_mut().enumerate() {
            for (dy, cell) in row.iter_mut().enumerate() {
                let beside = shifted(square >> 1, dx).zip(shifted(square, dy));
                *cell = beside.is_some_and(|(x, y)| squares.binary_search(&(x << 1 | y)).is_ok());
            }
        }
        Around(occupied)
    }

    /// How many of the three squares that a quarter borders on from outside its own are occupied.
    fn beside(&self, place: u64) -> usize {
        let (x, y) = (2 * (place as usize >> 1), 2 * (place as usize & 1));
        [self.0[x][1], self.0[1][y], self.0[x][y]].into_iter().filter(|occupied| *occupied).count()
    }
}

/// Every second bit.
const EVEN: u64 = 0x5555_5555_5555_5555;

/// The even bits of a code, as a number of half as many bits, moved by `to - 1`; `None` below 0.
fn shifted(code: u64, to: usize) -> Option<u64> {
    let number = gathered(code);
    (number + to as u32).checked_sub(1).map(spread)
}

/// The bits of a number with a zero before each.
fn spread(number: u32) -> u64 {
    let mut code = u64::from(number);
    for (by, mask) in [
        (16, 0x0000_FFFF_0000_FFFF),
        (8, 0x00FF_00FF_00FF_00FF),
        (4, 0x0F0F_0F0F_0F0F_0F0F),
        (2, 0x3333_3333_3333_3333),
        (1, EVEN),
    ] {
        code = (code | code << by) & mask;
    }
    code
}

/// The even bits of a code.
fn gathered(code: u64) -> u32 {
    let mut number = code & EVEN;
    for (by, mask) in [
        (1, 0x3333_3333_3333_3333),
        (2, 0x0F0F_0F0F_0F0F_0F0F),
        (4, 0x00FF_00FF_00FF_00FF),
        (8, 0x0000_FFFF_0000_FFFF),
        (16, 0x0000_0000_FFFF_FFFF),
    ] {
        number = (number | number >> by) & mask;
    }
    number as u32
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    fn round_trip(cells: &BTreeSet<[u32; 2]>) -> usize {
        let (levels, bytes) = encode(cells.iter().copied()).expect("few cells, near");
        let back = decode(levels, &bytes).expect("just encoded");
        assert_eq!(back.len(), cells.len());
        assert_eq!(back.into_iter().collect::<BTreeSet<_>>(), *cells);
        bytes.len()
    }

    proptest! {
        #[test]
        fn every_set_comes_back(
            near in prop::collection::btree_set([0u32..40, 0u32..40], 1..300),
            far in prop::collection::btree_set([0u32..2_000_000, 0u32..2_000_000], 1..100),
        ) {
            round_trip(&near);
            round_trip(&far);
        }

        #[test]
        fn any_bytes_are_a_set_or_an_error(levels in any::<u8>(), bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(cells) = decode(levels, &bytes) {
                prop_assert!(!cells.is_empty() && cells.len() <= MOST_CELLS);
            }
        }
    }

    #[test]
    fn walls_take_few_bits() {
        // 400 cells of two walls with gaps
        let wall = |k: u32| [k, 30 + k / 3];
        let other = |k: u32| [90 + k / 7, k];
        let cells: BTreeSet<[u32; 2]> =
            (0..260).filter(|k| k % 11 > 2).flat_map(|k| [wall(k), other(k)]).collect();
        let bytes = round_trip(&cells);
        assert!(8 * bytes < 5 * cells.len(), "{bytes} bytes for {} cells", cells.len());
    }

    #[test]
    fn one_cell_and_a_full_square() {
        round_trip(&BTreeSet::from([[0, 0]]));
        let full: BTreeSet<[u32; 2]> = (0..64).flat_map(|x| (0..64).map(move |y| [x, y])).collect();
        assert!(round_trip(&full) < 40);
    }

    #[test]
    fn too_many_and_too_far_are_refused() {
        assert_eq!(encode([[0, 0], [1 << 21, 0]].into_iter()), None);
        assert_eq!(encode((0..=MOST_CELLS as u32).map(|k| [k % 300, k / 300])), None);
        let (levels, bytes) = encode((0..300).map(|k| [k, k * k % 97])).expect("few cells, near");
        assert_eq!(decode(levels + 20, &bytes), Err(Corrupt));
        assert_eq!(decode(levels, &bytes[..bytes.len() - 1]), Err(Corrupt));
        let longer = [bytes.as_slice(), &[1; 8]].concat();
        assert_eq!(decode(levels, &longer), Err(Corrupt));
    }
}

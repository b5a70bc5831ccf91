//! Bit rows of a small graph whose width is known to the compiler.

use crate::graph::{
    Adjacency,
    bit_matrix::{Apart, BitMatrix},
    bits::iter_word,
};

/// A set of vertices as `W` words.
pub(super) type Set<const W: usize> = [u64; W];

pub(super) const fn empty<const W: usize>() -> Set<W> {
    [0; W]
}

#[inline(always)]
pub(super) fn first<const W: usize>(set: &Set<W>) -> Option<usize> {
    for (block, &word) in set.iter().enumerate() {
        if word != 0 {
            return Some(64 * block + word.trailing_zeros() as usize);
        }
    }
    None
}

#[inline(always)]
pub(super) fn is_empty<const W: usize>(set: &Set<W>) -> bool {
    set.iter().fold(0, |all, word| all | word) == 0
}

/// The first `n` vertices.
pub(super) fn full<const W: usize>(n: usize) -> Set<W> {
    let mut all = empty::<W>();
    (0..n).for_each(|v| put(&mut all, v));
    all
}

/// Whether a set, known not to be empty, has one member.
#[inline(always)]
pub(super) fn is_single<const W: usize>(set: &Set<W>) -> bool {
    if W <= 2 {
        return count(set) == 1;
    }
    let words = set.iter().map(|&word| u64::from(word != 0)).sum::<u64>();
    words == 1 && set.iter().fold(0, |more, word| more | word & word.wrapping_sub(1)) == 0
}

/// The vertices that are taken when each in turn is, unless it is joined to one taken before; `adjacent` rows hold
/// their own vertex too.
#[inline(always)]
pub(super) fn stable<const W: usize>(candidates: &Set<W>, adjacent: &[Set<W>]) -> Set<W> {
    let (mut free, mut stable) = (*candidates, empty::<W>());
    for block in 0..W {
        while free[block] != 0 {
            let bit = free[block].trailing_zeros() as usize;
            stable[block] |= 1 << bit;
            free = and_not(&free, &adjacent[64 * block + bit]);
        }
    }
    stable
}

#[inline(always)]
pub(super) fn and<const W: usize>(a: &Set<W>, b: &Set<W>) -> Set<W> {
    std::array::from_fn(|i| a[i] & b[i])
}

#[inline(always)]
pub(super) fn and_not<const W: usize>(a: &Set<W>, b: &Set<W>) -> Set<W> {
    std::array::from_fn(|i| a[i] & !b[i])
}

#[inline(always)]
pub(super) fn or<const W: usize>(a: &Set<W>, b: &Set<W>) -> Set<W> {
    std::array::from_fn(|i| a[i] | b[i])
}

#[inline(always)]
pub(super) fn count<const W: usize>(set: &Set<W>) -> u32 {
    set.iter().map(|word| word.count_ones()).sum()
}

#[inline(always)]
pub(super) fn has<const W: usize>(set: &Set<W>, v: usize) -> bool {
    set[(v / 64) % W] >> (v % 64) & 1 == 1
}

#[inline(always)]
pub(super) fn put<const W: usize>(set: &mut Set<W>, v: usize) {
    set[(v / 64) % W] |= 1 << (v % 64);
}

#[inline(always)]
pub(super) fn drop<const W: usize>(set: &mut Set<W>, v: usize) {
    set[(v / 64) % W] &= !(1 << (v % 64));
}

/// Members in ascending order.
#[inline]
pub(super) fn members<const W: usize>(set: Set<W>) -> impl Iterator<Item = usize> {
    set.into_iter().enumerate().flat_map(|(block, word)| iter_word(word).map(move |bit| 64 * block + bit))
}

/// Rows of `W` words, at least as many as those of `matrix`, that hold their own vertex too.
pub(super) fn closed<const W: usize>(matrix: &BitMatrix) -> Vec<Set<W>> {
    let wide = |v: usize| {
        let mut set = empty::<W>();
        // word by word: a copy of unknown length would be a call
        set.iter_mut().zip(matrix.row(v)).for_each(|(wide, &word)| *wide = word);
        put(&mut set, v);
        set
    };
    (0..matrix.len()).map(wide).collect()
}

/// The same, of the vertices that each is not joined to.
pub(super) fn complement<const W: usize>(matrix: &BitMatrix) -> Vec<Set<W>> {
    let all = full::<W>(matrix.len());
    closed(matrix).iter().map(|near| and_not(&all, near)).collect()
}

/// The edges of a complement as rows.
pub(super) fn spread<const W: usize>(apart: &Apart) -> Vec<Set<W>> {
    let row = |v: usize| {
        let mut set = empty::<W>();
        apart.of(v).iter().for_each(|&u| put(&mut set, u as usize));
        set
    };
    (0..apart.len()).map(row).collect()
}

/// Calls a function generic over the number of words with the least width that holds `$words` words.
macro_rules! with_width {
    ($words:expr, $call:ident ( $($argument:expr),* )) => {
        match $words {
            0 | 1 => $call::<1>($($argument),*),
            2 => $call::<2>($($argument),*),
            3 => $call::<3>($($argument),*),
            4 => $call::<4>($($argument),*),
            5 => $call::<5>($($argument),*),
            6 => $call::<6>($($argument),*),
            7 => $call::<7>($($argument),*),
            8 => $call::<8>($($argument),*),
            9..=12 => $call::<12>($($argument),*),
            13..=16 => $call::<16>($($argument),*),
            17..=32 => $call::<32>($($argument),*),
            _ => $call::<{ crate::clique::rows::MAX_WORDS }>($($argument),*),
        }
    };
}
pub(super) use with_width;

/// The width that [`with_width`] takes for `words` words.
pub(super) const fn width(words: usize) -> usize {
    match words {
        0 | 1 => 1,
        2..=8 => words,
        9..=12 => 12,
        13..=16 => 16,
        17..=32 => 32,
        _ => MAX_WORDS,
    }
}

/// Widest search; larger graphs are split by vertex first.
pub(super) const MAX_WORDS: usize = 64;

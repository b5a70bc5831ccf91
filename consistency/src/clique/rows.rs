//! Bit rows of a small graph whose width is known to the compiler.

use crate::graph::bits;

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

#[inline(always)]
pub(super) fn and<const W: usize>(a: &Set<W>, b: &Set<W>) -> Set<W> {
    std::array::from_fn(|i| a[i] & b[i])
}

#[inline(always)]
pub(super) fn and_not<const W: usize>(a: &Set<W>, b: &Set<W>) -> Set<W> {
    std::array::from_fn(|i| a[i] & !b[i])
}

#[inline(always)]
pub(super) fn put<const W: usize>(set: &mut Set<W>, v: usize) {
    set[(v / 64) % W] |= 1 << (v % 64);
}

#[inline(always)]
pub(super) fn drop<const W: usize>(set: &mut Set<W>, v: usize) {
    set[(v / 64) % W] &= !(1 << (v % 64));
}

/// Square bit matrix of run-time width: the graph between the reduction and the search.
#[derive(Clone, Debug)]
pub(super) struct BitMatrix {
    pub(super) n: usize,
    pub(super) words: usize,
    rows: Vec<u64>,
}

impl BitMatrix {
    pub(super) fn new(n: usize) -> Self {
        let words = bits::words_for(n);
        Self { n, words, rows: vec![0; n * words] }
    }

    /// The graph that `graph` induces on `vertices`, in their order. `place` is scratch for `graph.len()` numbers.
    pub(super) fn induced<A: crate::graph::Adjacency>(graph: &A, vertices: &[usize]) -> Self {
        let mut place = vec![u32::MAX; graph.len()];
        vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
        let mut matrix = Self::new(vertices.len());
        for (i, &v) in vertices.iter().enumerate() {
            let row = matrix.row_mut(i);
            graph
                .neighbors(v)
                .filter(|&u| place[u] != u32::MAX)
                .for_each(|u| bits::insert(row, place[u] as usize));
        }
        matrix
    }

    pub(super) fn row(&self, v: usize) -> &[u64] {
        &self.rows[v * self.words..(v + 1) * self.words]
    }

    fn row_mut(&mut self, v: usize) -> &mut [u64] {
        &mut self.rows[v * self.words..(v + 1) * self.words]
    }

    /// Rows of `W >= words` words.
    pub(super) fn widened<const W: usize>(&self) -> Vec<Set<W>> {
        (0..self.n)
            .map(|v| {
                let mut set = empty::<W>();
                set[..self.words].copy_from_slice(self.row(v));
                set
            })
            .collect()
    }

    /// The graph induced on `vertices`, in their order.
    pub(super) fn select(&self, vertices: &[usize]) -> Self {
        let mut place = vec![u32::MAX; self.n];
        vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
        let mut part = Self::new(vertices.len());
        for (i, &v) in vertices.iter().enumerate() {
            let row = &mut part.rows[i * part.words..(i + 1) * part.words];
            for u in bits::iter(self.row(v)) {
                if place[u] != u32::MAX {
                    bits::insert(row, place[u] as usize);
                }
            }
        }
        part
    }
}

impl crate::graph::Adjacency for BitMatrix {
    fn len(&self) -> usize {
        self.n
    }

    fn neighbors(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        bits::iter(self.row(vertex))
    }

    fn degree(&self, vertex: usize) -> usize {
        bits::count(self.row(vertex))
    }

    fn has_edge(&self, a: usize, b: usize) -> bool {
        bits::has(self.row(a), b)
    }

    fn weight(&self, _: usize) -> f64 {
        1.0
    }
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

/// Widest search; larger graphs are split by vertex first.
pub(super) const MAX_WORDS: usize = 64;

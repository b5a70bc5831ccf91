//! Bit rows of a small graph whose width is known to the compiler.

use crate::graph::{Adjacency, Graph, bits, degeneracy};

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
    let (mut seen, mut more) = (false, false);
    for &word in set {
        more |= (seen && word != 0) || word & word.wrapping_sub(1) != 0;
        seen |= word != 0;
    }
    !more
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

    /// The graph that `graph` induces on `vertices`, in their order.
    pub(super) fn induced<A: Adjacency>(graph: &A, vertices: &[usize]) -> Self {
        Self::induced_with(graph, vertices, &mut vec![u32::MAX; graph.len()])
    }

    /// The same with scratch: `place` is `u32::MAX` for every vertex, before and after.
    pub(super) fn induced_with<A: Adjacency>(graph: &A, vertices: &[usize], place: &mut [u32]) -> Self {
        vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
        let mut matrix = Self::new(vertices.len());
        for (i, &v) in vertices.iter().enumerate() {
            let row = &mut matrix.rows[i * matrix.words..(i + 1) * matrix.words];
            for u in graph.neighbors(v).filter(|&u| place[u] != u32::MAX) {
                bits::insert(row, place[u] as usize);
            }
        }
        vertices.iter().for_each(|&v| place[v] = u32::MAX);
        matrix
    }

    /// The graph that a graph in bit rows induces on `vertices`, in their order.
    pub(super) fn within(graph: &Graph, vertices: &[usize]) -> Self {
        let mut place = vec![u32::MAX; graph.len()];
        let mut inside = vec![0; bits::words_for(graph.len())];
        for (i, &v) in vertices.iter().enumerate() {
            place[v] = i as u32;
            bits::insert(&mut inside, v);
        }
        let mut part = Self::new(vertices.len());
        for (row, &v) in part.rows.chunks_exact_mut(part.words.max(1)).zip(vertices) {
            for (block, (word, mask)) in graph.row(v).iter().zip(&inside).enumerate() {
                let mut rest = word & mask;
                while rest != 0 {
                    bits::insert(row, place[64 * block + rest.trailing_zeros() as usize] as usize);
                    rest &= rest - 1;
                }
            }
        }
        part
    }

    /// The graph induced on `vertices` of a graph in rows of fixed width, in their order.
    pub(super) fn part<const W: usize>(adjacent: &[Set<W>], vertices: &[usize]) -> Self {
        let mut place = vec![u32::MAX; 64 * W];
        let mut within = empty::<W>();
        for (i, &v) in vertices.iter().enumerate() {
            place[v] = i as u32;
            put(&mut within, v);
        }
        let mut part = Self::new(vertices.len());
        for (row, &v) in part.rows.chunks_exact_mut(part.words.max(1)).zip(vertices) {
            let mut near = and(&adjacent[v], &within);
            drop(&mut near, v);
            bits::iter(&near).for_each(|u| bits::insert(row, place[u] as usize));
        }
        part
    }

    pub(super) fn row(&self, v: usize) -> &[u64] {
        &self.rows[v * self.words..(v + 1) * self.words]
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

    /// Rows of `W >= words` words that hold their own vertex too.
    pub(super) fn closed<const W: usize>(&self) -> Vec<Set<W>> {
        let mut rows = self.widened::<W>();
        rows.iter_mut().enumerate().for_each(|(v, row)| put(row, v));
        rows
    }

    /// Share of the vertex pairs that are joined, about.
    pub(super) fn density(&self) -> f64 {
        2.0 * self.edge_count() as f64 / (self.n * self.n).max(1) as f64
    }

    /// The order of colouring: vertices of the densest core first; with weights, those that keep the heaviest
    /// neighbourhoods when the one with the lightest leaves again and again.
    pub(super) fn order(&self, weights: &[u64]) -> Vec<usize> {
        let counted = weights.iter().all(|&w| w == 1);
        let mut order = if counted { degeneracy(self).order } else { self.order_by_weight(weights) };
        order.reverse();
        order
    }

    fn order_by_weight(&self, weights: &[u64]) -> Vec<usize> {
        let mut around: Vec<u64> = (0..self.n).map(|v| self.around(weights, v)).collect();
        let mut left: Vec<usize> = (0..self.n).collect();
        let mut order = Vec::with_capacity(self.n);
        while let Some(at) = (0..left.len()).min_by_key(|&i| (around[left[i]], left[i])) {
            let v = left.swap_remove(at);
            self.neighbors(v).for_each(|u| around[u] = around[u].saturating_sub(weights[v]));
            order.push(v);
        }
        order
    }

    /// Weight of all neighbours.
    fn around(&self, weights: &[u64], v: usize) -> u64 {
        self.neighbors(v).map(|u| weights[u]).sum()
    }

    /// The order without vertices that are in no clique heavier than `lower`.
    pub(super) fn order_above(&self, weights: &[u64], lower: u64) -> Vec<usize> {
        let mut order = self.order(weights);
        if weights.iter().all(|&w| w == 1) {
            order.retain(|&v| 1 + self.degree(v) as u64 > lower);
        } else {
            order.retain(|&v| weights[v] > 0 && weights[v] + self.around(weights, v) > lower);
        }
        order
    }

    /// The graph induced on `vertices`, in their order.
    pub(super) fn select(&self, vertices: &[usize]) -> Self {
        let mut place = vec![0u32; self.n];
        let mut mask = vec![0; self.words];
        for (i, &v) in vertices.iter().enumerate() {
            place[v] = i as u32;
            bits::insert(&mut mask, v);
        }
        let mut part = Self::new(vertices.len());
        for (&v, row) in vertices.iter().zip(part.rows.chunks_exact_mut(part.words.max(1))) {
            for (block, (word, mask)) in self.row(v).iter().zip(&mask).enumerate() {
                let mut rest = word & mask;
                while rest != 0 {
                    bits::insert(row, place[64 * block + rest.trailing_zeros() as usize] as usize);
                    rest &= rest - 1;
                }
            }
        }
        part
    }
}

impl Adjacency for BitMatrix {
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

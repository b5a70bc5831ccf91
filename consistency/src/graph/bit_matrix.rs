use pulp::{Arch, NullaryFnOnce};

use super::{Adjacency, bits};

/// Square matrix of bits, symmetric and empty on its diagonal: edges alone, one row a vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BitMatrix {
    vertices: usize,
    words: usize,
    rows: Vec<u64>,
}

impl BitMatrix {
    pub(crate) fn new(vertices: usize) -> Self {
        let words = bits::words_for(vertices);
        Self { vertices, words, rows: vec![0; vertices * words] }
    }

    /// Words of a row.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    /// Neighbours of a known vertex as a set of bits.
    #[inline]
    pub(crate) fn row(&self, v: usize) -> &[u64] {
        &self.rows[v * self.words..(v + 1) * self.words]
    }

    /// The same, empty for an unknown vertex.
    #[inline]
    pub(crate) fn known_row(&self, v: usize) -> &[u64] {
        if v < self.vertices { self.row(v) } else { &[] }
    }

    #[inline]
    fn row_mut(&mut self, v: usize) -> &mut [u64] {
        &mut self.rows[v * self.words..(v + 1) * self.words]
    }

    /// Joins two known vertices.
    #[inline]
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        self.direct(a, b);
        self.direct(b, a);
    }

    /// One half of [`BitMatrix::join`].
    #[inline]
    pub(super) fn direct(&mut self, from: usize, to: usize) {
        bits::insert(&mut self.rows, 64 * self.words * from + to);
    }

    /// Parts two known vertices.
    pub(crate) fn part(&mut self, a: usize, b: usize) {
        bits::remove(self.row_mut(a), b);
        bits::remove(self.row_mut(b), a);
    }

    /// Adds a vertex without edges. Amortised cost `O(n/64)`.
    pub(crate) fn push(&mut self) {
        if bits::words_for(self.vertices + 1) > self.words {
            self.widen((2 * self.words).max(1));
        }
        self.vertices += 1;
        self.rows.resize(self.vertices * self.words, 0);
    }

    fn widen(&mut self, words: usize) {
        let mut rows = vec![0; self.vertices * words];
        if self.words > 0 {
            for (wide, narrow) in rows.chunks_exact_mut(words).zip(self.rows.chunks_exact(self.words)) {
                wide[..self.words].copy_from_slice(narrow);
            }
        }
        self.rows = rows;
        self.words = words;
    }

    /// Any graph as bit rows.
    pub(crate) fn of<A: Adjacency>(graph: &A) -> Self {
        let mut matrix = Self::new(graph.len());
        for v in 0..graph.len() {
            let row = matrix.row_mut(v);
            graph.neighbors(v).for_each(|u| bits::insert(row, u));
        }
        matrix
    }

    /// The graph that `graph` induces on `vertices`, in their order.
    pub(crate) fn induced<A: Adjacency>(graph: &A, vertices: &[usize]) -> Self {
        Self::induced_with(graph, vertices, &mut vec![u32::MAX; graph.len()])
    }

    /// The same with scratch: `place` is `u32::MAX` for every vertex, before and after.
    pub(crate) fn induced_with<A: Adjacency>(graph: &A, vertices: &[usize], place: &mut [u32]) -> Self {
        vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
        let mut matrix = Self::new(vertices.len());
        for (i, &v) in vertices.iter().enumerate() {
            let row = matrix.row_mut(i);
            graph.neighbors(v).map(|u| place[u]).for_each(|u| {
                if u != u32::MAX {
                    bits::insert(row, u as usize);
                }
            });
        }
        vertices.iter().for_each(|&v| place[v] = u32::MAX);
        matrix
    }

    /// The graph that this one induces on `vertices`, in their order. Cost `O(k²)` for `k` of them, eight pairs in a
    /// few instructions where the machine has wide ones.
    pub(crate) fn select(&self, vertices: &[usize]) -> Self {
        Arch::new().dispatch(Select { matrix: self, vertices })
    }

    /// Which of `vertices`, ascending, are not joined to which others of them; numbers count within `vertices`.
    pub(crate) fn apart(&self, vertices: &[usize]) -> Apart {
        let mut place = vec![0u32; 64 * self.words];
        let mut inside = vec![0; self.words];
        for (i, &v) in vertices.iter().enumerate() {
            place[v] = i as u32;
            bits::insert(&mut inside, v);
        }
        let mut apart = Apart { ends: Vec::with_capacity(vertices.len()), others: Vec::new() };
        for &v in vertices {
            bits::remove(&mut inside, v);
            for (block, (word, mask)) in self.row(v).iter().zip(&inside).enumerate() {
                let mut missing = mask & !word;
                while missing != 0 {
                    apart.others.push(place[64 * block + missing.trailing_zeros() as usize]);
                    missing &= missing - 1;
                }
            }
            bits::insert(&mut inside, v);
            apart.ends.push(apart.others.len());
        }
        apart
    }

    /// Which vertices are not joined to which.
    pub(crate) fn apart_all(&self) -> Apart {
        self.apart(&(0..self.vertices).collect::<Vec<usize>>())
    }
}

struct Count<'a>(&'a [u64]);

impl NullaryFnOnce for Count<'_> {
    type Output = usize;

    #[inline(always)]
    fn call(self) -> usize {
        bits::count(self.0)
    }
}

struct Select<'a> {
    matrix: &'a BitMatrix,
    vertices: &'a [usize],
}

impl NullaryFnOnce for Select<'_> {
    type Output = BitMatrix;

    #[inline(always)]
    fn call(self) -> BitMatrix {
        let Self { matrix, vertices } = self;
        let mut part = BitMatrix::new(vertices.len());
        // Equal words of the chosen rows lie side by side, so that one shift takes the same bit out of several: a
        // column of the part, which is a row as well.
        let mut columns = vec![[0u64; 64]; matrix.words * part.words];
        for (i, &v) in vertices.iter().enumerate() {
            let own = columns.iter_mut().skip(i / 64).step_by(part.words);
            own.zip(matrix.row(v)).for_each(|(column, &word)| column[i % 64] = word);
        }
        for (i, &v) in vertices.iter().enumerate() {
            let own = &columns[v / 64 * part.words..];
            for (word, column) in part.row_mut(i).iter_mut().zip(own) {
                *word = (0..64).fold(0, |all, row| all | (column[row] >> (v % 64) & 1) << row);
            }
        }
        part
    }
}

/// Edges of a complement as lists, one after the other.
#[derive(Clone, Debug, Default)]
pub(crate) struct Apart {
    pub(crate) ends: Vec<usize>,
    pub(crate) others: Vec<u32>,
}

impl Apart {
    /// Number of vertices.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Vertices that `v` is not joined to.
    #[inline]
    pub(crate) fn of(&self, v: usize) -> &[u32] {
        let begin = if v == 0 { 0 } else { self.ends[v - 1] };
        &self.others[begin..self.ends[v]]
    }
}

impl Adjacency for BitMatrix {
    #[inline]
    fn len(&self) -> usize {
        self.vertices
    }

    #[inline]
    fn neighbors(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        bits::iter(self.known_row(vertex))
    }

    #[inline]
    fn degree(&self, vertex: usize) -> usize {
        bits::count(self.known_row(vertex))
    }

    #[inline]
    fn has_edge(&self, a: usize, b: usize) -> bool {
        bits::has(self.known_row(a), b)
    }

    #[inline]
    fn weight(&self, _: usize) -> f64 {
        1.0
    }

    fn edge_count(&self) -> usize {
        Arch::new().dispatch(Count(&self.rows)) / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_vertices_have_no_neighbours() {
        let mut matrix = BitMatrix::new(3);
        matrix.join(0, 2);
        assert_eq!((matrix.neighbors(3).count(), matrix.degree(64)), (0, 0));
        assert!(!matrix.has_edge(3, 0) && !matrix.has_edge(0, 64) && matrix.has_edge(2, 0));
    }

    #[test]
    fn complement_of_a_part_is_what_is_not_joined() {
        let mut matrix = BitMatrix::new(130);
        let joined = |a: usize, b: usize| (7 * a + 11 * b + a * b).is_multiple_of(3);
        (0..130).for_each(|a| (0..a).filter(|&b| joined(a, b)).for_each(|b| matrix.join(a, b)));
        let part: Vec<usize> = (0..130).filter(|v| v % 5 != 1).collect();
        let apart = matrix.apart(&part);
        for (i, &a) in part.iter().enumerate() {
            let others = (0..part.len()).filter(|&j| j != i && !joined(a.max(part[j]), a.min(part[j])));
            let others: Vec<u32> = others.map(|j| j as u32).collect();
            assert_eq!(apart.of(i), others);
        }
        assert_eq!(apart.len(), part.len());
    }
}

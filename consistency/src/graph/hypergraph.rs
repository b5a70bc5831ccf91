use super::bits;
use crate::Error;

/// Hypergraph whose edges all join `k` vertices.
///
/// For every set of `k - 1` vertices one row of bits tells which vertices complete it to an edge. Rows are kept in
/// colexicographic order, so a vertex added at the end only appends rows. Memory is `C(n, k-1) · n/8` bytes, at
/// most [`Hypergraph::MAX_BYTES`].
#[derive(Clone, Debug, PartialEq)]
pub struct Hypergraph {
    vertices: usize,
    order: usize,
    words: usize,
    rows: Vec<u64>,
    /// `binomial[i][v]` is `C(v, i + 1)`: the rank of a sorted set is the sum over its members.
    binomial: Vec<Vec<usize>>,
}

impl Hypergraph {
    /// Largest memory of the rows.
    pub const MAX_BYTES: usize = 1 << 30;

    /// A hypergraph of `vertices` vertices, edges of `order` vertices, and no edge yet.
    ///
    /// # Errors
    /// [`Error::EdgeOrder`] for an order below two, [`Error::TooManyVertices`] above [`Hypergraph::MAX_BYTES`].
    pub fn new(vertices: usize, order: usize) -> Result<Self, Error> {
        if order < 2 {
            return Err(Error::EdgeOrder { order, given: order });
        }
        let mut graph =
            Self { vertices: 0, order, words: 0, rows: Vec::new(), binomial: vec![Vec::new(); order] };
        graph.grow(vertices)?;
        Ok(graph)
    }

    /// A hypergraph with these edges, each a list of `order` different vertices in any order.
    ///
    /// # Errors
    /// [`Error::EdgeOrder`], [`Error::UnknownVertex`], [`Error::SelfLoop`], [`Error::TooManyVertices`].
    ///
    /// ```
    /// use draco_consistency::graph::Hypergraph;
    /// let graph = Hypergraph::from_edges(4, 3, [[0, 1, 2], [1, 3, 2]])?;
    /// assert!(graph.has_edge(&[2, 1, 0]) && !graph.has_edge(&[0, 1, 3]));
    /// # Ok::<(), draco_consistency::Error>(())
    /// ```
    pub fn from_edges<E: AsRef<[usize]>>(
        vertices: usize,
        order: usize,
        edges: impl IntoIterator<Item = E>,
    ) -> Result<Self, Error> {
        let mut graph = Self::new(vertices, order)?;
        for edge in edges {
            graph.add_edge(edge.as_ref())?;
        }
        Ok(graph)
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.vertices
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.vertices == 0
    }

    /// Number of vertices of an edge, `k`.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Number of edges.
    pub fn edge_count(&self) -> usize {
        bits::count(&self.rows) / self.order
    }

    /// Adds a vertex without edges and returns its number.
    ///
    /// # Errors
    /// [`Error::TooManyVertices`].
    pub fn add_vertex(&mut self) -> Result<usize, Error> {
        self.grow(self.vertices + 1)?;
        Ok(self.vertices - 1)
    }

    /// Adds an edge; says whether it is new.
    ///
    /// # Errors
    /// [`Error::EdgeOrder`], [`Error::UnknownVertex`], [`Error::SelfLoop`] for a vertex named twice.
    pub fn add_edge(&mut self, edge: &[usize]) -> Result<bool, Error> {
        let sorted = self.checked(edge)?;
        let new = !self.has_edge(&sorted);
        self.write(&sorted, bits::insert);
        Ok(new)
    }

    /// Adds an edge of known vertices in ascending order.
    pub(crate) fn join(&mut self, sorted: &[usize]) {
        self.write(sorted, bits::insert);
    }

    /// Removes an edge; says whether it was there.
    ///
    /// # Errors
    /// As [`Hypergraph::add_edge`].
    pub fn remove_edge(&mut self, edge: &[usize]) -> Result<bool, Error> {
        let sorted = self.checked(edge)?;
        let had = self.has_edge(&sorted);
        self.write(&sorted, bits::remove);
        Ok(had)
    }

    /// Whether these vertices, in any order, are an edge; false for a set that cannot be one.
    pub fn has_edge(&self, edge: &[usize]) -> bool {
        self.checked(edge)
            .is_ok_and(|sorted| bits::has(self.row(&sorted[..self.order - 1]), sorted[self.order - 1]))
    }

    /// Whether every `k` of these vertices are an edge and none is named twice or unknown. A set of fewer than `k`
    /// vertices holds no such `k`, so it passes.
    pub fn is_clique(&self, vertices: &[usize]) -> bool {
        let mut sorted = vertices.to_vec();
        sorted.sort_unstable();
        let distinct = sorted.windows(2).all(|w| w[0] < w[1]);
        if !distinct || sorted.last().is_some_and(|&v| v >= self.vertices) {
            return false;
        }
        let mut edges = Combinations::new(sorted.len(), self.order);
        let mut edge = vec![0; self.order];
        while let Some(places) = edges.next() {
            edge.iter_mut().zip(places).for_each(|(v, &i)| *v = sorted[i]);
            if !bits::has(self.row(&edge[..self.order - 1]), edge[self.order - 1]) {
                return false;
            }
        }
        true
    }

    /// Vertices which complete `sorted`, `k - 1` ascending known vertices, to an edge.
    pub(crate) fn row(&self, sorted: &[usize]) -> &[u64] {
        let rank: usize = sorted.iter().zip(&self.binomial).map(|(&v, column)| column[v]).sum();
        &self.rows[rank * self.words..(rank + 1) * self.words]
    }

    /// Words of a row.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    fn write(&mut self, sorted: &[usize], change: fn(&mut [u64], usize)) {
        for skip in 0..self.order {
            let others = sorted.iter().enumerate().filter(|&(i, _)| i != skip).map(|(_, &v)| v);
            let rank: usize = others.zip(&self.binomial).map(|(v, column)| column[v]).sum();
            change(&mut self.rows[rank * self.words..(rank + 1) * self.words], sorted[skip]);
        }
    }

    fn checked(&self, edge: &[usize]) -> Result<Vec<usize>, Error> {
        if edge.len() != self.order {
            return Err(Error::EdgeOrder { order: self.order, given: edge.len() });
        }
        let mut sorted = edge.to_vec();
        sorted.sort_unstable();
        if let Some(&vertex) = sorted.iter().find(|&&v| v >= self.vertices) {
            return Err(Error::UnknownVertex { vertex, vertices: self.vertices });
        }
        match sorted.windows(2).find(|w| w[0] == w[1]) {
            Some(twice) => Err(Error::SelfLoop { vertex: twice[0] }),
            None => Ok(sorted),
        }
    }

    fn grow(&mut self, vertices: usize) -> Result<(), Error> {
        let mut words = self.words.max(1);
        while bits::words_for(vertices) > words {
            words = (2 * words).min(bits::words_for(vertices)).max(words + 1);
        }
        let sets = binomial(vertices, self.order - 1);
        let bytes = sets.and_then(|sets| sets.checked_mul(8 * words)).filter(|&b| b <= Self::MAX_BYTES);
        let (Some(sets), Some(_)) = (sets, bytes) else {
            return Err(Error::TooManyVertices { vertices, limit: self.vertex_limit() });
        };
        if words != self.words && self.words > 0 {
            let mut rows = vec![0; self.rows.len() / self.words * words];
            for (wide, narrow) in rows.chunks_exact_mut(words).zip(self.rows.chunks_exact(self.words)) {
                wide[..self.words].copy_from_slice(narrow);
            }
            self.rows = rows;
        }
        self.words = words;
        self.rows.resize(sets * words, 0);
        for (i, column) in self.binomial.iter_mut().enumerate() {
            // Ranks of sets of `k - 1` fit, since their number does; the last column is never added up.
            (column.len()..vertices).for_each(|v| column.push(binomial(v, i + 1).unwrap_or(usize::MAX)));
        }
        self.vertices = vertices;
        Ok(())
    }

    /// Largest number of vertices that fits into the memory allowed.
    fn vertex_limit(&self) -> usize {
        let fits = |n: usize| {
            binomial(n, self.order - 1)
                .and_then(|sets| sets.checked_mul(8 * bits::words_for(n)))
                .is_some_and(|bytes| bytes <= Self::MAX_BYTES)
        };
        let (mut low, mut high) = (0, Self::MAX_BYTES);
        while low + 1 < high {
            let middle = low.midpoint(high);
            if fits(middle) { low = middle } else { high = middle }
        }
        low
    }
}

/// `C(n, k)`, or `None` if it does not fit.
pub(crate) fn binomial(n: usize, k: usize) -> Option<usize> {
    if k > n {
        return Some(0);
    }
    let k = k.min(n - k);
    (0..k).try_fold(1usize, |value, i| value.checked_mul(n - i).map(|product| product / (i + 1)))
}

/// All ascending choices of `k` places out of `n`, in lexicographic order.
pub(crate) struct Combinations {
    n: usize,
    places: Vec<usize>,
    started: bool,
}

impl Combinations {
    pub(crate) fn new(n: usize, k: usize) -> Self {
        Self { n, places: (0..k).collect(), started: false }
    }

    pub(crate) fn next(&mut self) -> Option<&[usize]> {
        let k = self.places.len();
        if !self.started {
            self.started = true;
            return (k <= self.n).then_some(&self.places[..]);
        }
        let i = (0..k).rev().find(|&i| self.places[i] + k < self.n + i)?;
        self.places[i] += 1;
        for j in i + 1..k {
            self.places[j] = self.places[j - 1] + 1;
        }
        Some(&self.places)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn combinations_are_all_there() {
        let mut choices = Combinations::new(4, 2);
        let mut all = Vec::new();
        while let Some(c) = choices.next() {
            all.push(c.to_vec());
        }
        assert_eq!(all, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert!(Combinations::new(2, 3).next().is_none());
        assert_eq!(Combinations::new(2, 0).next(), Some(&[][..]));
    }

    #[test]
    fn vertices_added_one_by_one_give_the_same_hypergraph() {
        let edges = [[0, 1, 2, 3], [2, 5, 66, 70], [1, 2, 3, 70]];
        let at_once = Hypergraph::from_edges(71, 4, edges).unwrap();
        let mut grown = Hypergraph::new(0, 4).unwrap();
        for v in 0..71 {
            assert_eq!(grown.add_vertex(), Ok(v));
            for edge in edges.iter().filter(|e| e[3] == v) {
                assert_eq!(grown.add_edge(edge), Ok(true));
            }
        }
        assert_eq!(at_once, grown);
        assert_eq!(at_once.edge_count(), 3);
        assert_eq!(grown.remove_edge(&[70, 2, 1, 3]), Ok(true));
        assert!(!grown.has_edge(&[1, 2, 3, 70]));
    }

    #[test]
    fn bad_edges_are_named() {
        let mut graph = Hypergraph::new(4, 3).unwrap();
        assert_eq!(graph.add_edge(&[0, 1]), Err(Error::EdgeOrder { order: 3, given: 2 }));
        assert_eq!(graph.add_edge(&[0, 1, 1]), Err(Error::SelfLoop { vertex: 1 }));
        assert_eq!(graph.add_edge(&[0, 1, 4]), Err(Error::UnknownVertex { vertex: 4, vertices: 4 }));
        assert!(matches!(Hypergraph::new(1_000_000, 3), Err(Error::TooManyVertices { .. })));
        assert!(matches!(Hypergraph::new(usize::MAX / 2, 4), Err(Error::TooManyVertices { .. })));
        assert!(Hypergraph::new(3, 1).is_err());
    }
}

use crate::Error;
use crate::graph::{Hypergraph, bits, hypergraph::Combinations};

/// A hypergraph built from tests, and what it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// The sets of `k` that passed, with all their subsets.
    pub hypergraph: Hypergraph,
    /// Tests made of sets of `j` vertices, at `tests[j]`.
    pub tests: Vec<u64>,
}

/// The hypergraph of all `order`-sets that pass `check`, where a set is tested only if all its subsets of one vertex
/// less passed.
///
/// * `lowest` – size of the smallest sets with a test of their own, `2..=order`; all of them are tested.
/// * `check` – called with ascending vertices, `lowest..=order` of them, in lexicographic order of the sets of each
///   size.
///
/// # Errors
/// [`Error::EdgeOrder`] if `lowest` is not in `2..=order`, [`Error::TooManyVertices`].
///
/// ```
/// use draco_consistency::hyperclique::from_checks;
/// // Numbers agree if no two differ by more than 3, and three if their sum is even.
/// let values = [1, 2, 3, 9, 4];
/// let found = from_checks(values.len(), 3, 2, |set| match *set {
///     [a, b] => (values[a] - values[b] as i32).abs() <= 3,
///     _ => set.iter().map(|&v| values[v]).sum::<i32>() % 2 == 0,
/// })?;
/// assert_eq!(found.tests, [0, 0, 10, 4]);
/// assert!(found.hypergraph.has_edge(&[0, 1, 2]));
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn from_checks(
    vertices: usize,
    order: usize,
    lowest: usize,
    mut check: impl FnMut(&[usize]) -> bool,
) -> Result<Checked, Error> {
    if order < 2 || !(2..=order).contains(&lowest) {
        return Err(Error::EdgeOrder { order, given: lowest });
    }
    let mut tests = vec![0; lowest + 1];
    let mut hypergraph = Hypergraph::new(vertices, lowest)?;
    let mut sets = Combinations::new(vertices, lowest);
    while let Some(set) = sets.next() {
        tests[lowest] += 1;
        if check(set) {
            hypergraph.add_edge(set)?;
        }
    }
    for size in lowest + 1..=order {
        let mut next = Hypergraph::new(vertices, size)?;
        let mut made = 0;
        for_each_supported(&hypergraph, |set| {
            made += 1;
            if check(set) { next.add_edge(set).map(|_| ()) } else { Ok(()) }
        })?;
        tests.push(made);
        hypergraph = next;
    }
    Ok(Checked { hypergraph, tests })
}

/// Calls `each` with every set of one vertex more than an edge whose subsets are all edges, ascending.
fn for_each_supported(
    graph: &Hypergraph,
    mut each: impl FnMut(&[usize]) -> Result<(), Error>,
) -> Result<(), Error> {
    let size = graph.order() + 1;
    // An edge S is extended by a later vertex which completes each of its subsets T of one vertex less.
    let mut sets = Combinations::new(graph.len(), graph.order());
    let (mut extended, mut subset) = (vec![0; size], Vec::with_capacity(size));
    let mut completing = vec![0; graph.words()];
    while let Some(set) = sets.next() {
        let (last, head) = (set[size - 2], &set[..size - 2]);
        if !bits::has(graph.row(head), last) {
            continue;
        }
        completing.fill(u64::MAX);
        for skip in 0..set.len() {
            subset.clear();
            subset.extend(set.iter().enumerate().filter(|&(i, _)| i != skip).map(|(_, &v)| v));
            completing.iter_mut().zip(graph.row(&subset)).for_each(|(a, b)| *a &= b);
        }
        extended[..size - 1].copy_from_slice(set);
        for v in bits::iter(&completing).filter(|&v| v > last) {
            extended[size - 1] = v;
            each(&extended)?;
        }
    }
    Ok(())
}

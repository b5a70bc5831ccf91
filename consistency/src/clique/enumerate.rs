use super::{Budget, maximum};
use crate::graph::{Adjacency, Graph, bits, degeneracy};

/// All maximal cliques, those that no vertex can be added to, each once and ascending; in a fixed order.
///
/// There may be exponentially many, so take from the iterator what you need.
///
/// ```
/// use draco_consistency::{clique, graph::Graph};
/// let graph = Graph::from_edges(4, [(0, 1), (1, 2), (2, 0), (2, 3)])?;
/// let mut all: Vec<_> = clique::maximal(&graph).collect();
/// all.sort();
/// assert_eq!(all, [vec![0, 1, 2], vec![2, 3]]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn maximal(graph: &Graph) -> MaximalCliques<'_> {
    MaximalCliques::new(graph, 0)
}

/// All cliques of the largest size: if there is more than one, the answer of [`maximum`] is a matter of taste.
pub fn all_maximum(graph: &Graph) -> MaximalCliques<'_> {
    MaximalCliques::new(graph, maximum(graph, &Budget::UNLIMITED).value)
}

/// Iterator over maximal cliques; see [`maximal`] and [`all_maximum`].
///
/// **Source**: Bron and Kerbosch, *Finding all cliques of an undirected graph*, 1973, with the pivot of Tomita,
/// Tanaka and Takahashi, 2006, on an explicit stack; branches that stay below the size asked for are cut.
#[derive(Clone, Debug)]
pub struct MaximalCliques<'a> {
    graph: &'a Graph,
    at_least: usize,
    path: Vec<usize>,
    stack: Vec<Frame>,
}

/// Vertices that may join, those that were tried, and those still to be tried here.
#[derive(Clone, Debug)]
struct Frame {
    open: Vec<u64>,
    tried: Vec<u64>,
    todo: Vec<usize>,
}

impl<'a> MaximalCliques<'a> {
    fn new(graph: &'a Graph, at_least: usize) -> Self {
        let words = graph.row(0).len();
        let mut open = vec![0; words];
        (0..graph.len()).for_each(|v| bits::insert(&mut open, v));
        let mut todo = degeneracy(graph).order;
        todo.reverse();
        let stack =
            if graph.is_empty() { Vec::new() } else { vec![Frame { open, tried: vec![0; words], todo }] };
        Self { graph, at_least, path: Vec::new(), stack }
    }

    /// The candidates not joined to the vertex that is joined to most of them.
    fn branching(&self, open: &[u64], tried: &[u64]) -> Vec<usize> {
        let joined =
            |v: usize| open.iter().zip(self.graph.row(v)).map(|(a, b)| (a & b).count_ones()).sum::<u32>();
        let pivot = bits::iter(open).chain(bits::iter(tried)).max_by_key(|&v| joined(v));
        bits::iter(open).filter(|&v| pivot.is_none_or(|p| !self.graph.has_edge(p, v))).collect()
    }
}

impl Iterator for MaximalCliques<'_> {
    type Item = Vec<usize>;

    fn next(&mut self) -> Option<Vec<usize>> {
        while let Some(frame) = self.stack.last_mut() {
            let Some(v) = frame.todo.pop() else {
                self.stack.pop();
                self.path.pop();
                continue;
            };
            let row = self.graph.row(v);
            let meet = |set: &[u64]| set.iter().zip(row).map(|(a, b)| a & b).collect::<Vec<u64>>();
            let (open, tried) = (meet(&frame.open), meet(&frame.tried));
            bits::remove(&mut frame.open, v);
            bits::insert(&mut frame.tried, v);
            let left = bits::count(&open);
            if self.path.len() + 1 + left < self.at_least {
                continue;
            }
            if left == 0 {
                if bits::count(&tried) == 0 {
                    let mut clique = self.path.clone();
                    clique.push(v);
                    clique.sort_unstable();
                    return Some(clique);
                }
                continue;
            }
            let todo = self.branching(&open, &tried);
            self.path.push(v);
            self.stack.push(Frame { open, tried, todo });
        }
        None
    }
}

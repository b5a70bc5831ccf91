use super::Adjacency;

/// Order in which a graph falls apart when a vertex of least degree leaves again and again.
#[derive(Clone, Debug, PartialEq)]
pub struct Degeneracy {
    /// Vertices in the order in which they leave.
    pub order: Vec<usize>,
    /// Core number of each vertex: a clique through it has at most one vertex more.
    pub core: Vec<usize>,
}

/// The degeneracy order and the core numbers, ties broken by vertex number where buckets allow. Cost `O(n + m)`.
///
/// **Source**: Batagelj and Zaveršnik, *An O(m) algorithm for cores decomposition of networks*, 2003.
pub fn degeneracy<A: Adjacency>(graph: &A) -> Degeneracy {
    degeneracy_while(graph, || true)
}

/// The same as long as `go_on` says so; then vertices left keep their order, and bounds that are too large.
pub(crate) fn degeneracy_while<A: Adjacency>(graph: &A, mut go_on: impl FnMut() -> bool) -> Degeneracy {
    let n = graph.len();
    let mut degree: Vec<usize> = (0..n).map(|v| graph.degree(v)).collect();
    let largest = degree.iter().copied().max().unwrap_or(0);

    // `order` is sorted by degree all the time; `start[d]` is where degree `d` begins.
    let mut start = vec![0; largest + 2];
    degree.iter().for_each(|&d| start[d + 1] += 1);
    for d in 0..=largest {
        start[d + 1] += start[d];
    }
    let mut fill = start.clone();
    let (mut order, mut place) = (vec![0; n], vec![0; n]);
    for v in 0..n {
        place[v] = fill[degree[v]];
        order[place[v]] = v;
        fill[degree[v]] += 1;
    }

    for i in 0..n {
        if !go_on() {
            break;
        }
        let v = order[i];
        let own = degree[v];
        graph.neighbors(v).for_each(|u| {
            let near = degree[u];
            if near > own {
                let first = start[near];
                let w = order[first];
                order.swap(first, place[u]);
                place.swap(u, w);
                start[near] += 1;
                degree[u] = near - 1;
            }
        });
    }
    Degeneracy { order, core: degree }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Graph;

    #[test]
    fn core_numbers_of_a_triangle_with_a_tail() {
        let graph = Graph::from_edges(5, [(0, 1), (1, 2), (2, 0), (2, 3)]).unwrap();
        let found = degeneracy(&graph);
        assert_eq!(found.core, [2, 2, 2, 1, 0]);
        assert_eq!(found.order[0], 4);
        assert_eq!(found.order[1], 3);
    }

    #[test]
    fn core_numbers_of_a_stopped_run_are_bounds() {
        let graph = Graph::from_edges(5, [(0, 1), (1, 2), (2, 0), (2, 3)]).unwrap();
        for steps in 0..5 {
            let mut left = steps;
            let stopped = degeneracy_while(&graph, || {
                left -= 1;
                left >= 0
            });
            let full = degeneracy(&graph);
            assert!(stopped.core.iter().zip(&full.core).all(|(bound, core)| bound >= core), "{steps}");
        }
    }
}

use super::rows::{Set, and, and_not, count, drop, full, is_empty, members};

/// Upper bound of the size of a clique by a fractional colouring: if `m` stable sets cover each vertex `k` times, no
/// clique has more than `m / k` vertices, since it meets each set at most once.
///
/// Colouring (`k` = 1) can be far off where this is exact: graphs that look the same from every vertex (Johnson,
/// Hamming) have a fractional chromatic number of `n` over the size of the largest stable set. The sets are greedy,
/// each from the vertices that are covered least; the cover grows to [`FOLDS`]. Cost `O(n³/64)` for each unit of the
/// bound at worst.
///
/// **Source**: Grötschel, Lovász and Schrijver, *The ellipsoid method and its consequences in combinatorial
/// optimization*, 1981, for the bound; the cover here is heuristic, so it lies above the fractional chromatic number.
///
/// `adjacent` rows hold their own vertex too.
pub(super) fn bound<const W: usize>(adjacent: &[Set<W>]) -> usize {
    let n = adjacent.len();
    let (mut covered, mut sets, mut upper) = (vec![0usize; n], 0usize, n);
    loop {
        let Some(&least) = covered.iter().min() else { return 0 };
        upper = sets.checked_div(least).map_or(upper, |bound| upper.min(bound));
        if least >= FOLDS {
            return upper;
        }
        let mut demand = full::<W>(n);
        (0..n).filter(|&v| covered[v] > least).for_each(|v| drop(&mut demand, v));
        stable_set(adjacent, demand).into_iter().for_each(|v| covered[v] += 1);
        sets += 1;
    }
}

/// Times that each vertex is covered, at most: what more of them gain is below one vertex in most graphs.
const FOLDS: usize = 8;

/// A maximal stable set: of the vertices in demand as long as there are any, always the one that leaves most of them.
fn stable_set<const W: usize>(adjacent: &[Set<W>], demand: Set<W>) -> Vec<usize> {
    let (mut free, mut chosen) = (full::<W>(adjacent.len()), Vec::new());
    while !is_empty(&free) {
        let wanted = and(&free, &demand);
        let among = if is_empty(&wanted) { free } else { wanted };
        let leaves = |v: &usize| (count(&and_not(&among, &adjacent[*v])), std::cmp::Reverse(*v));
        let Some(v) = members(among).max_by_key(leaves) else { break };
        free = and_not(&free, &adjacent[v]);
        chosen.push(v);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::super::rows::closed;
    use super::*;
    use crate::clique::{Budget, maximum};
    use crate::graph::Graph;
    use rand::{RngExt, SeedableRng};

    /// Pairs of `n` things, joined if they have none in common: its largest cliques have `n / 2` vertices.
    fn disjoint_pairs(n: usize) -> Graph {
        let pairs: Vec<(usize, usize)> = (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
        let apart = |i: usize, j: usize| {
            let ((a, b), (c, d)) = (pairs[i], pairs[j]);
            a != c && a != d && b != c && b != d
        };
        let edges: Vec<(usize, usize)> = (0..pairs.len())
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .filter(|&(i, j)| apart(i, j))
            .collect();
        Graph::from_edges(pairs.len(), edges).unwrap()
    }

    #[test]
    fn disjoint_pairs_are_bounded_exactly() {
        for n in 3..14 {
            assert_eq!(bound(&closed::<2>(disjoint_pairs(n).matrix())), n / 2, "{n}");
        }
    }

    #[test]
    fn a_graph_that_colouring_cannot_bound_is_proved_at_once() {
        let best = maximum(&disjoint_pairs(18), &Budget::UNLIMITED);
        assert_eq!((best.value, best.optimal), (9, true));
        assert!(best.nodes < 100_000, "{}", best.nodes);
    }

    #[test]
    fn no_clique_is_larger_than_the_bound() {
        let rng = &mut rand_chacha::ChaCha8Rng::seed_from_u64(9);
        for n in 0..60 {
            let density = rng.random_range(0.0..1.0);
            let pairs = (0..n).flat_map(|a| (0..a).map(move |b| (a, b)));
            let edges: Vec<(usize, usize)> = pairs.filter(|_| rng.random_bool(density)).collect();
            let graph = Graph::from_edges(n, edges).unwrap();
            let upper = bound(&closed::<1>(graph.matrix()));
            assert!(upper >= maximum(&graph, &Budget::UNLIMITED).value && upper <= n);
        }
    }
}

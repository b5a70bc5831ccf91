use crate::clique::{Budget, Outcome};
use crate::graph::{Adjacency, Graph};
use crate::{Closure, Error, PairTest, Pose, Reason, Rejection, Selection, Trajectories};

use super::grouping::{groups, stations};
use super::params::GcmParams;

/// Value of `n` members of one group: one vote and a little for its size, `1 + ¼ (1 - 2^(1-n))`.
fn value(n: usize) -> f64 {
    if n == 0 { 0.0 } else { 1.0 + 0.25 * (1.0 - 0.5f64.powi(n as i32 - 1)) }
}

fn gain(n: usize) -> f64 {
    value(n + 1) - value(n)
}

/// The heaviest clique when members of one group count as one vote and a little: `w(S) = Σ_g f(|S ∩ g|)` with
/// `f(n) = 1 + ¼ (1 - 2^(1-n))`.
///
/// * `group_of` – the group of each vertex, any numbers.
///
/// Exact branch and bound, unless the budget ends first. With the set `R` taken, what the candidates can still add is
/// at most the least of
///
/// * the sum over colour classes of the largest single gain, since a clique has one vertex of a class and gains shrink,
/// * the sum over groups of the gain of as many members as the group has colours,
/// * the same over classes of groups that no edge joins, of each class the largest.
///
/// # Errors
/// [`Error::LengthMismatch`] if there is not one group a vertex.
///
/// ```
/// use draco_consistency::clique::Budget;
/// use draco_consistency::gcm::discounted_clique;
/// use draco_consistency::graph::Graph;
///
/// // Six closures of one group against two of two groups: two votes win.
/// let pairs = (0..6).flat_map(|a| (a + 1..6).map(move |b| (a, b)));
/// let graph = Graph::from_edges(8, pairs.chain([(6, 7)]))?;
/// let best = discounted_clique(&graph, &[0, 0, 0, 0, 0, 0, 1, 2], &Budget::UNLIMITED)?;
/// assert_eq!(best.vertices, [6, 7]);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn discounted_clique(graph: &Graph, group_of: &[usize], budget: &Budget) -> Result<Outcome<f64>, Error> {
    let n = graph.len();
    if group_of.len() != n {
        return Err(Error::LengthMismatch { given: group_of.len(), expected: n });
    }
    let mut names: Vec<usize> = group_of.to_vec();
    names.sort_unstable();
    names.dedup();
    let groups: Vec<usize> = group_of.iter().map(|g| names.binary_search(g).unwrap_or_default()).collect();
    let mut search = Search {
        graph,
        groups: &groups,
        taken: vec![0; names.len()],
        current: Vec::new(),
        best: Vec::new(),
        best_value: 0.0,
        nodes: 0,
        limit: budget.nodes.unwrap_or(u64::MAX),
        deadline: budget.time.and_then(|time| std::time::Instant::now().checked_add(time)),
        open: 0.0,
    };
    search.branch((0..n).collect(), 0.0);
    let stopped = search.open > 0.0;
    let mut vertices = search.best;
    vertices.sort_unstable();
    debug_assert!(graph.is_clique(&vertices));
    let upper_bound = search.best_value.max(search.open);
    Ok(Outcome { vertices, value: search.best_value, upper_bound, optimal: !stopped, nodes: search.nodes })
}

struct Search<'a> {
    graph: &'a Graph,
    groups: &'a [usize],
    /// Members of each group in `current`.
    taken: Vec<usize>,
    current: Vec<usize>,
    best: Vec<usize>,
    best_value: f64,
    nodes: u64,
    limit: u64,
    deadline: Option<std::time::Instant>,
    /// Largest bound of a branch that the budget left unsearched.
    open: f64,
}

/// Bounds that differ by less are equal: sums of the same gains in another order.
const ROUNDING: f64 = 1e-9;

impl Search<'_> {
    fn branch(&mut self, mut candidates: Vec<usize>, weight: f64) {
        self.nodes += 1;
        if weight > self.best_value + ROUNDING {
            self.best_value = weight;
            self.best.clone_from(&self.current);
        }
        while !candidates.is_empty() {
            let bound = weight + self.bound(&candidates);
            if bound <= self.best_value + ROUNDING {
                return;
            }
            if self.is_spent() {
                self.open = self.open.max(bound);
                return;
            }
            let at = self.most_promising(&candidates);
            let v = candidates.swap_remove(at);
            let group = self.groups[v];
            let added = gain(self.taken[group]);
            let next = candidates.iter().copied().filter(|&u| self.graph.has_edge(u, v)).collect();
            self.taken[group] += 1;
            self.current.push(v);
            self.branch(next, weight + added);
            self.current.pop();
            self.taken[group] -= 1;
        }
    }

    fn is_spent(&self) -> bool {
        const CLOCK_INTERVAL: u64 = 64;
        self.nodes >= self.limit
            || (self.nodes.is_multiple_of(CLOCK_INTERVAL)
                && self.deadline.is_some_and(|deadline| std::time::Instant::now() >= deadline))
    }

    /// A vertex of an untouched group first, then the one with most candidates beside it.
    fn most_promising(&self, candidates: &[usize]) -> usize {
        let degree = |v: usize| candidates.iter().filter(|&&u| u != v && self.graph.has_edge(u, v)).count();
        let key = |&at: &usize| {
            let v = candidates[at];
            (self.taken[self.groups[v]] == 0, degree(v), std::cmp::Reverse(v))
        };
        (0..candidates.len()).max_by_key(key).unwrap_or(0)
    }

    /// The most that the candidates can add.
    fn bound(&self, candidates: &[usize]) -> f64 {
        let mut classes: Vec<Vec<usize>> = Vec::new();
        for &v in candidates {
            let free = classes.iter().position(|class| class.iter().all(|&u| !self.graph.has_edge(u, v)));
            match free {
                Some(class) => classes[class].push(v),
                None => classes.push(vec![v]),
            }
        }
        let best_of =
            |class: &Vec<usize>| class.iter().map(|&v| gain(self.taken[self.groups[v]])).fold(0.0, f64::max);
        let by_colour: f64 = classes.iter().map(best_of).sum();

        let mut colours = vec![0usize; self.taken.len()];
        for class in &classes {
            let mut present: Vec<usize> = class.iter().map(|&v| self.groups[v]).collect();
            present.sort_unstable();
            present.dedup();
            present.into_iter().for_each(|g| colours[g] += 1);
        }
        let of_group = |g: usize| value(self.taken[g] + colours[g]) - value(self.taken[g]);
        let open: Vec<usize> = (0..colours.len()).filter(|&g| colours[g] > 0).collect();
        let by_group: f64 = open.iter().map(|&g| of_group(g)).sum();

        let joined = |g: usize, h: usize| {
            let of = |wanted: usize| candidates.iter().copied().filter(move |&v| self.groups[v] == wanted);
            of(g).any(|u| of(h).any(|v| self.graph.has_edge(u, v)))
        };
        let mut apart: Vec<Vec<usize>> = Vec::new();
        for &g in &open {
            match apart.iter().position(|class| class.iter().all(|&h| !joined(g, h))) {
                Some(class) => apart[class].push(g),
                None => apart.push(vec![g]),
            }
        }
        let largest = |class: &Vec<usize>| class.iter().map(|&g| of_group(g)).fold(0.0, f64::max);
        let by_group_class: f64 = apart.iter().map(largest).sum();
        by_colour.min(by_group).min(by_group_class)
    }
}

/// [`discounted_clique`] over the closures of each robot pair: pair tests join them, place and time group them.
///
/// Exact and free of covariances between groups, but without prior, cycle and abstention: an oracle for
/// [`gcm`](crate::gcm()) and a rule for those who trust no drift covariance.
///
/// # Errors
/// Unknown poses, bad poses or covariances, parameters outside their range.
pub fn group_discount<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    params: &GcmParams,
    budget: &Budget,
) -> Result<Selection, Error> {
    params.check()?;
    let mut selection = Selection::default();
    for (robots, members) in crate::pcm::by_robots(trajectories, closures)? {
        let own: Vec<_> = members.iter().map(|&m| closures[m].with_source_robot(robots.0)).collect();
        let stations = stations(trajectories, &own, params.unit);
        let all: Vec<usize> = (0..own.len()).collect();
        let mut group_of = vec![0; own.len()];
        for group in groups(&all, &stations, params) {
            group.iter().for_each(|&m| group_of[m] = group[0]);
        }
        let test = PairTest::new(trajectories, &own, params.probability)?;
        let pairs = (0..own.len()).flat_map(|m| (m + 1..own.len()).map(move |n| (m, n)));
        let graph = Graph::from_edges(own.len(), pairs.filter(|&(m, n)| test.agree(m, n)))?;
        let best = discounted_clique(&graph, &group_of, budget)?;
        for (local, &closure) in members.iter().enumerate() {
            if best.vertices.binary_search(&local).is_ok() {
                selection.accepted.push(closure);
            } else {
                let reason = Reason::OutsideLargestSet { size: best.vertices.len() };
                selection.rejected.push(Rejection { closure, reason });
            }
        }
    }
    selection.sort();
    Ok(selection)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn the_heaviest_clique_is_that_of_all_subsets() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let n = rng.random_range(1..13);
            let density = rng.random_range(0.2..0.95);
            let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
            let edges: Vec<(usize, usize)> = pairs.filter(|_| rng.random_bool(density)).collect();
            let graph = Graph::from_edges(n, edges).unwrap();
            let groups: Vec<usize> = (0..n).map(|_| rng.random_range(0..4)).collect();
            let weight = |set: &[usize]| -> f64 {
                (0..4).map(|g| value(set.iter().filter(|&&v| groups[v] == g).count())).sum()
            };
            let best = (0u32..1 << n)
                .map(|mask| (0..n).filter(|v| mask >> v & 1 == 1).collect::<Vec<_>>())
                .filter(|set| graph.is_clique(set))
                .map(|set| weight(&set))
                .fold(0.0, f64::max);
            let found = discounted_clique(&graph, &groups, &Budget::UNLIMITED).unwrap();
            assert!(found.optimal && graph.is_clique(&found.vertices));
            assert!((found.value - best).abs() < 1e-9, "{} for {best}", found.value);
            assert!((weight(&found.vertices) - best).abs() < 1e-9);
        }
    }

    #[test]
    fn a_spent_budget_leaves_a_bound() {
        let pairs = (0..40).flat_map(|a| (a + 1..40).map(move |b| (a, b)));
        let graph = Graph::from_edges(40, pairs.filter(|(a, b)| (a * b) % 3 != 1)).unwrap();
        let groups: Vec<usize> = (0..40).map(|v| v / 5).collect();
        let found = discounted_clique(&graph, &groups, &Budget::nodes(3)).unwrap();
        assert!(graph.is_clique(&found.vertices) && found.upper_bound >= found.value);
    }
}

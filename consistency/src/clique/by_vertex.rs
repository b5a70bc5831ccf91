//! Splits a search by vertex: small graphs with an order of their own, and work for many threads.

use super::budget::Meter;
use super::cover::Cover;
use super::fractional;
use super::incumbent::{Incumbent, START};
use super::order::{DENSE, density};
use super::penalties;
use super::rows::{Set, and, and_not, closed, complement, drop, first, full, members, put, with_width};
use super::search::{self, Problem, Rival};
use super::threads;
use crate::graph::Adjacency;

/// A clique heavier than `lower`: the heaviest, or one of at least `enough`; or `None`.
///
/// The answer does not depend on the number of threads: of the parts that hold a heaviest clique the first one wins,
/// and what is returned is what a search of that part finds when it knows the weight.
pub(super) fn search(problem: Problem<'_>, lower: u64, enough: u64, meter: &mut Meter) -> Option<Vec<usize>> {
    with_width!(problem.matrix.words(), search_wide(problem, lower, enough, meter))
}

fn search_wide<const W: usize>(
    problem: Problem<'_>,
    lower: u64,
    enough: u64,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut split = Split::<W>::new(problem, lower, enough);
    let mut found = Vec::new();
    // Each part holds the cliques whose last vertex is its own. In an order that has nothing to do with it, that of a
    // clique a little larger than the known one is in the last of so many shares: those first, as long as they are
    // little work.
    let easy = problem.counted && density(problem.matrix) <= EASY;
    let parts = split.parts.len();
    let late = if easy { parts / (lower as usize + 1) } else { 0 };
    split.parts.reverse();
    split.parts[late..].reverse();
    let begun = meter.nodes;
    while found.len() < late && meter.nodes < begun + MANY_NODES && !meter.stopped {
        found.push(split.run(found.len(), meter));
    }
    // The others become larger and larger. One after the other, until it is clear whether the search is long.
    let left_over = late - found.len();
    split.parts[found.len()..].rotate_left(left_over);
    split.parts[parts - left_over..].reverse();
    let (early, begun) = (found.len() + (parts - late) / EARLY, meter.nodes);
    while found.len() < early && meter.nodes < begun + MANY_NODES && !meter.stopped {
        found.push(split.run(found.len(), meter));
    }
    let (mut hint, mut left) = (None, parts - found.len());
    if problem.counted && found.len() < early && !meter.stopped {
        let upper = fractional::bound(&split.adjacent) as u64;
        let is_known = || split.incumbent.get().0 >= upper;
        if !is_known() {
            hint = split.hint(meter);
        }
        if is_known() {
            left = 0;
        }
    }
    let first = found.len();
    found.extend(threads::run_all(left, meter, || (), |index, (), meter| split.run(first + index, meter)));
    let (weight, index) = split.incumbent.get();
    if index == START {
        return hint;
    }
    if meter.stopped {
        // There is no time to look for the same set each time.
        let total = |clique: &Vec<usize>| clique.iter().map(|&v| problem.weights[v]).sum::<u64>();
        return found.into_iter().chain([hint]).flatten().max_by_key(total);
    }
    let part = split.parts.get(index as usize)?;
    let rest = weight - problem.weights[part.vertex];
    let mut again = Meter::unlimited();
    let found = if rest == 0 { Vec::new() } else { split.search(part, rest - 1, rest, None, &mut again)? };
    meter.nodes += again.nodes;
    Some(found.into_iter().chain([part.vertex]).collect())
}

/// Cliques of `vertex` with some of `around`, which are all joined to it.
struct Part<const W: usize> {
    vertex: usize,
    around: Set<W>,
}

struct Split<'a, const W: usize> {
    problem: Problem<'a>,
    /// Rows hold their own vertex too.
    adjacent: Vec<Set<W>>,
    parts: Vec<Part<W>>,
    incumbent: Incumbent,
    enough: u64,
    /// Vertices to branch on up to which a part is not worth an order of its own.
    few: u32,
}

impl<'a, const W: usize> Split<'a, W> {
    fn new(problem: Problem<'a>, lower: u64, enough: u64) -> Self {
        let adjacent = closed::<W>(problem.matrix);
        let all = full(problem.matrix.len());
        let mut branching = Cover::new(problem.counted).branching(&adjacent, problem.weights, all, lower);
        let mut open = and_not(&all, &branching);
        let mut parts = Vec::new();
        while let Some(vertex) = first(&branching) {
            drop(&mut branching, vertex);
            parts.push(Part { vertex, around: and(&open, &adjacent[vertex]) });
            put(&mut open, vertex);
        }
        let few = match (problem.counted, density(problem.matrix) > DENSE) {
            (false, _) => 0,
            (true, true) => FEW,
            (true, false) => 3 * FEW,
        };
        Self { problem, adjacent, parts, incumbent: Incumbent::new(lower), enough, few }
    }

    /// A clique larger than all known ones, where looking for one is little against what is to come.
    fn hint(&self, meter: &mut Meter) -> Option<Vec<usize>> {
        let known = self.incumbent.to_beat(0, 0);
        let apart = complement::<W>(self.problem.matrix);
        let found = penalties::search(&apart, HINT_STEPS, self.enough, meter);
        self.incumbent.raise(found.len() as u64);
        (found.len() as u64 > known).then_some(found)
    }

    /// A clique of a part heavier than all known ones, if it is searched to its end its heaviest.
    fn run(&self, index: usize, meter: &mut Meter) -> Option<Vec<usize>> {
        let part = &self.parts[index];
        let fixed = self.problem.weights[part.vertex];
        let rival = Rival { incumbent: &self.incumbent, index: index as u32, fixed };
        let known = self.incumbent.to_beat(rival.index, 0);
        if known >= self.enough || !meter.tick() || !meter.look() {
            return None;
        }
        let alone = (fixed > known).then(|| vec![part.vertex]);
        if alone.is_some() {
            self.incumbent.offer(fixed, rival.index);
        }
        let rest = known.saturating_sub(fixed);
        let found = self.search(part, rest, self.enough.saturating_sub(fixed), Some(rival), meter);
        found.map(|found| found.into_iter().chain([part.vertex]).collect()).or(alone)
    }

    /// Searches the graph around the vertex of a part in rows of its own, which are shorter.
    fn search(
        &self,
        part: &Part<W>,
        lower: u64,
        enough: u64,
        rival: Option<Rival<'_>>,
        meter: &mut Meter,
    ) -> Option<Vec<usize>> {
        let Problem { matrix, weights, counted } = self.problem;
        let vertices: Vec<usize> = members(part.around).collect();
        if counted && vertices.len() as u64 <= lower {
            return None;
        }
        let weights: Vec<u64> = vertices.iter().map(|&v| weights[v]).collect();
        let problem = Problem { matrix: &matrix.select(&vertices), weights: &weights, counted };
        let found = search::search(problem, (lower, enough), self.few, rival, meter)?;
        Some(found.into_iter().map(|v| vertices[v]).collect())
    }
}

/// A search is long if it takes so many nodes to get through the first of so many equal shares of its parts: millions.
const MANY_NODES: u64 = 20_000;
const EARLY: usize = 3;

/// Density up to which one part is little work, even a large one.
const EASY: f64 = 2.0 / 3.0;

/// Steps of the search for a better start of a long search: about a second, where the search is more than five.
const HINT_STEPS: u64 = 1_000_000;

/// Vertices to branch on up to which a part is not worth an order of its own; three times as many where few
/// vertices are joined, since each of them is less work.
const FEW: u32 = 16;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clique::{Budget, maximum};
    use crate::graph::Graph;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_hint_counts_for_every_part() {
        let rng = &mut rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let pairs = (0..60).flat_map(|a| (0..a).map(move |b| (a, b)));
        let edges: Vec<(usize, usize)> = pairs.filter(|_| rng.random_bool(0.6)).collect();
        let graph = Graph::from_edges(60, edges).unwrap();
        let best = maximum(&graph, &Budget::UNLIMITED).value as u64;
        let problem = Problem { matrix: graph.matrix(), weights: &[1; 60], counted: true };
        let split = Split::<1>::new(problem, 3, 60);
        let hint = split.hint(&mut Meter::unlimited()).unwrap();
        assert!(graph.is_clique(&hint));
        assert_eq!((hint.len() as u64, split.incumbent.get()), (best, (best, START)));
        let found = (0..split.parts.len()).filter_map(|i| split.run(i, &mut Meter::unlimited()));
        assert_eq!(found.count(), 0);
        assert_eq!(Split::<1>::new(problem, best, 60).hint(&mut Meter::unlimited()), None);
    }
}

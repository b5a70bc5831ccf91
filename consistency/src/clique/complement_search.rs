//! Largest clique of a graph with few edges missing: branch and reduce for the largest independent set of its
//! complement.
//!
//! **Source**: after Akiba and Iwata, *Branch-and-reduce exponential/FPT algorithms in practice*, 2016, but for the
//! bound: disjoint cliques and chains of contradictions between them are looked for directly, which suits random
//! sparse complements.

use pulp::{Arch, NullaryFnOnce};

use super::budget::Meter;
use super::complement_bound::ComplementBound;
use super::complement_state::{State, Step};
use super::rows::{Set, and_not, count, full, is_empty, spread, width, with_width};
use crate::graph::{
    bit_matrix::Apart,
    bits::{iter, words_for},
};

/// What all parts of the search share.
pub(super) struct Tools<'a> {
    scratch: ComplementBound,
    pub(super) meter: &'a mut Meter,
    /// Nodes after which the search gives up although there is budget.
    pub(super) patience: u64,
    /// Wide instructions where the machine has them; the answer is the same.
    arch: Arch,
}

impl<'a> Tools<'a> {
    pub(super) fn new(meter: &'a mut Meter, patience: u64) -> Self {
        Self { scratch: ComplementBound::default(), meter, patience, arch: Arch::new() }
    }

    /// Counts a node; false once the search must end.
    pub(super) fn tick(&mut self) -> bool {
        self.patience = self.patience.saturating_sub(1);
        self.patience > 0 && self.meter.tick()
    }

    pub(super) fn reduce<const W: usize>(&self, state: &mut State<W>) {
        self.arch.dispatch(Reduce { state });
    }

    /// The two parts of [`State::branch`].
    pub(super) fn branch<const W: usize>(&self, state: State<W>) -> Option<[State<W>; 2]> {
        self.arch.dispatch(Branch { state })
    }

    /// Upper bound of what `alive` adds; work stops once it is down to `target`.
    pub(super) fn bound<const W: usize>(&mut self, apart: &[Set<W>], alive: &Set<W>, target: isize) -> isize {
        self.arch.dispatch(Bound { scratch: &mut self.scratch, apart, alive, target })
    }
}

struct Reduce<'a, const W: usize> {
    state: &'a mut State<W>,
}

impl<const W: usize> NullaryFnOnce for Reduce<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.state.reduce();
    }
}

struct Branch<const W: usize> {
    state: State<W>,
}

impl<const W: usize> NullaryFnOnce for Branch<W> {
    type Output = Option<[State<W>; 2]>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.state.branch()
    }
}

struct Bound<'a, const W: usize> {
    scratch: &'a mut ComplementBound,
    apart: &'a [Set<W>],
    alive: &'a Set<W>,
    target: isize,
}

impl<const W: usize> NullaryFnOnce for Bound<'_, W> {
    type Output = isize;

    #[inline(always)]
    fn call(self) -> isize {
        self.scratch.bound(self.apart, self.alive, self.target)
    }
}

/// Steps to an independent set of more than `lower` vertices: a largest one, or one of at least `enough`.
pub(super) fn solve<const W: usize>(
    mut state: State<W>,
    mut lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    let mut found = None;
    loop {
        if !tools.tick() {
            return found;
        }
        tools.reduce(&mut state);
        if is_empty(&state.alive) {
            return if state.size() > lower { Some(state.log) } else { found };
        }
        let left = count(&state.alive) as usize;
        if width(words_for(left)) < W {
            return solve_narrowed(state, left, lower, enough, tools).or(found);
        }
        let allowed = lower - state.size();
        if tools.bound(&state.apart, &state.alive, allowed) <= allowed {
            return found;
        }
        let part = state.component(&state.alive);
        if part != state.alive {
            return solve_parts(state, part, lower, enough, tools).or(found);
        }
        let Some([with, without]) = tools.branch(state) else { return found };
        if let Some(log) = solve(with, lower, enough, tools) {
            lower = size_of(&log);
            found = Some(log);
            if lower >= enough {
                return found;
            }
        }
        state = without;
    }
}

/// Goes on with fewer words a row, vertices of low degree first.
fn solve_narrowed<const W: usize>(
    state: State<W>,
    left: usize,
    lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    let mut vertices: Vec<usize> = iter(&state.alive).collect();
    vertices.sort_by_cached_key(|&v| count(&state.around(v)));
    let mut place = vec![u32::MAX; 64 * W];
    vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
    let (lower, enough) = (lower - state.size(), enough - state.size());
    let mut apart = Apart::default();
    for &v in &vertices {
        apart.others.extend(iter(&state.around(v)).map(|u| place[u]));
        apart.ends.push(apart.others.len());
    }
    let steps = with_width!(words_for(left), solve_lists(&apart, lower, enough, tools))?;
    let mut log = state.log;
    let name = |v: u32| vertices[v as usize] as u32;
    log.extend(steps.into_iter().map(|step| match step {
        Step::Take(v) => Step::Take(name(v)),
        Step::Fold(v, a, b) => Step::Fold(name(v), name(a), name(b)),
    }));
    Some(log)
}

fn solve_lists<const W: usize>(
    apart: &Apart,
    lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    solve(State::reduced(spread::<W>(apart), full(apart.len())), lower, enough, tools)
}

pub(super) fn size_of(log: &[Step]) -> isize {
    log.len() as isize
}

/// Solves the connected parts one after the other, each with what the bounds of the later ones leave over.
fn solve_parts<const W: usize>(
    state: State<W>,
    first_part: Set<W>,
    lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    let (mut parts, mut rest, mut part) = (Vec::new(), state.alive, first_part);
    while !is_empty(&part) {
        parts.push((tools.bound(&state.apart, &part, 0), part));
        rest = and_not(&rest, &part);
        part = state.component(&rest);
    }
    parts.sort_by_key(|(upper, _)| *upper);
    let mut later: isize = parts.iter().map(|(upper, _)| *upper).sum();
    let mut log = state.log.clone();
    for (upper, part) in parts {
        later -= upper;
        let needed = lower - size_of(&log) - later;
        let alone = State::reduced(state.apart.clone(), part);
        let enough = upper.min(enough - size_of(&log)).max(1);
        log.extend(solve(alone, needed.max(0).min(upper), enough.max(upper), tools)?);
    }
    (size_of(&log) > lower).then_some(log)
}

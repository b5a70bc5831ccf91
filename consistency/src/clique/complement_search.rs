//! Largest clique of a graph with few edges missing: branch and reduce for the largest independent set of its
//! complement.
//!
//! **Source**: reductions and branching after Akiba and Iwata, *Branch-and-reduce exponential/FPT algorithms in
//! practice*, 2016 (degree one and two, unconfined vertices, mirrors, components). The bound differs: disjoint
//! cliques and short odd cycles are looked for directly, which suits random sparse complements.

use super::budget::Meter;
use super::complement_bound::ComplementBound;
use super::rows::{
    BitMatrix, Set, and, and_not, count, drop, empty, first, has, is_empty, or, put, width, with_width,
};
use crate::graph::bits::{iter, words_for};

/// A clique of `matrix` of more than `lower` vertices: the largest, or the first of at least `enough`; or `None`.
pub(super) fn search<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let mut all = empty::<W>();
    (0..matrix.n).for_each(|v| put(&mut all, v));
    let mut apart = matrix.widened::<W>();
    for (v, row) in apart.iter_mut().enumerate() {
        *row = and_not(&all, row);
        drop(row, v);
    }
    let state = State { apart, alive: all, size: 0, log: Vec::new(), small: all, large: all };
    let mut tools = Tools { bound: ComplementBound::default(), meter };
    solve(state, lower as isize, enough as isize, &mut tools).map(|log| replay(&log, matrix.n))
}

/// A step of the construction of an independent set.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// The vertex is in.
    Take(u32),
    /// A vertex of degree two whose neighbours are not joined was contracted with them and keeps its number: if that
    /// is in, both neighbours are, else the vertex itself.
    Fold(u32, u32, u32),
}

fn replay(log: &[Step], n: usize) -> Vec<usize> {
    let mut chosen = vec![false; n];
    for step in log.iter().rev() {
        match *step {
            Step::Take(v) => chosen[v as usize] = true,
            Step::Fold(v, a, b) if chosen[v as usize] => {
                chosen[v as usize] = false;
                chosen[a as usize] = true;
                chosen[b as usize] = true;
            }
            Step::Fold(v, ..) => chosen[v as usize] = true,
        }
    }
    (0..n).filter(|&v| chosen[v]).collect()
}

/// What is left of the complement, and how the part chosen so far came about.
#[derive(Clone)]
struct State<const W: usize> {
    /// Neighbours in the complement; meaningful within `alive`.
    apart: Vec<Set<W>>,
    alive: Set<W>,
    size: isize,
    log: Vec<Step>,
    /// Vertices to look at again: for the rules of degree up to two, and for the rule of unconfined vertices.
    small: Set<W>,
    large: Set<W>,
}

impl<const W: usize> State<W> {
    #[inline(always)]
    fn around(&self, v: usize) -> Set<W> {
        and(&self.apart[v], &self.alive)
    }

    fn remove(&mut self, v: usize) {
        drop(&mut self.alive, v);
        let touched = self.around(v);
        self.small = or(&self.small, &touched);
    }

    fn take(&mut self, v: usize) {
        self.log.push(Step::Take(v as u32));
        self.size += 1;
        let mut gone = self.around(v);
        drop(&mut self.alive, v);
        self.alive = and_not(&self.alive, &gone);
        while let Some(u) = first(&gone) {
            drop(&mut gone, u);
            let touched = self.around(u);
            self.small = or(&self.small, &touched);
        }
    }

    /// Contracts `v` with its only neighbours `a` and `b`.
    fn fold(&mut self, v: usize, a: usize, b: usize) {
        self.log.push(Step::Fold(v as u32, a as u32, b as u32));
        self.size += 1;
        drop(&mut self.alive, a);
        drop(&mut self.alive, b);
        let mut joined = and(&or(&self.apart[a], &self.apart[b]), &self.alive);
        drop(&mut joined, v);
        self.apart[v] = joined;
        self.small = or(&self.small, &joined);
        put(&mut self.small, v);
        while let Some(u) = first(&joined) {
            drop(&mut joined, u);
            put(&mut self.apart[u], v);
        }
    }

    /// Applies the rules until none does.
    fn reduce(&mut self) {
        loop {
            while let Some(v) = first(&self.small) {
                drop(&mut self.small, v);
                if has(&self.alive, v) {
                    self.reduce_small(v);
                }
            }
            self.large = and(&self.large, &self.alive);
            let Some(v) = first(&self.large) else { return };
            drop(&mut self.large, v);
            if self.is_unconfined(v) {
                self.remove(v);
            }
        }
    }

    fn reduce_small(&mut self, v: usize) {
        let around = self.around(v);
        let mut rest = around;
        let Some(a) = first(&rest) else { return self.take(v) };
        drop(&mut rest, a);
        let Some(b) = first(&rest) else { return self.take(v) };
        drop(&mut rest, b);
        if is_empty(&rest) {
            if has(&self.apart[a], b) { self.take(v) } else { self.fold(v, a, b) }
        } else {
            // Fewer neighbours here may make this vertex or one of them unconfined.
            self.large = or(&self.large, &around);
            put(&mut self.large, v);
        }
    }

    /// Whether some largest independent set does without `v`.
    fn is_unconfined(&self, v: usize) -> bool {
        let mut inside = empty::<W>();
        put(&mut inside, v);
        let mut border = self.around(v);
        let mut closed = or(&border, &inside);
        loop {
            let mut extension = None;
            let mut rest = border;
            while let Some(u) = first(&rest) {
                drop(&mut rest, u);
                let near = and(&self.apart[u], &inside);
                if count(&near) != 1 {
                    continue;
                }
                let mut outside = and_not(&self.around(u), &closed);
                let Some(w) = first(&outside) else { return true };
                drop(&mut outside, w);
                if extension.is_none() && is_empty(&outside) {
                    extension = Some(w);
                }
            }
            let Some(w) = extension else { return false };
            put(&mut inside, w);
            border = or(&border, &self.around(w));
            closed = or(&closed, &or(&self.around(w), &inside));
        }
    }

    /// The vertices that may be left out together with `v`: those two steps away for which what `v` has more than
    /// they is a clique.
    fn mirrors(&self, v: usize) -> Set<W> {
        let around = self.around(v);
        let (mut second, mut rest) = (empty::<W>(), around);
        while let Some(u) = first(&rest) {
            drop(&mut rest, u);
            second = or(&second, &self.around(u));
        }
        second = and_not(&second, &around);
        drop(&mut second, v);
        let mut mirrors = empty::<W>();
        while let Some(u) = first(&second) {
            drop(&mut second, u);
            let more = and_not(&around, &self.apart[u]);
            let mut rest = more;
            let mut clique = true;
            while let Some(x) = first(&rest) {
                drop(&mut rest, x);
                clique &= is_empty(&and_not(&rest, &self.apart[x]));
            }
            if clique {
                put(&mut mirrors, u);
            }
        }
        mirrors
    }

    /// The vertices connected with the first one.
    fn component(&self, among: &Set<W>) -> Set<W> {
        let mut reached = empty::<W>();
        let Some(start) = first(among) else { return reached };
        put(&mut reached, start);
        let mut front = reached;
        while let Some(v) = first(&front) {
            drop(&mut front, v);
            let new = and_not(&and(&self.apart[v], among), &reached);
            front = or(&front, &new);
            reached = or(&reached, &new);
        }
        reached
    }

    fn largest_degree(&self) -> Option<usize> {
        let (mut best, mut at, mut rest) = (0, None, self.alive);
        while let Some(v) = first(&rest) {
            drop(&mut rest, v);
            let degree = count(&self.around(v));
            if degree > best {
                (best, at) = (degree, Some(v));
            }
        }
        at
    }
}

/// What all parts of the search share.
struct Tools<'a> {
    bound: ComplementBound,
    meter: &'a mut Meter,
}

/// Steps to an independent set of more than `lower` vertices: a largest one, or one of at least `enough`.
fn solve<const W: usize>(
    mut state: State<W>,
    mut lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    let mut found = None;
    loop {
        if !tools.meter.tick() {
            return found;
        }
        state.reduce();
        if is_empty(&state.alive) {
            return if state.size > lower { Some(state.log) } else { found };
        }
        let left = count(&state.alive) as usize;
        if width(words_for(left)) < W {
            return solve_narrowed(state, left, lower, enough, tools).or(found);
        }
        let allowed = lower - state.size;
        if tools.bound.bound(&state.apart, &state.alive, allowed) <= allowed {
            return found;
        }
        let part = state.component(&state.alive);
        if part != state.alive {
            return solve_parts(state, part, lower, enough, tools).or(found);
        }
        let Some(v) = state.largest_degree() else { return found };
        let mut with = state.clone();
        with.take(v);
        if let Some(log) = solve(with, lower, enough, tools) {
            lower = size_of(&log);
            found = Some(log);
            if lower >= enough {
                return found;
            }
        }
        let mut without = state.mirrors(v);
        state.remove(v);
        while let Some(u) = first(&without) {
            drop(&mut without, u);
            state.remove(u);
        }
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
    vertices.sort_by_key(|&v| count(&state.around(v)));
    let mut place = vec![u32::MAX; 64 * W];
    vertices.iter().enumerate().for_each(|(i, &v)| place[v] = i as u32);
    let mut log = state.log;
    let (lower, enough) = (lower - state.size, enough - state.size);
    let edges =
        vertices.iter().map(|&v| iter(&and(&state.apart[v], &state.alive)).map(|u| place[u]).collect());
    let edges: Vec<Vec<u32>> = edges.collect();
    let steps = with_width!(words_for(left), solve_lists(&edges, lower, enough, tools))?;
    let name = |v: u32| vertices[v as usize] as u32;
    log.extend(steps.into_iter().map(|step| match step {
        Step::Take(v) => Step::Take(name(v)),
        Step::Fold(v, a, b) => Step::Fold(name(v), name(a), name(b)),
    }));
    Some(log)
}

fn solve_lists<const W: usize>(
    edges: &[Vec<u32>],
    lower: isize,
    enough: isize,
    tools: &mut Tools<'_>,
) -> Option<Vec<Step>> {
    let mut apart = vec![empty::<W>(); edges.len()];
    for (row, list) in apart.iter_mut().zip(edges) {
        list.iter().for_each(|&u| put(row, u as usize));
    }
    let mut alive = empty::<W>();
    (0..edges.len()).for_each(|v| put(&mut alive, v));
    let state = State { apart, alive, size: 0, log: Vec::new(), small: empty(), large: empty() };
    solve(state, lower, enough, tools)
}

fn size_of(log: &[Step]) -> isize {
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
        parts.push((tools.bound.bound(&state.apart, &part, 0), part));
        rest = and_not(&rest, &part);
        part = state.component(&rest);
    }
    parts.sort_by_key(|(upper, _)| *upper);
    let mut later: isize = parts.iter().map(|(upper, _)| *upper).sum();
    let mut log = state.log.clone();
    for (upper, part) in parts {
        later -= upper;
        let needed = lower - size_of(&log) - later;
        let alone = State {
            apart: state.apart.clone(),
            alive: part,
            size: 0,
            log: Vec::new(),
            small: empty(),
            large: empty(),
        };
        let enough = upper.min(enough - size_of(&log)).max(1);
        log.extend(solve(alone, needed.max(0).min(upper), enough.max(upper), tools)?);
    }
    (size_of(&log) > lower).then_some(log)
}

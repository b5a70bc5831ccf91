//! What is left of a complement graph while an independent set grows, and the rules that take vertices away.
//!
//! **Source**: Akiba and Iwata, *Branch-and-reduce exponential/FPT algorithms in practice*, 2016 (degree one and two,
//! unconfined vertices, mirrors).

use super::rows::{
    Set, and, and_not, count, drop, empty, first, full, has, is_empty, is_single, or, put, spread,
};
use crate::graph::bit_matrix::Apart;

/// A step of the construction of an independent set.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// The vertex is in.
    Take(u32),
    /// A vertex of degree two whose neighbours are not joined was contracted with them and keeps its number: if that
    /// is in, both neighbours are, else the vertex itself.
    Fold(u32, u32, u32),
}

/// The vertices that steps lead to, ascending, out of `n`.
pub(super) fn replay(log: &[Step], n: usize) -> Vec<usize> {
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
pub(super) struct State<const W: usize> {
    /// Neighbours in the complement; meaningful within `alive`.
    pub(super) apart: Vec<Set<W>>,
    pub(super) alive: Set<W>,
    pub(super) log: Vec<Step>,
    /// Vertices to look at again: for the rules of degree up to two, and for the rule of unconfined vertices.
    small: Set<W>,
    large: Set<W>,
}

impl<const W: usize> State<W> {
    /// A complement, and nothing chosen.
    pub(super) fn of(apart: &Apart) -> Self {
        let all = full(apart.len());
        Self { apart: spread(apart), alive: all, log: Vec::new(), small: all, large: all }
    }

    /// A part of a complement to which all rules were applied before.
    pub(super) fn reduced(apart: Vec<Set<W>>, alive: Set<W>) -> Self {
        Self { apart, alive, log: Vec::new(), small: empty(), large: empty() }
    }

    /// Number of vertices chosen: each step brings one.
    pub(super) fn size(&self) -> isize {
        self.log.len() as isize
    }

    #[inline(always)]
    pub(super) fn around(&self, v: usize) -> Set<W> {
        and(&self.apart[v], &self.alive)
    }

    #[inline(always)]
    fn remove(&mut self, v: usize) {
        drop(&mut self.alive, v);
        let touched = self.around(v);
        self.small = or(&self.small, &touched);
    }

    #[inline(always)]
    fn take(&mut self, v: usize) {
        self.log.push(Step::Take(v as u32));
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
    #[inline(always)]
    fn fold(&mut self, v: usize, a: usize, b: usize) {
        self.log.push(Step::Fold(v as u32, a as u32, b as u32));
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
    #[inline(always)]
    pub(super) fn reduce(&mut self) {
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

    #[inline(always)]
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
            // Fewer neighbours here may make one of them unconfined, if it is joined to all others but one or none.
            rest = around;
            while let Some(u) = first(&rest) {
                drop(&mut rest, u);
                let mut outside = and_not(&around, &self.apart[u]);
                drop(&mut outside, u);
                if is_empty(&outside) || is_single(&outside) {
                    put(&mut self.large, u);
                }
            }
        }
    }

    /// Whether some largest independent set does without `v`.
    ///
    /// If all of them hold `v`, they hold with it each vertex that some neighbour of a single member has alone outside
    /// of these and their neighbours; a neighbour of a single member that has none there could take its place. Only
    /// neighbours for which that may have changed are looked at again.
    #[inline(always)]
    fn is_unconfined(&self, v: usize) -> bool {
        let (mut border, mut several) = (self.around(v), empty::<W>());
        let (mut pending, mut single) = (border, empty::<W>());
        let mut open = and_not(&self.alive, &border);
        drop(&mut open, v);
        loop {
            while let Some(u) = first(&pending) {
                drop(&mut pending, u);
                let outside = and(&self.apart[u], &open);
                if is_empty(&outside) {
                    return true;
                }
                if is_single(&outside) {
                    put(&mut single, u);
                }
            }
            let Some(u) = first(&single) else { return false };
            drop(&mut single, u);
            let Some(w) = first(&and(&self.apart[u], &open)) else { return true };
            // What is next to two of the set says nothing any more.
            let around = self.around(w);
            several = or(&several, &and(&border, &around));
            border = or(&border, &around);
            let mut closed = and(&around, &open);
            put(&mut closed, w);
            open = and_not(&open, &closed);
            pending = around;
            while let Some(x) = first(&closed) {
                drop(&mut closed, x);
                pending = or(&pending, &self.apart[x]);
            }
            pending = and_not(&and(&pending, &border), &several);
            single = and_not(&single, &several);
        }
    }

    /// The vertices that may be left out together with `v`: those two steps away for which what `v` has more than
    /// they is a clique.
    #[inline(always)]
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
    #[inline(always)]
    pub(super) fn component(&self, among: &Set<W>) -> Set<W> {
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

    #[inline(always)]
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

    /// The independent sets with a vertex of largest degree, and those without it and its mirrors; `None` if no two
    /// vertices are joined.
    #[inline(always)]
    pub(super) fn branch(mut self) -> Option<[Self; 2]> {
        let v = self.largest_degree()?;
        let mut with = self.clone();
        with.take(v);
        let mut without = self.mirrors(v);
        self.remove(v);
        while let Some(u) = first(&without) {
            drop(&mut without, u);
            self.remove(u);
        }
        Some([with, self])
    }
}

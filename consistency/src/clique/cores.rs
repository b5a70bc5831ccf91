//! Unit propagation over stable sets: which of them can no clique through a vertex meet all?

use super::rows::{Set, and, drop, empty, is_empty, is_single};

/// Scratch of [`Cores::find`].
///
/// A clique meets a stable set at most once. Suppose it meets every one of some sets and holds a vertex `v`: members
/// not joined to `v` are out, a set with one member left forces it in, and so on; if a set runs empty, the sets that
/// were needed on the way there, the *core*, cannot all be met.
///
/// **Source**: Li and Quan, *An efficient branch-and-bound algorithm based on MaxSAT for the maximum clique problem*,
/// 2010. Here the propagation runs over rows of bits, and reasons are looked for only after a conflict. Failed
/// literals were tried and cost more than they saved.
pub(super) struct Cores<const W: usize> {
    /// Members of each set that are left.
    near: Vec<Set<W>>,
    /// Vertices in the clique, in the order they were forced; the first is `v` itself.
    steps: Vec<Step>,
    /// Sets looked at, and steps taken.
    live: usize,
    taken: usize,
    needed: Vec<bool>,
    /// The sets of the last core, in no order, each once.
    pub(super) core: Vec<usize>,
}

#[derive(Clone, Copy)]
struct Step {
    vertex: u32,
    set: u32,
}

/// How a vertex fits to stable sets.
pub(super) enum Fit {
    /// It is joined to no member of this one.
    Free(usize),
    /// It is joined to members of each.
    Joined,
}

impl<const W: usize> Cores<W> {
    pub(super) fn new() -> Self {
        Self { near: Vec::new(), steps: Vec::new(), live: 0, taken: 0, needed: Vec::new(), core: Vec::new() }
    }

    /// Puts `v` in and looks at each of `sets`. Rows hold their own vertex too.
    #[inline(always)]
    pub(super) fn start(&mut self, adjacent: &[Set<W>], sets: &[Set<W>], v: usize) -> Fit {
        let n = sets.len();
        if self.steps.len() <= n {
            self.near.resize(n, empty());
            self.steps.resize(n + 1, Step { vertex: 0, set: 0 });
        }
        self.live = n;
        self.steps[0] = Step { vertex: v as u32, set: u32::MAX };
        self.taken = 1;
        let (row, near, steps) = (&adjacent[v], &mut self.near[..n], &mut self.steps[..=n]);
        let mut taken = 1;
        for (index, (set, near)) in sets.iter().zip(near).enumerate() {
            let left = and(set, row);
            if is_empty(&left) {
                return Fit::Free(index);
            }
            *near = left;
            if W <= 2 {
                steps[taken] = Step { vertex: lowest(&left), set: index as u32 };
                taken += usize::from(is_single(&left));
            } else if is_single(&left) {
                steps[taken] = Step { vertex: lowest(&left), set: index as u32 };
                taken += 1;
            }
        }
        self.taken = taken;
        Fit::Joined
    }

    /// Sets with one member left after [`Cores::start`], with that member.
    #[inline(always)]
    pub(super) fn units(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.steps[1..self.taken].iter().map(|step| (step.set as usize, step.vertex as usize))
    }

    /// Words that were looked at since [`Cores::start`], at most.
    pub(super) fn work(&self) -> u64 {
        (self.taken * self.live * W) as u64
    }

    /// Goes on from [`Cores::start`]: whether there is a core among `sets`.
    #[inline(always)]
    pub(super) fn find(&mut self, adjacent: &[Set<W>], sets: &[Set<W>]) -> bool {
        let Some(empty) = self.propagate(adjacent) else { return false };
        self.core.clear();
        self.core.push(empty);
        self.needed.clear();
        self.needed.resize(self.taken, false);
        self.explain(adjacent, sets[empty], self.taken);
        // A set forces one step at most, so none is met twice but `empty`, whose own step may stand for the reasons of
        // all its members but one.
        for s in (1..self.taken).rev() {
            if self.needed[s] {
                let Step { vertex, set } = self.steps[s];
                let mut gone = sets[set as usize];
                drop(&mut gone, vertex as usize);
                if set as usize != empty {
                    self.core.push(set as usize);
                }
                self.explain(adjacent, gone, s);
            }
        }
        true
    }

    /// Puts in what is forced; returns a set that runs empty.
    #[inline(always)]
    fn propagate(&mut self, adjacent: &[Set<W>]) -> Option<usize> {
        let (near, steps) = (&mut self.near[..self.live], &mut self.steps[..=self.live]);
        let (mut next, mut taken) = (1, self.taken);
        let mut found = None;
        'all: while next < taken {
            let row = &adjacent[steps[next].vertex as usize];
            next += 1;
            for (index, left) in near.iter_mut().enumerate() {
                let now = and(left, row);
                if now == *left {
                    continue;
                }
                if is_empty(&now) {
                    found = Some(index);
                    break 'all;
                }
                *left = now;
                if is_single(&now) {
                    steps[taken] = Step { vertex: lowest(&now), set: index as u32 };
                    taken += 1;
                }
            }
        }
        self.taken = taken;
        found
    }

    /// Marks steps before `before` that put all of `gone` out, those already marked first.
    #[inline(always)]
    fn explain(&mut self, adjacent: &[Set<W>], gone: Set<W>, before: usize) {
        let mut gone = and(&gone, &adjacent[self.steps[0].vertex as usize]);
        for s in 1..before {
            if self.needed[s] {
                gone = and(&gone, &adjacent[self.steps[s].vertex as usize]);
            }
        }
        for s in 1..before {
            if is_empty(&gone) {
                return;
            }
            let left = and(&gone, &adjacent[self.steps[s].vertex as usize]);
            if left != gone {
                self.needed[s] = true;
                gone = left;
            }
        }
    }
}

/// The least member of a set that has one.
#[inline(always)]
fn lowest<const W: usize>(set: &Set<W>) -> u32 {
    let mut low = 0;
    for block in (0..W).rev() {
        if set[block] != 0 {
            low = 64 * block as u32 + set[block].trailing_zeros();
        }
    }
    low
}

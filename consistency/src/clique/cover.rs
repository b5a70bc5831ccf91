use pulp::{Arch, NullaryFnOnce};

use super::colours::Colours;
use super::peels::Peels;
use super::rows::Set;

/// Which candidates must be branched on, for cliques that are counted or weighed.
pub(super) struct Cover<const W: usize> {
    rule: Rule<W>,
    /// Wide instructions where the machine has them; the answer is the same.
    arch: Arch,
}

enum Rule<const W: usize> {
    Counted(Colours<W>),
    Weighed(Peels<W>),
}

impl<const W: usize> Cover<W> {
    pub(super) fn new(counted: bool) -> Self {
        let rule = if counted { Rule::Counted(Colours::new()) } else { Rule::Weighed(Peels::new()) };
        Self { rule, arch: Arch::new() }
    }

    /// Vertices without which `candidates` hold no clique heavier than `allowed`. Rows of `adjacent` hold their own
    /// vertex too; `weights` are all one where cliques are counted.
    pub(super) fn branching(
        &mut self,
        adjacent: &[Set<W>],
        weights: &[u64],
        candidates: Set<W>,
        allowed: u64,
    ) -> Set<W> {
        self.arch.dispatch(Branching { rule: &mut self.rule, adjacent, weights, candidates, allowed })
    }
}

struct Branching<'a, const W: usize> {
    rule: &'a mut Rule<W>,
    adjacent: &'a [Set<W>],
    weights: &'a [u64],
    candidates: Set<W>,
    allowed: u64,
}

impl<const W: usize> NullaryFnOnce for Branching<'_, W> {
    type Output = Set<W>;

    #[inline(always)]
    fn call(self) -> Set<W> {
        let Self { rule, adjacent, weights, candidates, allowed } = self;
        match rule {
            Rule::Counted(colours) => colours.branching(adjacent, candidates, allowed as usize),
            Rule::Weighed(peels) => peels.branching(adjacent, weights, candidates, allowed),
        }
    }
}

use super::colours::Colours;
use super::peels::Peels;
use super::rows::Set;

/// Which candidates must be branched on, for cliques that are counted or weighed.
pub(super) enum Cover<const W: usize> {
    Counted(Colours<W>),
    Weighed(Peels<W>),
}

impl<const W: usize> Cover<W> {
    pub(super) fn new(counted: bool) -> Self {
        if counted { Self::Counted(Colours::new()) } else { Self::Weighed(Peels::new()) }
    }

    /// Vertices without which `candidates` hold no clique heavier than `allowed`. Rows of `adjacent` hold their own
    /// vertex too; `weights` are all one where cliques are counted.
    #[inline(always)]
    pub(super) fn branching(
        &mut self,
        adjacent: &[Set<W>],
        weights: &[u64],
        candidates: Set<W>,
        allowed: u64,
    ) -> Set<W> {
        match self {
            Self::Counted(colours) => colours.branching(adjacent, candidates, allowed as usize),
            Self::Weighed(peels) => peels.branching(adjacent, weights, candidates, allowed),
        }
    }
}

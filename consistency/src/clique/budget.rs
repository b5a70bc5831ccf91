use std::time::{Duration, Instant};

/// How long an exact search may run; the default has no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Budget {
    /// Largest number of branch-and-bound nodes. Gives the same result on every machine.
    pub nodes: Option<u64>,
    /// Largest wall time, looked at every few nodes.
    pub time: Option<Duration>,
}

impl Budget {
    /// No limit: the answer is optimal.
    pub const UNLIMITED: Self = Self { nodes: None, time: None };

    /// A limit on the number of nodes only.
    pub fn nodes(nodes: u64) -> Self {
        Self { nodes: Some(nodes), time: None }
    }

    /// A limit on wall time only.
    pub fn time(time: Duration) -> Self {
        Self { nodes: None, time: Some(time) }
    }
}

/// Counts nodes and says when the budget is spent.
#[derive(Clone, Debug)]
pub(crate) struct Meter {
    pub(crate) nodes: u64,
    pub(crate) stopped: bool,
    limit: u64,
    deadline: Option<Instant>,
}

/// Nodes between two looks at the clock.
const CLOCK_INTERVAL: u64 = 16;

impl Meter {
    pub(crate) fn new(budget: &Budget) -> Self {
        let deadline = budget.time.and_then(|time| Instant::now().checked_add(time));
        Self { nodes: 0, stopped: false, limit: budget.nodes.unwrap_or(u64::MAX), deadline }
    }

    pub(crate) fn unlimited() -> Self {
        Self::new(&Budget::UNLIMITED)
    }

    #[cfg(feature = "rayon")]
    pub(super) fn limits_nodes(&self) -> bool {
        self.limit != u64::MAX
    }

    /// A meter for one thread, with the same deadline.
    #[cfg(feature = "rayon")]
    pub(super) fn fork(&self) -> Self {
        Self { nodes: 0, ..self.clone() }
    }

    /// Adds what a thread counted.
    #[cfg(feature = "rayon")]
    pub(super) fn join(&mut self, other: &Self) {
        self.nodes += other.nodes;
        self.stopped |= other.stopped;
    }

    /// Counts a node; false once the budget is spent.
    #[inline]
    pub(crate) fn tick(&mut self) -> bool {
        self.nodes += 1;
        if self.nodes > self.limit {
            self.stopped = true;
        } else if self.nodes.is_multiple_of(CLOCK_INTERVAL) {
            self.look();
        }
        !self.stopped
    }

    /// Looks at the clock at once; false once the budget is spent.
    pub(crate) fn look(&mut self) -> bool {
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.stopped = true;
        }
        !self.stopped
    }
}

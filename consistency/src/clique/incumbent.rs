use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// The heaviest clique that any part of a search found, and the first part that found one so heavy.
pub(super) struct Incumbent {
    /// Weight alone, to see at little cost that nothing has changed.
    weight: AtomicU64,
    known: Mutex<Known>,
}

#[derive(Clone, Copy)]
struct Known {
    weight: u64,
    by: u32,
}

/// Part that stands for what no part found.
pub(super) const START: u32 = u32::MAX;

impl Incumbent {
    pub(super) fn new(weight: u64) -> Self {
        Self { weight: AtomicU64::new(weight), known: Mutex::new(Known { weight, by: START }) }
    }

    fn read(&self) -> Known {
        *self.known.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// The weight and the part it is from.
    pub(super) fn get(&self) -> (u64, u32) {
        let Known { weight, by } = self.read();
        (weight, by)
    }

    /// Part `index` found a clique of this weight.
    pub(super) fn offer(&self, weight: u64, index: u32) {
        let mut known = self.known.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if weight > known.weight || (weight == known.weight && known.by != START && index < known.by) {
            *known = Known { weight, by: index };
            self.weight.store(weight, Ordering::Relaxed);
        }
    }

    /// A clique of this weight was found outside of all parts.
    pub(super) fn raise(&self, weight: u64) {
        let mut known = self.known.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if weight > known.weight {
            *known = Known { weight, by: START };
            self.weight.store(weight, Ordering::Relaxed);
        }
    }

    /// Weight that part `index`, which has `own` to beat already, has to beat: an equal one of a later part does not
    /// count, but one that no part found always does.
    #[inline(always)]
    pub(super) fn to_beat(&self, index: u32, own: u64) -> u64 {
        if self.weight.load(Ordering::Relaxed) <= own {
            return own;
        }
        let Known { weight, by } = self.read();
        own.max(if by <= index || by == START { weight } else { weight - 1 })
    }
}

/// Absent from a list.
const NONE: u32 = u32::MAX;
/// Scores below this have a bucket each.
const EXACT: u64 = 64;
/// Buckets an octave of larger scores.
const STEPS: usize = 16;
const BUCKETS: usize = EXACT as usize + (64 - EXACT.ilog2() as usize) * STEPS;

/// A queue of the numbers `0..n` by score: the lowest score first, and of equal scores the one that came first.
///
/// Scores of 64 and more are equal within a sixteenth of an octave. Every operation takes constant time, for
/// [`BucketQueue::pop`] on average.
pub(super) struct BucketQueue {
    head: Vec<u32>,
    tail: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    bucket: Vec<u32>,
    /// No bucket below this holds anything.
    lowest: usize,
}

impl BucketQueue {
    pub(super) fn new(n: usize) -> Self {
        Self {
            head: vec![NONE; BUCKETS],
            tail: vec![NONE; BUCKETS],
            next: vec![NONE; n],
            previous: vec![NONE; n],
            bucket: vec![0; n],
            lowest: 0,
        }
    }

    /// Adds an item that is not in the queue.
    pub(super) fn push(&mut self, item: u32, score: u64) {
        let bucket = bucket(score);
        self.lowest = self.lowest.min(bucket);
        self.bucket[item as usize] = bucket as u32;
        let last = std::mem::replace(&mut self.tail[bucket], item);
        self.previous[item as usize] = last;
        self.next[item as usize] = NONE;
        match last {
            NONE => self.head[bucket] = item,
            last => self.next[last as usize] = item,
        }
    }

    /// Takes out an item that is in the queue.
    pub(super) fn remove(&mut self, item: u32) {
        let (previous, next) = (self.previous[item as usize], self.next[item as usize]);
        let bucket = self.bucket[item as usize] as usize;
        match previous {
            NONE => self.head[bucket] = next,
            previous => self.next[previous as usize] = next,
        }
        match next {
            NONE => self.tail[bucket] = previous,
            next => self.previous[next as usize] = previous,
        }
    }

    /// Takes out the first item.
    pub(super) fn pop(&mut self) -> Option<u32> {
        while let Some(head) = self.head.get(self.lowest).copied() {
            if head != NONE {
                self.remove(head);
                return Some(head);
            }
            self.lowest += 1;
        }
        None
    }
}

fn bucket(score: u64) -> usize {
    if score < EXACT {
        return score as usize;
    }
    let octave = score.ilog2();
    let step = (score >> (octave - STEPS.ilog2())) as usize % STEPS;
    EXACT as usize + (octave - EXACT.ilog2()) as usize * STEPS + step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_ascend_with_the_score() {
        let mut last = 0;
        for score in (0..5000).chain((13..64).map(|bits| 1u64 << bits)).chain([u64::MAX]) {
            assert!((last..BUCKETS).contains(&bucket(score)), "{score}");
            last = bucket(score);
        }
    }

    #[test]
    fn items_leave_by_score_and_then_by_age() {
        let mut queue = BucketQueue::new(6);
        for (item, score) in [(0, 7), (1, 3), (2, 7), (3, 1_000_000), (4, 3), (5, 0)] {
            queue.push(item, score);
        }
        queue.remove(2);
        assert_eq!(queue.pop(), Some(5));
        queue.push(2, 3);
        queue.remove(3);
        queue.push(3, 1);
        let rest: Vec<u32> = std::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(rest, [3, 1, 4, 2, 0]);
    }
}

use super::problem::Problem;
use crate::Similarity;

/// Loss of likeness against the best candidate, nats, up to which an object could still be the one that was seen: three
/// standard deviations of one dimension.
const RIVAL: f64 = 4.5;

/// Which objects of one map could be taken for each other: those that some object of the other map looks like alike.
pub(super) struct Alike {
    words: usize,
    /// A row of bits for each object.
    bits: Vec<u64>,
}

impl Alike {
    /// Objects of map 1.
    pub(super) fn of_map1(problem: &Problem) -> Self {
        Self::new(problem.p1.len(), problem.p2.len(), |i, a| problem.looks(i, a))
    }

    /// Objects of map 2.
    pub(super) fn of_map2(problem: &Problem) -> Self {
        Self::new(problem.p2.len(), problem.p1.len(), |a, i| problem.looks(i, a))
    }

    fn new(own: usize, other: usize, looks: impl Fn(usize, usize) -> f64) -> Self {
        let words = own.div_ceil(64);
        let mut bits = vec![0; own * words];
        let mut rivals = vec![0; words];
        for seen in 0..other {
            let best = (0..own).map(|k| looks(k, seen)).fold(f64::NEG_INFINITY, f64::max);
            if best == f64::NEG_INFINITY {
                continue;
            }
            rivals.fill(0_u64);
            for k in (0..own).filter(|&k| looks(k, seen) >= best - RIVAL) {
                rivals[k / 64] |= 1 << (k % 64);
            }
            for k in (0..own).filter(|k| rivals[k / 64] >> (k % 64) & 1 == 1) {
                for (bits, rivals) in bits[k * words..][..words].iter_mut().zip(&rivals) {
                    *bits |= rivals;
                }
            }
        }
        Self { words, bits }
    }
}

impl Similarity for Alike {
    fn log_ratio(&self, first: usize, second: usize) -> Option<f64> {
        let word = self.bits.get(first * self.words + second / 64)?;
        (word >> (second % 64) & 1 == 1).then_some(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_that_one_object_looks_like_are_alike() {
        // Objects 0 and 1 look like the first object seen, 1 less so than the limit allows in the second's eyes; 2 alone
        // looks like the third.
        let looks =
            [[0.0, 1.0, f64::NEG_INFINITY], [-4.0, -9.0, f64::NEG_INFINITY], [f64::NEG_INFINITY, -6.0, 2.0]];
        let alike = Alike::new(3, 3, |k, seen| looks[k][seen]);
        let row = |i: usize| (0..3).map(|k| alike.log_ratio(i, k).is_some()).collect::<Vec<_>>();
        assert_eq!(row(0), [true, true, false]);
        assert_eq!(row(1), [true, true, false]);
        assert_eq!(row(2), [false, false, true]);
    }
}

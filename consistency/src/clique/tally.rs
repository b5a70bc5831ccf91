use super::rows::{Set, and, and_not, empty, has, is_empty, or};

/// A sum for each vertex, in binary: one row of bits a digit, so that many vertices count at once.
pub(super) struct Tally<const W: usize> {
    /// The lowest first.
    digits: Vec<Set<W>>,
}

impl<const W: usize> Tally<W> {
    /// All zero.
    pub(super) fn new() -> Self {
        Self { digits: Vec::new() }
    }

    /// Adds `amount` to those of `vertices`.
    #[inline(always)]
    pub(super) fn add(&mut self, vertices: &Set<W>, mut amount: u64) {
        while amount > 0 {
            let mut carry = *vertices;
            let mut at = amount.trailing_zeros() as usize;
            amount &= amount - 1;
            if self.digits.len() < at {
                self.digits.resize(at, empty());
            }
            while !is_empty(&carry) {
                if at == self.digits.len() {
                    self.digits.push(empty());
                }
                let digit = &mut self.digits[at];
                let both = and(digit, &carry);
                *digit = and_not(&or(digit, &carry), &both);
                carry = both;
                at += 1;
            }
        }
    }

    /// Takes `amount` from those of `vertices`, which must have it.
    #[inline(always)]
    pub(super) fn subtract(&mut self, vertices: &Set<W>, mut amount: u64) {
        while amount > 0 {
            let mut borrow = *vertices;
            let at = amount.trailing_zeros() as usize;
            amount &= amount - 1;
            for digit in self.digits.iter_mut().skip(at) {
                if is_empty(&borrow) {
                    break;
                }
                let short = and_not(&borrow, digit);
                *digit = or(&and_not(digit, &borrow), &short);
                borrow = short;
            }
        }
    }

    /// The sum of one vertex.
    #[inline(always)]
    pub(super) fn of(&self, v: usize) -> u64 {
        self.digits.iter().rev().fold(0, |sum, digit| 2 * sum + u64::from(has(digit, v)))
    }

    /// The sum of all `vertices` together, or the largest number if it is larger.
    #[inline(always)]
    pub(super) fn total(&self, vertices: &Set<W>) -> u64 {
        self.digits.iter().rev().fold(0, |sum: u64, digit| {
            sum.saturating_mul(2).saturating_add(u64::from(super::rows::count(&and(digit, vertices))))
        })
    }

    /// Those of `vertices` with the least sum.
    #[inline(always)]
    pub(super) fn least(&self, vertices: &Set<W>) -> Set<W> {
        let mut least = *vertices;
        for digit in self.digits.iter().rev() {
            let less = and_not(&least, digit);
            if !is_empty(&less) {
                least = less;
            }
        }
        least
    }

    /// Vertices whose sum is odd, and those whose sum is two or more.
    #[inline(always)]
    pub(super) fn odd_and_many(&self) -> (Set<W>, Set<W>) {
        match self.digits.split_first() {
            Some((odd, higher)) => (*odd, higher.iter().fold(empty(), |many, digit| or(&many, digit))),
            None => (empty(), empty()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::{full, members, put};
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn sums_are_those_of_plain_numbers() {
        let rng = &mut rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let (n, mut plain, mut tally) = (100, vec![0u64; 100], Tally::<2>::new());
        for step in 0..400 {
            let amount = if step % 2 == 0 { 1 } else { rng.random_range(0..1 << 40) };
            let down = step % 3 == 2;
            let mut chosen = empty();
            for (v, sum) in plain.iter_mut().enumerate() {
                if rng.random_bool(0.4) && (!down || *sum >= amount) {
                    put(&mut chosen, v);
                    *sum = if down { *sum - amount } else { *sum + amount };
                }
            }
            if down {
                tally.subtract(&chosen, amount)
            } else {
                tally.add(&chosen, amount)
            }
            assert!((0..n).all(|v| tally.of(v) == plain[v]));
            assert_eq!(tally.total(&chosen), members(chosen).map(|v| plain[v]).sum::<u64>());
            let least = plain.iter().min().copied();
            let expected: Vec<usize> = (0..n).filter(|&v| Some(plain[v]) == least).collect();
            assert_eq!(members(tally.least(&full(n))).collect::<Vec<_>>(), expected);
            let (odd, many) = tally.odd_and_many();
            assert!((0..n).all(|v| has(&odd, v) == (plain[v] % 2 == 1) && has(&many, v) == (plain[v] > 1)));
        }
    }
}

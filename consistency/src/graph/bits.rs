//! Sets of small integers as slices of 64-bit words.

/// Words needed for `n` bits.
#[inline]
pub(crate) const fn words_for(n: usize) -> usize {
    n.div_ceil(64)
}

/// Whether bit `i` is set; bits past the end are not.
#[inline]
pub(crate) fn has(set: &[u64], i: usize) -> bool {
    set.get(i / 64).is_some_and(|word| word >> (i % 64) & 1 == 1)
}

/// Sets bit `i`.
#[inline]
pub(crate) fn insert(set: &mut [u64], i: usize) {
    set[i / 64] |= 1 << (i % 64);
}

/// Clears bit `i`.
#[inline]
pub(crate) fn remove(set: &mut [u64], i: usize) {
    set[i / 64] &= !(1 << (i % 64));
}

/// Number of elements.
#[inline(always)]
pub(crate) fn count(set: &[u64]) -> usize {
    set.iter().map(|word| word.count_ones() as usize).sum()
}

/// Elements in ascending order.
#[inline]
pub(crate) fn iter(set: &[u64]) -> impl Iterator<Item = usize> + '_ {
    set.iter().enumerate().flat_map(|(block, &word)| iter_word(word).map(move |bit| 64 * block + bit))
}

/// Elements of one word in ascending order.
#[inline]
pub(crate) fn iter_word(mut rest: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        if rest == 0 {
            return None;
        }
        let bit = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        Some(bit)
    })
}

//! Work on many points, spread over threads with the feature `rayon`; the answer has the same bits either way.

/// Items one thread takes at a time: enough to make the hand-over cheap.
#[cfg(feature = "rayon")]
const CHUNK: usize = 2048;

/// `work` on consecutive runs of `items`, its results joined in order. What it gives for an item must not depend
/// on where its run starts.
#[cfg(feature = "rayon")]
pub(crate) fn map_chunks<I: Sync, T: Send>(
    items: &[I],
    work: impl Fn(&[I]) -> Vec<T> + Send + Sync,
) -> Vec<T> {
    use rayon::prelude::*;
    if items.len() <= CHUNK {
        return work(items);
    }
    items.par_chunks(CHUNK).flat_map_iter(work).collect()
}

/// `work` on all `items` at once.
#[cfg(not(feature = "rayon"))]
pub(crate) fn map_chunks<I, T>(items: &[I], work: impl Fn(&[I]) -> Vec<T>) -> Vec<T> {
    work(items)
}

/// Both results, computed side by side if threads are there.
#[cfg(feature = "rayon")]
pub(crate) fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Both results.
#[cfg(not(feature = "rayon"))]
pub(crate) fn join<A, B>(a: impl FnOnce() -> A, b: impl FnOnce() -> B) -> (A, B) {
    (a(), b())
}

/// Calls `work` on consecutive runs of two slices of equal length.
#[cfg(feature = "rayon")]
pub(crate) fn for_chunks<A: Send, B: Sync>(
    first: &mut [A],
    second: &[B],
    work: impl Fn(&mut [A], &[B]) + Send + Sync,
) {
    use rayon::prelude::*;
    if first.len() <= CHUNK {
        return work(first, second);
    }
    first.par_chunks_mut(CHUNK).zip(second.par_chunks(CHUNK)).for_each(|(a, b)| work(a, b));
}

/// Calls `work` on two slices of equal length.
#[cfg(not(feature = "rayon"))]
pub(crate) fn for_chunks<A, B>(first: &mut [A], second: &[B], work: impl Fn(&mut [A], &[B])) {
    work(first, second);
}

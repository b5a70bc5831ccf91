use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// A fill-reducing order of the columns of a symmetric block pattern: `order[new] = old`.
///
/// * `pairs` – the off-diagonal blocks, each once, in any orientation.
///
/// Approximate minimum degree; the natural order should that fail.
pub(crate) fn minimum_degree(columns: usize, pairs: &[(u32, u32)]) -> Vec<u32> {
    let mut start = vec![0u32; columns + 1];
    for (a, b) in pairs {
        start[*a.max(b) as usize + 1] += 1;
    }
    for column in 0..columns {
        start[column + 1] += start[column];
    }
    let mut next = start.clone();
    let mut rows = vec![0u32; pairs.len()];
    for (a, b) in pairs {
        let column = *a.max(b) as usize;
        rows[next[column] as usize] = *a.min(b);
        next[column] += 1;
    }
    for column in 0..columns {
        rows[start[column] as usize..start[column + 1] as usize].sort_unstable();
    }
    let pattern = SymbolicSparseColMatRef::new_checked(columns, columns, &start, None, &rows);
    let mut order = vec![0u32; columns];
    let mut position = vec![0u32; columns];
    let mut memory = MemBuffer::new(amd::order_scratch::<u32>(columns, pairs.len()));
    let stack = MemStack::new(&mut memory);
    match amd::order(&mut order, &mut position, pattern, amd::Control::default(), stack) {
        Ok(_) => order,
        Err(_) => (0..columns as u32).collect(),
    }
}

use super::state::{NONE, State};

/// A row's least and second least reduced cost `c − v`.
pub(super) struct Bid {
    pub(super) best: usize,
    pub(super) value: f64,
    /// +∞ without a second column.
    pub(super) next: f64,
}

/// The entries in play, row by row.
pub(super) trait Rows {
    fn len(&self) -> usize;

    /// A row's bid at column duals `v`; `None` without an allowed column.
    fn bid(&self, row: usize, v: &[f64]) -> Option<Bid>;

    /// A column other than the best whose reduced cost is the bid's `next`, where that equals its `value`.
    fn second(&self, row: usize, v: &[f64], bid: &Bid) -> Option<usize>;
}

/// Offers every free row its best column, at a dual lowered to what its second best would do; the row that is driven
/// out bids on. Rows whose bid changes nothing, and those without a second choice, stay in `free` for the search.
///
/// * `most` – bids a row, on average, after which chains end: long price wars are what the search is better at.
///
/// **Source**: Jonker, Volgenant, 1987, "augmenting row reduction".
#[inline(always)]
pub(super) fn reduce_rows(rows: &impl Rows, state: &mut State, free: &mut Vec<u32>, most: usize) {
    let mut waiting = Vec::new();
    let mut bids = 0;
    for &start in free.iter() {
        let mut row = start as usize;
        loop {
            bids += 1;
            // Without a second choice the dual would fall without bound.
            let Some(offer) = rows.bid(row, &state.v).filter(|offer| offer.next < f64::INFINITY) else {
                waiting.push(row as u32);
                break;
            };
            let mut column = offer.best;
            let lowered = offer.next > offer.value;
            if lowered {
                state.v[column] -= offer.next - offer.value;
            } else if state.row_of_column[column] != NONE {
                column = rows.second(row, &state.v, &offer).unwrap_or(column);
            }
            let driven_out = state.row_of_column[column];
            if driven_out != NONE {
                if !lowered {
                    waiting.push(row as u32);
                    break;
                }
                state.column_of_row[driven_out as usize] = NONE;
            }
            state.assign(row, column);
            if driven_out == NONE {
                break;
            }
            if bids > most * rows.len() {
                waiting.push(driven_out);
                break;
            }
            row = driven_out as usize;
        }
    }
    *free = waiting;
}

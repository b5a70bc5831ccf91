use super::Costs;
use super::state::{NONE, State, reduce_columns};
use crate::Error;

/// Jonker and Volgenant's algorithm over all entries.
pub(super) fn solve(costs: Costs) -> Result<State, Error> {
    let mut state = State::new(costs);
    if costs.rows == costs.columns {
        reduce_columns(costs, &mut state);
    }
    for _ in 0..2 {
        reduce_rows(costs, &mut state);
    }
    let mut search = Search::new(costs.columns);
    for row in state.free_rows() {
        search.run(costs, &mut state, row as usize)?;
    }
    Ok(state)
}

/// Offers every free row its best column, at a dual lowered to what its second best would do; the row that is driven
/// out bids on. A row whose bid changes nothing waits for the search.
fn reduce_rows(costs: Costs, state: &mut State) {
    let mut bids = 0;
    for start in state.free_rows() {
        let mut row = start as usize;
        loop {
            bids += 1;
            let Some((best, second, value, next)) = two_least(costs.row(row), &state.v) else { break };
            // Without a second choice the dual would fall without bound; the search handles such rows.
            if next == f64::INFINITY {
                break;
            }
            let lowered = next > value;
            let mut column = best;
            if lowered {
                state.v[best] -= next - value;
            } else if state.row_of_column[best] != NONE {
                column = second;
            }
            let driven_out = state.row_of_column[column];
            if driven_out != NONE {
                if !lowered {
                    break;
                }
                state.column_of_row[driven_out as usize] = NONE;
            }
            state.assign(row, column);
            // Long price wars are what the search is better at.
            if driven_out == NONE || bids > 4 * costs.rows {
                break;
            }
            row = driven_out as usize;
        }
    }
}

/// Columns and values of the least and second least `c − v`; `None` if no column is allowed.
fn two_least(costs: &[f64], v: &[f64]) -> Option<(usize, usize, f64, f64)> {
    const LANES: usize = 4;
    let (mut first, mut second) = ([f64::INFINITY; LANES], [f64::INFINITY; LANES]);
    let blocks = costs.len() / LANES;
    for (c, v) in costs.chunks_exact(LANES).zip(v.chunks_exact(LANES)) {
        for l in 0..LANES {
            let r = c[l] - v[l];
            let worse = if r > first[l] { r } else { first[l] };
            first[l] = if r < first[l] { r } else { first[l] };
            second[l] = if worse < second[l] { worse } else { second[l] };
        }
    }
    let (mut least, mut next) = (f64::INFINITY, f64::INFINITY);
    let tail = (blocks * LANES..costs.len()).map(|j| costs[j] - v[j]);
    for r in first.into_iter().chain(second).chain(tail) {
        if r < least {
            (least, next) = (r, least);
        } else if r < next {
            next = r;
        }
    }
    if least == f64::INFINITY {
        return None;
    }
    let at = |value: f64, skip: usize| (0..costs.len()).find(|&j| j != skip && costs[j] - v[j] == value);
    let best = at(least, usize::MAX)?;
    let other = if next < f64::INFINITY { at(next, best)? } else { best };
    Some((best, other, least, next))
}

/// Buffers of the shortest-path search.
struct Search {
    /// Column duals of columns still open, -∞ of those done, which makes their reduced costs infinite.
    open_v: Vec<f64>,
    /// Length of the shortest path so far of open columns, +∞ of those done.
    key: Vec<f64>,
    row_before: Vec<u64>,
    /// Columns done and their path lengths.
    done: Vec<(u32, f64)>,
}

impl Search {
    fn new(columns: usize) -> Self {
        Self {
            open_v: vec![0.0; columns],
            key: vec![0.0; columns],
            row_before: vec![0; columns],
            done: Vec::new(),
        }
    }

    /// Assigns the free row `start` along a shortest alternating path.
    fn run(&mut self, costs: Costs, state: &mut State, start: usize) -> Result<(), Error> {
        self.open_v.copy_from_slice(&state.v);
        self.key.fill(f64::INFINITY);
        self.done.clear();
        let (mut row, mut offset) = (start, 0.0);
        let (end, length) = loop {
            let least = self.relax(costs.row(row), row, offset);
            if least == f64::INFINITY {
                return Err(Error::Infeasible { row: start });
            }
            let column = self.least_column(state, least);
            if state.row_of_column[column] == NONE {
                break (column, least);
            }
            row = state.row_of_column[column] as usize;
            self.done.push((column as u32, least));
            self.key[column] = f64::INFINITY;
            self.open_v[column] = f64::NEG_INFINITY;
            offset = costs.row(row)[column] - state.v[column] - least;
        };
        for &(column, at) in &self.done {
            state.v[column as usize] += at - length;
        }
        state.augment(start, end, |column| self.row_before[column] as usize);
        Ok(())
    }

    /// Shortens paths through `row` and returns the shortest of all.
    fn relax(&mut self, costs: &[f64], row: usize, offset: f64) -> f64 {
        const LANES: usize = 4;
        let row = row as u64;
        let mut least = [f64::INFINITY; LANES];
        let mut keys = self.key.chunks_exact_mut(LANES);
        let mut rows = self.row_before.chunks_exact_mut(LANES);
        let (cs, vs) = (costs.chunks_exact(LANES), self.open_v.chunks_exact(LANES));
        for (((c, v), key), before) in cs.zip(vs).zip(&mut keys).zip(&mut rows) {
            for l in 0..LANES {
                let r = c[l] - v[l] - offset;
                let better = r < key[l];
                let k = if better { r } else { key[l] };
                before[l] = if better { row } else { before[l] };
                key[l] = k;
                least[l] = if k < least[l] { k } else { least[l] };
            }
        }
        let tail = costs.len() / LANES * LANES;
        let mut shortest = least.into_iter().fold(f64::INFINITY, f64::min);
        for ((j, key), before) in (tail..).zip(keys.into_remainder()).zip(rows.into_remainder()) {
            let r = costs[j] - self.open_v[j] - offset;
            if r < *key {
                (*key, *before) = (r, row);
            }
            shortest = shortest.min(*key);
        }
        shortest
    }

    /// A column with path length `least`, an idle one if there is any, else the first.
    fn least_column(&self, state: &State, least: f64) -> usize {
        let mut first = usize::MAX;
        for (j, key) in self.key.iter().enumerate() {
            if *key == least {
                if state.row_of_column[j] == NONE {
                    return j;
                }
                first = first.min(j);
            }
        }
        first
    }
}

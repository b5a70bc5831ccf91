use pulp::{Arch, NullaryFnOnce};

use super::Costs;
use super::paths::{Arcs, Paths};
use super::row_reduction::{Bid, Rows, reduce_rows};
use super::state::{NONE, State, reduce_columns};

/// Cheapest arcs of a row at first.
const ARCS: usize = 12;
/// Share of all entries beyond which the core is no help any more.
const MOST_OF_ALL: f64 = 0.2;
/// Bids a row after which the search takes over; they are cheap here.
const BIDS: usize = 30;
/// Rounds of pricing before giving up.
const ROUNDS: usize = 30;

/// Solves a square problem over each row's few cheapest arcs, then looks through all entries for one that the duals contradict, adds
/// those and goes on from there. The answer is optimal for the whole matrix, by the duals.
///
/// `None` where that does not pay (all rows want the same columns) or no assignment was found: the caller then
/// takes all entries.
///
/// **Source**: Volgenant, "Linear and semi-assignment problems: a core oriented approach", 1996.
pub(super) fn solve(costs: Costs) -> Option<State> {
    Arch::new().dispatch(Solve { costs })
}

struct Solve<'a> {
    costs: Costs<'a>,
}

impl NullaryFnOnce for Solve<'_> {
    type Output = Option<State>;

    /// The passes over all entries are inlined here, so that they are compiled for the vectors of the machine.
    #[inline(always)]
    fn call(self) -> Option<State> {
        solve_core(self.costs)
    }
}

#[inline(always)]
fn solve_core(costs: Costs) -> Option<State> {
    let mut state = State::new(costs.rows, costs.columns);
    reduce_columns(costs, &mut state);
    let mut core = Core::new(costs, &state)?;
    let mut paths = Paths::new(costs.columns);
    let mut free = state.free_rows();
    for _ in 0..ROUNDS {
        for _ in 0..2 {
            reduce_rows(&core, &mut state, &mut free, BIDS);
        }
        for &row in &free {
            core.search(&mut paths, &mut state, row as usize)?;
        }
        free = core.price(&state)?;
        if free.is_empty() {
            return Some(state);
        }
        for &row in &free {
            let column = state.column_of_row[row as usize] as usize;
            state.column_of_row[row as usize] = NONE;
            state.row_of_column[column] = NONE;
        }
    }
    None
}

struct Core<'a> {
    costs: Costs<'a>,
    /// Columns and costs of every row's arcs.
    arcs: Vec<Vec<(u32, f64)>>,
    /// Reduced cost above the row's least up to which arcs were taken; +∞ where all are in.
    reach: Vec<f64>,
    budget: usize,
}

impl<'a> Core<'a> {
    #[inline(always)]
    fn new(costs: Costs<'a>, state: &State) -> Option<Self> {
        let reach = typical_reach(costs, &state.v);
        let mut core = Self {
            costs,
            arcs: vec![Vec::with_capacity(2 * ARCS); costs.rows],
            reach: vec![reach; costs.rows],
            budget: (MOST_OF_ALL * costs.values.len() as f64) as usize,
        };
        let mut covered = vec![false; costs.columns];
        for row in 0..costs.rows {
            core.gather(state, row)?;
            for &(j, _) in &core.arcs[row] {
                covered[j as usize] = true;
            }
        }
        // Fewer columns than rows in play: no assignment, and typically far from one.
        (covered.iter().filter(|c| **c).count() >= costs.rows).then_some(core)
    }

    /// Takes all arcs of a row up to its reach, the assigned one included.
    #[inline(always)]
    fn gather(&mut self, state: &State, row: usize) -> Option<()> {
        let (c, v) = (self.costs.row(row), &state.v);
        let limit = least_reduced(c, v) + self.reach[row];
        let arcs = &mut self.arcs[row];
        arcs.clear();
        for_each_up_to(c, v, limit, |j| arcs.push((j as u32, c[j])));
        if limit == f64::INFINITY {
            arcs.retain(|(_, cost)| *cost < f64::INFINITY);
        }
        let assigned = state.column_of_row[row];
        if assigned != NONE && !arcs.iter().any(|(j, _)| *j == assigned) {
            arcs.push((assigned, c[assigned as usize]));
        }
        self.budget = self.budget.checked_sub(arcs.len())?;
        Some(())
    }

    /// Assigns a free row along a shortest path of core arcs, taking in more arcs where there is none.
    fn search(&mut self, paths: &mut Paths, state: &mut State, start: usize) -> Option<()> {
        while let Err(stuck) = paths.assign(&*self, state, start) {
            if stuck.iter().all(|&row| self.reach[row] == f64::INFINITY) {
                return None;
            }
            for row in stuck {
                self.reach[row] = if self.reach[row] > 0.0 { 4.0 * self.reach[row] } else { f64::INFINITY };
                self.budget += self.arcs[row].len();
                self.gather(state, row)?;
                self.free_if_contradicted(state, row, start)?;
            }
        }
        Some(())
    }

    /// New arcs of an assigned row may undercut its own; the core search needs least reduced costs at assigned
    /// arcs, so such a case is left to the dense algorithm.
    fn free_if_contradicted(&self, state: &State, row: usize, start: usize) -> Option<()> {
        let column = state.column_of_row[row];
        if row == start || column == NONE {
            return Some(());
        }
        let reduced = |&(j, c): &(u32, f64)| c - state.v[j as usize];
        let own = self.arcs[row].iter().find(|(j, _)| *j == column).map(reduced)?;
        let least = self.arcs[row].iter().map(reduced).fold(f64::INFINITY, f64::min);
        (own <= least + tolerance(own)).then_some(())
    }

    /// Rows with an entry that the duals contradict; such entries join the core.
    #[inline(always)]
    fn price(&mut self, state: &State) -> Option<Vec<u32>> {
        let mut wrong = Vec::new();
        for row in 0..self.arcs.len() {
            if self.reach[row] == f64::INFINITY {
                continue;
            }
            let c = self.costs.row(row);
            let column = state.column_of_row[row] as usize;
            let own = c[column] - state.v[column];
            let limit = own - tolerance(own.abs() + state.v[column].abs());
            let before = self.arcs[row].len();
            let arcs = &mut self.arcs[row];
            for_each_up_to(c, &state.v, limit, |j| {
                if !arcs[..before].iter().any(|(k, _)| *k as usize == j) {
                    arcs.push((j as u32, c[j]));
                }
            });
            let added = arcs.len() - before;
            if added > 0 {
                self.budget = self.budget.checked_sub(added)?;
                wrong.push(row as u32);
            }
        }
        Some(wrong)
    }
}

impl Arcs for Core<'_> {
    fn of_row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.arcs[row].iter().map(|&(j, c)| (j as usize, c))
    }

    fn cost(&self, row: usize, column: usize) -> f64 {
        self.costs.row(row)[column]
    }
}

impl Rows for Core<'_> {
    fn len(&self) -> usize {
        self.arcs.len()
    }

    fn bid(&self, row: usize, v: &[f64]) -> Option<Bid> {
        let mut bid = Bid { best: 0, value: f64::INFINITY, next: f64::INFINITY };
        for &(j, c) in &self.arcs[row] {
            let r = c - v[j as usize];
            if r < bid.value {
                bid = Bid { best: j as usize, value: r, next: bid.value };
            } else if r < bid.next {
                bid.next = r;
            }
        }
        (bid.value < f64::INFINITY).then_some(bid)
    }

    fn second(&self, row: usize, v: &[f64], bid: &Bid) -> Option<usize> {
        let others = self.arcs[row].iter().map(|(j, c)| (*j as usize, c));
        others.filter(|(j, c)| *j != bid.best && *c - v[*j] == bid.next).map(|(j, _)| j).next()
    }
}

/// Rounding of a reduced cost of this size.
fn tolerance(size: f64) -> f64 {
    1e-13 * (1.0 + size.abs())
}

#[inline(always)]
fn least_reduced(c: &[f64], v: &[f64]) -> f64 {
    const LANES: usize = 16;
    let mut least = [f64::INFINITY; LANES];
    let (cs, vs) = (c.chunks_exact(LANES), v.chunks_exact(LANES));
    let tail = cs.remainder().iter().zip(vs.remainder()).map(|(c, v)| c - v).fold(f64::INFINITY, f64::min);
    for (c, v) in cs.zip(vs) {
        for l in 0..LANES {
            let r = c[l] - v[l];
            least[l] = if r < least[l] { r } else { least[l] };
        }
    }
    least.into_iter().fold(tail, f64::min)
}

/// Calls `visit` with every column of reduced cost at most `limit`, testing blocks at once.
#[inline(always)]
fn for_each_up_to(c: &[f64], v: &[f64], limit: f64, mut visit: impl FnMut(usize)) {
    const BLOCK: usize = 8;
    for (block, (cs, vs)) in c.chunks(BLOCK).zip(v.chunks(BLOCK)).enumerate() {
        let any = cs.iter().zip(vs).fold(false, |any, (c, v)| any | (c - v <= limit));
        if any {
            for (k, (c, v)) in cs.iter().zip(vs).enumerate() {
                if c - v <= limit {
                    visit(BLOCK * block + k);
                }
            }
        }
    }
}

/// How far above a row's least reduced cost its [`ARCS`] cheapest arcs reach: the median over some rows.
fn typical_reach(costs: Costs, v: &[f64]) -> f64 {
    const SAMPLES: usize = 15;
    if costs.columns <= ARCS {
        return f64::INFINITY;
    }
    let mut reaches: Vec<f64> = (0..SAMPLES.min(costs.rows))
        .map(|k| {
            let row = costs.row(k * costs.rows / SAMPLES.min(costs.rows));
            let mut reduced: Vec<f64> = row.iter().zip(v).map(|(c, v)| c - v).collect();
            let least = reduced.iter().copied().fold(f64::INFINITY, f64::min);
            let (_, at, _) = reduced.select_nth_unstable_by(ARCS, f64::total_cmp);
            if least < f64::INFINITY { *at - least } else { f64::INFINITY }
        })
        .collect();
    reaches.sort_by(f64::total_cmp);
    reaches[reaches.len() / 2]
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Cost of the assignment, after a look at its duals: no entry may undercut a row's own.
    fn certified_cost(costs: Costs, state: &State) -> f64 {
        let mut total = 0.0;
        for row in 0..costs.rows {
            let column = state.column_of_row[row] as usize;
            assert_eq!(state.row_of_column[column], row as u32);
            let own = costs.row(row)[column] - state.v[column];
            for (c, v) in costs.row(row).iter().zip(&state.v) {
                assert!(c - v >= own - 1e-9, "row {row}: {} undercuts {own}", c - v);
            }
            total += costs.row(row)[column];
        }
        total
    }

    #[test]
    fn core_finds_what_all_entries_find() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut solved = [0; 4];
        for n in [16, 40, 75, 130] {
            for _ in 0..12 {
                for (kind, solved) in solved.iter_mut().enumerate() {
                    let mut entry = |i: usize, j: usize| {
                        let uniform: f64 = rng.random();
                        match kind {
                            0 => uniform,
                            1 => (30.0 * uniform).floor(),
                            2 if i != j && uniform < 0.6 => f64::INFINITY,
                            2 => uniform - 0.5,
                            _ => (i as f64 - j as f64).abs() + uniform,
                        }
                    };
                    let values: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
                    let costs = Costs { rows: n, columns: n, values: &values };
                    let expected = super::super::dense::solve(costs).unwrap();
                    if let Some(found) = solve(costs) {
                        *solved += 1;
                        let (found, expected) =
                            (certified_cost(costs, &found), certified_cost(costs, &expected));
                        assert!((found - expected).abs() <= 1e-9 * n as f64, "{found} and {expected}");
                    }
                }
            }
        }
        assert!(solved.iter().all(|s| *s >= 20), "the core solved {solved:?} of 48 each");
    }
}

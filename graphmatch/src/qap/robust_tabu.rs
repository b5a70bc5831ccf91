use nalgebra::DMatrix;
use pulp::{Arch, Simd, WithSimd};
use rand::{Rng, RngExt};

use super::{Permutation, Qap};

/// Knobs of [`robust_tabu`].
#[derive(Debug, Clone, PartialEq)]
pub struct TabuParams {
    /// Swaps made, all restarts together. Default 300,000.
    pub iterations: usize,
    /// Searches from random permutations that share the swaps. Default 4.
    pub restarts: usize,
}

impl Default for TabuParams {
    fn default() -> Self {
        Self { iterations: 300_000, restarts: 4 }
    }
}

/// A permutation of low cost by tabu search over swaps of two.
///
/// Cost O(n²) a swap.
///
/// **Source**: Taillard, "Robust taboo search for the quadratic assignment problem", 1991; tenure drawn as the cube of
/// a uniform number times 8 n, aspiration after 5 n² swaps, as in the author's later program.
pub fn robust_tabu(problem: &Qap, params: &TabuParams, rng: &mut impl Rng) -> Permutation {
    let n = problem.size();
    let mut best =
        Permutation { image: (0..n).collect(), cost: problem.cost_of(&(0..n).collect::<Vec<_>>()) };
    if n < 2 {
        return best;
    }
    let restarts = params.restarts.max(1);
    for _ in 0..restarts {
        let mut image: Vec<usize> = (0..n).collect();
        for k in (1..n).rev() {
            image.swap(k, rng.random_range(0..=k));
        }
        let search = Search::new(problem, image);
        let found = Arch::new().dispatch(Run { search, swaps: params.iterations / restarts, rng: &mut *rng });
        if found.cost < best.cost {
            best = found;
        }
    }
    // Sums of many small changes drift; the answer's cost is counted afresh.
    best.cost = problem.cost_of(&best.image);
    best
}

struct Search<'a> {
    problem: &'a Qap,
    /// `a` by rows; the matrix itself is by columns.
    a_rows: DMatrix<f64>,
    n: usize,
    image: Vec<usize>,
    cost: f64,
    /// `b[p(i), p(j)]` by columns and by rows, kept current: the changes read it in order.
    placed: Vec<f64>,
    placed_rows: Vec<f64>,
    /// `Σ_k a[i,k] b[p(j), p(k)] + a[k,i] b[p(k), p(j)]` at `i * n + j`, kept current.
    gradient: Vec<f64>,
    /// All i < j, row by row.
    pairs: Vec<(usize, usize)>,
    /// Change of cost when the objects of a pair swap.
    change: Vec<f64>,
    a_diagonal: Vec<f64>,
    /// Room for what is counted afresh: diagonals of `placed` and `gradient`, changes of all swaps with one object.
    b_diagonal: Vec<f64>,
    g_diagonal: Vec<f64>,
    counted: Vec<f64>,
    /// Swap at which object i may return to place k, at `i * n + k`.
    barred_until: Vec<f64>,
    /// The earlier and the later end of the bars that swapping a pair would break.
    earlier: Vec<f64>,
    later: Vec<f64>,
}

struct Run<'a, R> {
    search: Search<'a>,
    swaps: usize,
    rng: &'a mut R,
}

impl<R: Rng> WithSimd for Run<'_, R> {
    type Output = Permutation;

    /// What is inlined here is compiled for the vectors of the machine.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Permutation {
        self.search.run(simd, self.swaps, self.rng)
    }
}

impl<'a> Search<'a> {
    fn new(problem: &'a Qap, image: Vec<usize>) -> Self {
        let n = image.len();
        let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
        let mut search = Self {
            problem,
            a_rows: problem.a().transpose(),
            n,
            cost: problem.cost_of(&image),
            placed: vec![0.0; n * n],
            placed_rows: vec![0.0; n * n],
            image,
            gradient: vec![0.0; n * n],
            change: vec![0.0; pairs.len()],
            a_diagonal: problem.a().diagonal().iter().copied().collect(),
            b_diagonal: vec![0.0; n],
            g_diagonal: vec![0.0; n],
            counted: vec![0.0; n],
            barred_until: (0..n * n).map(|k| -((n * (k / n) + k % n) as f64)).collect(),
            earlier: vec![0.0; pairs.len()],
            later: vec![0.0; pairs.len()],
            pairs,
        };
        for j in 0..n {
            for i in 0..n {
                let value = problem.b()[(search.image[i], search.image[j])];
                search.placed[j * n + i] = value;
                search.placed_rows[i * n + j] = value;
            }
        }
        for i in 0..n {
            for j in 0..n {
                let term = |k: usize| {
                    problem.a()[(i, k)] * search.placed[k * n + j]
                        + problem.a()[(k, i)] * search.placed[j * n + k]
                };
                search.gradient[i * n + j] = (0..n).map(term).sum();
            }
        }
        for i in 0..n {
            search.count_changes(i);
            search.renew_bars(i);
        }
        search
    }

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S, swaps: usize, rng: &mut impl Rng) -> Permutation {
        let n = self.n;
        let mut best = Permutation { image: self.image.clone(), cost: self.cost };
        let aspiration = (5 * n * n) as f64;
        for now in 1..=swaps {
            let now = now as f64;
            let Some((r, s)) = self.choose(simd, now, aspiration, best.cost) else { continue };
            let mut tenure = || {
                let x: f64 = rng.random();
                (x * x * x * 8.0 * n as f64).floor()
            };
            self.barred_until[r * n + self.image[r]] = now + tenure();
            self.barred_until[s * n + self.image[s]] = now + tenure();
            self.swap(r, s);
            if self.cost < best.cost - 1e-9 * best.cost.abs() {
                best = Permutation { image: self.image.clone(), cost: self.cost };
            }
        }
        best
    }

    /// The best swap that is allowed: not barred, or a new best, or not made for long.
    #[inline(always)]
    fn choose<S: Simd>(&self, simd: S, now: f64, aspiration: f64, best: f64) -> Option<(usize, usize)> {
        let (gain, old) = (best - self.cost, now - aspiration);
        // Least change of all allowed swaps and of those that aspire, with where to look for it.
        let (mut allowed, mut aspired) = ((f64::INFINITY, 0), (f64::INFINITY, 0));
        let chunks = self.change.chunks(CHUNK).zip(self.earlier.chunks(CHUNK)).zip(self.later.chunks(CHUNK));
        for (number, ((change, earlier), later)) in chunks.enumerate() {
            let (free, eager) = least(simd, [change, earlier, later], [now, old, gain]);
            if free < allowed.0 {
                allowed = (free, number * CHUNK);
            }
            if eager < aspired.0 {
                aspired = (eager, number * CHUNK);
            }
        }
        let eager = aspired.0 < f64::INFINITY;
        let (least, from) = if eager { aspired } else { allowed };
        (from..self.change.len().min(from + CHUNK))
            .find(|&k| {
                let change = self.change[k];
                let may = if eager { self.later[k] < old || change < gain } else { self.earlier[k] < now };
                may && change == least
            })
            .map(|k| self.pairs[k])
    }

    #[inline(always)]
    fn swap(&mut self, r: usize, s: usize) {
        let n = self.n;
        self.cost += self.change[pair_of(r, s, n)];
        self.image.swap(r, s);
        for matrix in [&mut self.placed, &mut self.placed_rows] {
            for k in 0..n {
                matrix.swap(k * n + r, k * n + s);
            }
            let (head, tail) = matrix.split_at_mut(r.max(s) * n);
            head[r.min(s) * n..][..n].swap_with_slice(&mut tail[..n]);
        }
        self.shift_gradient(r, s);
        self.shift_changes(r, s);
        for k in [r, s] {
            self.count_changes(k);
            self.renew_bars(k);
        }
    }

    /// Corrects the gradient after r and s have swapped.
    #[inline(always)]
    fn shift_gradient(&mut self, r: usize, s: usize) {
        let n = self.n;
        let (a, a_rows) = (self.problem.a().as_slice(), self.a_rows.as_slice());
        let (b_to, b_from) = (minus(&self.placed, n, r, s), minus(&self.placed_rows, n, r, s));
        for (i, row) in self.gradient.chunks_exact_mut(n).enumerate() {
            row.swap(r, s);
            let to = a[r * n + i] - a[s * n + i];
            let from = a_rows[r * n + i] - a_rows[s * n + i];
            for ((sum, b_to), b_from) in row.iter_mut().zip(&b_to).zip(&b_from) {
                *sum += to * b_to + from * b_from;
            }
        }
    }

    /// Corrects the changes of all swaps that touch neither r nor s, which have just swapped.
    #[inline(always)]
    fn shift_changes(&mut self, r: usize, s: usize) {
        let n = self.n;
        let (a, a_rows) = (self.problem.a().as_slice(), self.a_rows.as_slice());
        // Differences of the swapped two against every other, once instead of once a pair.
        let (a_to, a_from) = (minus(a_rows, n, r, s), minus(a, n, r, s));
        let (b_to, b_from) = (minus(&self.placed_rows, n, s, r), minus(&self.placed, n, s, r));
        let mut rest = self.change.as_mut_slice();
        for i in 0..n {
            let (row, next) = rest.split_at_mut(n - 1 - i);
            rest = next;
            let (at, af, bt, bf) = (a_to[i], a_from[i], b_to[i], b_from[i]);
            let (tos, froms) = (&a_to[i + 1..], &a_from[i + 1..]);
            let (b_tos, b_froms) = (&b_to[i + 1..], &b_from[i + 1..]);
            for ((((change, to), from), b_to), b_from) in
                row.iter_mut().zip(tos).zip(froms).zip(b_tos).zip(b_froms)
            {
                *change += (at - to) * (bt - b_to) + (af - from) * (bf - b_from);
            }
        }
    }

    /// Counts the changes of all swaps with `i` afresh.
    #[inline(always)]
    fn count_changes(&mut self, i: usize) {
        let n = self.n;
        let line = i * n..(i + 1) * n;
        let (a_row, a_column) =
            (&self.a_rows.as_slice()[line.clone()], &self.problem.a().as_slice()[line.clone()]);
        let (b_row, b_column) = (&self.placed_rows[line.clone()], &self.placed[line.clone()]);
        let g_row = &self.gradient[line];
        let (a_own, b_own, g_own) = (a_row[i], b_row[i], g_row[i]);
        let a_diagonal = self.a_diagonal.as_slice();
        for (k, (b, g)) in self.b_diagonal.iter_mut().zip(&mut self.g_diagonal).enumerate() {
            (*b, *g) = (self.placed[k * (n + 1)], self.gradient[k * (n + 1)]);
        }
        let changes = self.counted.iter_mut().zip(self.gradient.chunks_exact(n));
        let a = a_row.iter().zip(a_column).zip(a_diagonal);
        let b = b_row.iter().zip(b_column).zip(&self.b_diagonal);
        let g = g_row.iter().zip(&self.g_diagonal);
        for ((((change, g_column), ((a_to, a_from), a_other)), ((b_to, b_from), b_other)), (g_to, g_other)) in
            changes.zip(a).zip(b).zip(g)
        {
            // The gradient's sums run over all k; i and j change their places themselves.
            let own = (a_own - a_from) * (b_from - b_own)
                + (a_to - a_other) * (b_other - b_to)
                + (a_own - a_to) * (b_to - b_own)
                + (a_from - a_other) * (b_other - b_from);
            let crossed = (a_own - a_other) * (b_other - b_own) + (a_to - a_from) * (b_from - b_to);
            *change = g_to + g_column[i] - g_own - g_other - own + crossed;
        }
        for (j, k) in pairs_with(i, n) {
            self.change[k] = self.counted[j];
        }
    }

    /// Brings the bars of all swaps with `i` up to date.
    #[inline(always)]
    fn renew_bars(&mut self, i: usize) {
        let n = self.n;
        let (own, place) = (&self.barred_until[i * n..][..n], self.image[i]);
        for (j, k) in pairs_with(i, n) {
            let (to_j, to_i) = (own[self.image[j]], self.barred_until[j * n + place]);
            self.earlier[k] = to_j.min(to_i);
            self.later[k] = to_j.max(to_i);
        }
    }
}

/// All j other than i below n, each with where its pair with i is.
#[inline(always)]
fn pairs_with(i: usize, n: usize) -> impl Iterator<Item = (usize, usize)> {
    let first = move |j: usize| (j, pair_of(j, i, n));
    let second = move |j: usize| (j, pair_of(i, j, n));
    (0..i).map(first).chain((i + 1..n).map(second))
}

/// Where the pair of i and j is among all i < j < n, row by row.
#[inline(always)]
fn pair_of(i: usize, j: usize, n: usize) -> usize {
    i * (2 * n - i - 1) / 2 + (j - i - 1)
}

/// Pairs that are looked through at once.
const CHUNK: usize = 128;

/// Row (column) p of a matrix stored by rows (columns), less row (column) q.
#[inline(always)]
fn minus(m: &[f64], n: usize, p: usize, q: usize) -> Vec<f64> {
    m[p * n..][..n].iter().zip(&m[q * n..][..n]).map(|(p, q)| p - q).collect()
}

/// Least change of the swaps that are free, and of those that aspire.
///
/// * `swaps` – the change of each swap, and the earlier and the later end of its bars.
#[inline(always)]
fn least<S: Simd>(simd: S, swaps: [&[f64]; 3], [now, old, gain]: [f64; 3]) -> (f64, f64) {
    let [(changes, change_tail), (earliers, earlier_tail), (laters, later_tail)] = swaps.map(S::as_simd_f64s);
    let never = simd.splat_f64s(f64::INFINITY);
    let [nows, olds, gains] = [now, old, gain].map(|x| simd.splat_f64s(x));
    let (mut free, mut eager) = (never, never);
    for ((&change, &earlier), &later) in changes.iter().zip(earliers).zip(laters) {
        let may = simd.less_than_f64s(earlier, nows);
        free = simd.min_f64s(free, simd.select_f64s(may, change, never));
        let aspires = simd.or_m64s(simd.less_than_f64s(later, olds), simd.less_than_f64s(change, gains));
        eager = simd.min_f64s(eager, simd.select_f64s(aspires, change, never));
    }
    let (mut free, mut eager) = (simd.reduce_min_f64s(free), simd.reduce_min_f64s(eager));
    for ((&change, &earlier), &later) in change_tail.iter().zip(earlier_tail).zip(later_tail) {
        if earlier < now {
            free = free.min(change);
        }
        if later < old || change < gain {
            eager = eager.min(change);
        }
    }
    (free, eager)
}

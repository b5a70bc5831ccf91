use nalgebra::DMatrix;
use rand::{Rng, RngExt};

use super::{Permutation, Qap};

/// Knobs of [`robust_tabu`].
#[derive(Debug, Clone, PartialEq)]
pub struct TabuParams {
    /// Swaps made, all restarts together. Default 200,000.
    pub iterations: usize,
    /// Searches from random permutations that share the swaps. Default 4.
    pub restarts: usize,
}

impl Default for TabuParams {
    fn default() -> Self {
        Self { iterations: 200_000, restarts: 4 }
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
        let found = Search::new(problem, image).run(params.iterations / restarts, rng);
        if found.cost < best.cost {
            best = found;
        }
    }
    // Sums of many small changes drift; the answer's cost is counted afresh.
    best.cost = problem.cost_of(&best.image);
    best
}

struct Search<'a> {
    a: &'a DMatrix<f64>,
    b: &'a DMatrix<f64>,
    n: usize,
    image: Vec<usize>,
    cost: f64,
    /// `b[p(i), p(j)]`, column-major, kept current: the changes read it in order.
    placed: Vec<f64>,
    /// Change of cost when i and j swap, for i < j, at `i * n + j`.
    change: Vec<f64>,
    /// Swap at which object i may return to place k, at `i * n + k`.
    barred_until: Vec<i64>,
}

impl<'a> Search<'a> {
    fn new(problem: &'a Qap, image: Vec<usize>) -> Self {
        let n = image.len();
        let mut search = Self {
            a: problem.a(),
            b: problem.b(),
            n,
            cost: problem.cost_of(&image),
            placed: vec![0.0; n * n],
            image,
            change: vec![0.0; n * n],
            barred_until: (0..n * n).map(|k| -((n * (k / n) + k % n) as i64)).collect(),
        };
        search.place();
        for i in 0..n {
            for j in i + 1..n {
                search.change[i * n + j] = search.change_of(i, j);
            }
        }
        search
    }

    fn place(&mut self) {
        for j in 0..self.n {
            for i in 0..self.n {
                self.placed[j * self.n + i] = self.b[(self.image[i], self.image[j])];
            }
        }
    }

    fn run(mut self, swaps: usize, rng: &mut impl Rng) -> Permutation {
        let n = self.n;
        let mut best = Permutation { image: self.image.clone(), cost: self.cost };
        let aspiration = 5 * (n * n) as i64;
        for now in 1..=swaps as i64 {
            let Some((r, s)) = self.choose(now, aspiration, best.cost) else { continue };
            let mut tenure = || {
                let x: f64 = rng.random();
                (x * x * x * 8.0 * n as f64) as i64
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
    fn choose(&self, now: i64, aspiration: i64, best: f64) -> Option<(usize, usize)> {
        let n = self.n;
        let (mut chosen, mut least, mut aspired) = (None, f64::INFINITY, false);
        for i in 0..n {
            for j in i + 1..n {
                let (to_j, to_i) =
                    (self.barred_until[i * n + self.image[j]], self.barred_until[j * n + self.image[i]]);
                let change = self.change[i * n + j];
                let aspires =
                    (to_j < now - aspiration && to_i < now - aspiration) || self.cost + change < best;
                let free = to_j < now || to_i < now;
                let better = (aspires && !aspired) || (aspires == aspired && change < least);
                if better && (aspires || free) {
                    (chosen, least, aspired) = (Some((i, j)), change, aspires);
                }
            }
        }
        chosen
    }

    fn swap(&mut self, r: usize, s: usize) {
        let n = self.n;
        self.cost += self.change[r * n + s];
        self.image.swap(r, s);
        for k in 0..n {
            self.placed.swap(k * n + r, k * n + s);
        }
        for k in 0..n {
            self.placed.swap(r * n + k, s * n + k);
        }
        // Differences of the swapped two against every other, once instead of once a pair.
        let (mut a_to, mut a_from, mut b_to, mut b_from) =
            (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for k in 0..n {
            a_to[k] = self.a[(r, k)] - self.a[(s, k)];
            a_from[k] = self.a[(k, r)] - self.a[(k, s)];
            b_to[k] = self.placed[k * n + s] - self.placed[k * n + r];
            b_from[k] = self.placed[s * n + k] - self.placed[r * n + k];
        }
        for i in 0..n {
            if i == r || i == s {
                continue;
            }
            let row = &mut self.change[i * n..(i + 1) * n];
            let (at, af, bt, bf) = (a_to[i], a_from[i], b_to[i], b_from[i]);
            for j in i + 1..n {
                row[j] += (at - a_to[j]) * (bt - b_to[j]) + (af - a_from[j]) * (bf - b_from[j]);
            }
        }
        for k in 0..n {
            for pivot in [r, s] {
                let (i, j) = (k.min(pivot), k.max(pivot));
                if i != j {
                    self.change[i * n + j] = self.change_of(i, j);
                }
            }
        }
    }

    fn change_of(&self, i: usize, j: usize) -> f64 {
        let b = |x: usize, y: usize| self.placed[y * self.n + x];
        let a = self.a;
        let mut sum =
            (a[(i, i)] - a[(j, j)]) * (b(j, j) - b(i, i)) + (a[(i, j)] - a[(j, i)]) * (b(j, i) - b(i, j));
        for k in 0..self.n {
            if k != i && k != j {
                sum += (a[(k, i)] - a[(k, j)]) * (b(k, j) - b(k, i))
                    + (a[(i, k)] - a[(j, k)]) * (b(j, k) - b(i, k));
            }
        }
        sum
    }
}

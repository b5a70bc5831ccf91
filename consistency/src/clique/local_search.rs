use pulp::{Arch, NullaryFnOnce};

use super::held::{Held, Swapped};
use super::rows::{Set, count, members};

/// Improves a clique by adding vertices and by swapping one vertex for another: the move that gains most weight, of
/// equal ones that of the vertex that rested longest. A vertex that was dropped may not return at once.
///
/// Stops at a weight of `enough`. Deterministic.
///
/// * `apart` – for each vertex those it is not joined to.
///
/// **Source**: the plateau moves of Pullan and Hoos, *Dynamic Local Search for the Maximum Clique Problem*, 2006, and
/// the joined neighbourhoods of Wu, Hao and Glover, *Multi-neighborhood tabu search for the maximum weight clique
/// problem*, 2012, with fixed rules in place of random ones.
pub(super) fn improve<const W: usize>(
    apart: &[Set<W>],
    weights: &[u64],
    start: &[usize],
    steps: usize,
    enough: u64,
) -> Vec<usize> {
    Arch::new().dispatch(Improve { apart, weights, start, steps, enough })
}

struct Improve<'a, const W: usize> {
    apart: &'a [Set<W>],
    weights: &'a [u64],
    start: &'a [usize],
    steps: usize,
    enough: u64,
}

impl<const W: usize> NullaryFnOnce for Improve<'_, W> {
    type Output = Vec<usize>;

    #[inline(always)]
    fn call(self) -> Vec<usize> {
        let Self { apart, weights, start, steps, enough } = self;
        let (mut held, rank) = (Held::new(apart, weights, start), ranks(apart));
        let (mut best, mut heaviest) = (held.members(), held.weight());
        for _ in 0..steps {
            if heaviest >= enough {
                break;
            }
            held.now += 1;
            let Some(v) = best_move(&held, &rank).or_else(|| held.longest_outside()) else { break };
            held.swap_in(v);
            if held.weight() > heaviest {
                (best, heaviest) = (held.members(), held.weight());
            }
        }
        members(best).collect()
    }
}

/// Steps for which a vertex that moved stays where it is.
const REST: u64 = 5;

/// The vertex to add or swap in, if one is allowed to.
///
/// * `rank` – which of two vertices goes first that moved in the same step.
#[inline(always)]
fn best_move<const W: usize>(held: &Held<'_, W>, rank: &[u32]) -> Option<usize> {
    let (fit, near) = held.open();
    // Vertices that never moved may always do.
    let resting = held.now.saturating_sub(REST).max(1);
    let mut best = (i64::MIN, (resting, 0), None);
    for (open, swapped) in [(fit, Swapped::Nothing), (near, Swapped::One)] {
        for (block, mut word) in open.into_iter().enumerate() {
            while word != 0 {
                let v = 64 * block + word.trailing_zeros() as usize;
                word &= word - 1;
                let (gain, age) = (held.gain(v, swapped), (held.moved(v), rank[v]));
                if age.0 < resting && (gain > best.0 || gain == best.0 && age < best.1) {
                    best = (gain, age, Some(v));
                }
            }
        }
    }
    best.2
}

/// Vertices with few that they are not joined to first, then those with low numbers.
fn ranks<const W: usize>(apart: &[Set<W>]) -> Vec<u32> {
    let mut order: Vec<usize> = (0..apart.len()).collect();
    order.sort_by_cached_key(|&v| count(&apart[v]));
    let mut rank = vec![0; apart.len()];
    order.into_iter().zip(0..).for_each(|(v, at)| rank[v] = at);
    rank
}

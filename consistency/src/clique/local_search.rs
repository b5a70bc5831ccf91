use super::held::Held;
use crate::graph::bit_matrix::Apart;

/// Improves a clique by adding vertices and by swapping one vertex for another: the move that gains most weight, of
/// equal ones that of the vertex that rested longest. A vertex that was dropped may not return at once.
///
/// Stops at a weight of `enough`. Deterministic. A step costs the number of vertices *not* joined to the one that moves.
///
/// **Source**: the plateau moves of Pullan and Hoos, *Dynamic Local Search for the Maximum Clique Problem*, 2006, and
/// the joined neighbourhoods of Wu, Hao and Glover, *Multi-neighborhood tabu search for the maximum weight clique
/// problem*, 2012, with fixed rules in place of random ones.
pub(super) fn improve(
    apart: &Apart,
    weights: &[u64],
    start: &[usize],
    steps: usize,
    enough: u64,
) -> Vec<usize> {
    let mut held = Held::new(apart, weights, start);
    let (mut best, mut heaviest) = (start.to_vec(), held.weight());
    for _ in 0..steps {
        if heaviest >= enough {
            break;
        }
        held.now += 1;
        let Some(v) = best_move(&held, apart).or_else(|| held.longest_outside()) else { break };
        held.swap_in(v);
        if held.weight() > heaviest {
            heaviest = held.weight();
            best = held.members().iter().map(|&v| v as usize).collect();
        }
    }
    best
}

/// Steps for which a vertex that moved stays where it is.
const REST: u64 = 5;

/// The vertex to add or swap in, if one is allowed to.
fn best_move(held: &Held<'_>, apart: &Apart) -> Option<usize> {
    let mut best: Option<(i64, u64, usize)> = None;
    for &v in held.fit().iter().chain(held.near()) {
        let v = v as usize;
        let moved = held.moved(v);
        if moved != 0 && moved + REST >= held.now {
            continue;
        }
        let gain = held.gain(v);
        let rank = |u: usize| (apart.of(u).len(), u);
        if best.is_none_or(|(most, oldest, u)| {
            gain > most || gain == most && (moved < oldest || moved == oldest && rank(v) < rank(u))
        }) {
            best = Some((gain, moved, v));
        }
    }
    best.map(|(_, _, v)| v)
}

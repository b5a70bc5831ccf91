use super::rows::{Set, and, and_not, drop, empty, first, has, is_empty, or, put};

/// Upper bound of the number of independent vertices within `alive`: its vertices are covered by disjoint cliques (at
/// most one each), short odd cycles (at most half their length, rounded down), edges and single vertices.
pub(super) fn bound<const W: usize>(apart: &[Set<W>], alive: &Set<W>) -> isize {
    let mut rest = *alive;
    let mut total = cliques(apart, &mut rest);
    for half in 2..=LONGEST_HALF {
        total += odd_cycles(apart, &mut rest, half);
    }
    total + matching(apart, rest)
}

/// Half the length, rounded down, of the longest odd cycle looked for.
const LONGEST_HALF: usize = 4;

/// Cuts off cliques of three vertices and more.
fn cliques<const W: usize>(apart: &[Set<W>], rest: &mut Set<W>) -> isize {
    let (mut total, mut todo) = (0, *rest);
    while let Some(v) = first(&todo) {
        drop(&mut todo, v);
        let near = and(&apart[v], rest);
        let mut seconds = near;
        while let Some(a) = first(&seconds) {
            drop(&mut seconds, a);
            let mut common = and(&near, &apart[a]);
            if is_empty(&common) {
                continue;
            }
            let mut clique = empty::<W>();
            put(&mut clique, v);
            put(&mut clique, a);
            while let Some(b) = first(&common) {
                put(&mut clique, b);
                common = and(&common, &apart[b]);
            }
            *rest = and_not(rest, &clique);
            todo = and(&todo, rest);
            total += 1;
            break;
        }
    }
    total
}

/// Cuts off cycles of `2 half + 1` vertices through each vertex in turn.
fn odd_cycles<const W: usize>(apart: &[Set<W>], rest: &mut Set<W>, half: usize) -> isize {
    let (mut total, mut todo) = (0, *rest);
    while let Some(v) = first(&todo) {
        drop(&mut todo, v);
        if let Some(cycle) = odd_cycle(apart, rest, v, half) {
            *rest = and_not(rest, &cycle);
            todo = and(&todo, rest);
            total += half as isize;
        }
    }
    total
}

/// A cycle of `2 half + 1` vertices through `v`: two disjoint shortest paths to the ends of an edge between vertices
/// `half` steps away.
fn odd_cycle<const W: usize>(apart: &[Set<W>], rest: &Set<W>, v: usize, half: usize) -> Option<Set<W>> {
    let mut layers = [empty::<W>(); LONGEST_HALF + 1];
    put(&mut layers[0], v);
    let mut reached = layers[0];
    for step in 1..=half {
        let (mut front, mut next) = (layers[step - 1], empty::<W>());
        while let Some(u) = first(&front) {
            drop(&mut front, u);
            next = or(&next, &apart[u]);
        }
        next = and_not(&and(&next, rest), &reached);
        if is_empty(&next) {
            return None;
        }
        reached = or(&reached, &next);
        layers[step] = next;
    }
    let mut ends = layers[half];
    while let Some(x) = first(&ends) {
        drop(&mut ends, x);
        let mut partners = and(&apart[x], &ends);
        while let Some(y) = first(&partners) {
            drop(&mut partners, y);
            if let Some(cycle) = paths_back(apart, &layers, half, x, y) {
                return Some(cycle);
            }
        }
    }
    None
}

/// Walks from `x` and `y` back to the root, one layer at a time, on different vertices.
fn paths_back<const W: usize>(
    apart: &[Set<W>],
    layers: &[Set<W>; LONGEST_HALF + 1],
    half: usize,
    x: usize,
    y: usize,
) -> Option<Set<W>> {
    let mut cycle = empty::<W>();
    let (mut a, mut b) = (x, y);
    for step in (1..half).rev() {
        put(&mut cycle, a);
        put(&mut cycle, b);
        let (from_a, from_b) = (and(&apart[a], &layers[step]), and(&apart[b], &layers[step]));
        let (mut next_a, mut next_b) = (first(&from_a)?, first(&from_b)?);
        if next_a == next_b {
            let (mut other_a, mut other_b) = (from_a, from_b);
            drop(&mut other_a, next_a);
            drop(&mut other_b, next_b);
            match (first(&other_a), first(&other_b)) {
                (Some(other), _) => next_a = other,
                (None, Some(other)) => next_b = other,
                (None, None) => return None,
            }
        }
        (a, b) = (next_a, next_b);
    }
    put(&mut cycle, a);
    put(&mut cycle, b);
    layers[0].iter().zip(&mut cycle).for_each(|(root, all)| *all |= root);
    Some(cycle)
}

/// Vertices less the edges of a matching, improved by paths of three edges.
fn matching<const W: usize>(apart: &[Set<W>], rest: Set<W>) -> isize {
    let (mut total, mut free, mut single) = (0, rest, empty::<W>());
    let mut partner = [u32::MAX; 64].to_vec();
    partner.resize(64 * W, u32::MAX);
    while let Some(v) = first(&free) {
        drop(&mut free, v);
        let near = and(&apart[v], &free);
        total += 1;
        match first(&near) {
            Some(u) => {
                drop(&mut free, u);
                partner[u] = v as u32;
                partner[v] = u as u32;
            }
            None => put(&mut single, v),
        }
    }
    // A single s, joined to a matched a whose partner b is joined to another single: one edge more.
    let mut todo = single;
    while let Some(s) = first(&todo) {
        drop(&mut todo, s);
        let mut near = and(&apart[s], &rest);
        while let Some(a) = first(&near) {
            drop(&mut near, a);
            let b = partner[a] as usize;
            if has(&single, a) || b >= 64 * W {
                continue;
            }
            let mut others = and(&apart[b], &single);
            drop(&mut others, s);
            if let Some(t) = first(&others) {
                (partner[s], partner[a], partner[b], partner[t]) = (a as u32, s as u32, t as u32, b as u32);
                drop(&mut single, s);
                drop(&mut single, t);
                drop(&mut todo, t);
                total -= 1;
                break;
            }
        }
    }
    total
}

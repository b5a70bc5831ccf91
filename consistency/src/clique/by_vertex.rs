//! Splits a search by vertex: small graphs with an order of their own, and work for many threads.

use std::sync::atomic::{AtomicU64, Ordering};

use super::budget::Meter;
use super::rows::{BitMatrix, with_width};
use super::search::{self, Rival};
use crate::graph::{Adjacency, bits, degeneracy};

/// A clique of `matrix`, whose vertices stand in the order of colouring, of more than `lower` vertices: the largest,
/// or one of at least `enough`; or `None`.
///
/// The answer does not depend on the number of threads: of the parts that hold a largest clique the first one wins,
/// and what is returned is what a search of that part finds when it knows the size.
pub(super) fn search(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let branching = with_width!(matrix.words, root(matrix, lower));
    let mut open = vec![true; matrix.n];
    branching.iter().for_each(|&v| open[v] = false);
    let mut parts = Vec::with_capacity(branching.len());
    for &v in &branching {
        let around: Vec<usize> = bits::iter(matrix.row(v)).filter(|&u| open[u]).collect();
        open[v] = true;
        parts.push((v, around));
    }
    let incumbent = Incumbent(AtomicU64::new(Incumbent::pack(lower, u32::MAX)));
    run_all(matrix, &parts, &incumbent, enough, meter);
    let (size, index) = incumbent.get();
    let (v, around) = parts.get(index as usize)?;
    let rival = Rival { incumbent: None, index: 0 };
    let mut again = Meter::unlimited();
    let found = part(matrix, around, size - 2, size - 1, rival, &mut again)?;
    meter.nodes += again.nodes;
    Some(found.into_iter().chain([*v]).collect())
}

fn root<const W: usize>(matrix: &BitMatrix, lower: usize) -> Vec<usize> {
    search::root_branching::<W>(matrix, lower)
}

#[cfg(not(feature = "rayon"))]
fn run_all(
    matrix: &BitMatrix,
    parts: &[(usize, Vec<usize>)],
    incumbent: &Incumbent,
    enough: usize,
    meter: &mut Meter,
) {
    run_in_turn(matrix, parts, incumbent, enough, meter);
}

#[cfg(feature = "rayon")]
fn run_all(
    matrix: &BitMatrix,
    parts: &[(usize, Vec<usize>)],
    incumbent: &Incumbent,
    enough: usize,
    meter: &mut Meter,
) {
    use rayon::prelude::*;
    // A limit of nodes must stop at the same node each time, so such a search stays on one thread.
    if meter.limits_nodes() || rayon::current_num_threads() == 1 {
        return run_in_turn(matrix, parts, incumbent, enough, meter);
    }
    let shared = &*meter;
    let meters: Vec<Meter> = parts
        .par_iter()
        .enumerate()
        .with_max_len(1)
        .map(|(index, around)| {
            let mut meter = shared.fork();
            run_one(matrix, index, &around.1, incumbent, enough, &mut meter);
            meter
        })
        .collect();
    meters.iter().for_each(|one| meter.join(one));
}

fn run_in_turn(
    matrix: &BitMatrix,
    parts: &[(usize, Vec<usize>)],
    incumbent: &Incumbent,
    enough: usize,
    meter: &mut Meter,
) {
    for (index, (_, around)) in parts.iter().enumerate() {
        run_one(matrix, index, around, incumbent, enough, meter);
    }
}

fn run_one(
    matrix: &BitMatrix,
    index: usize,
    around: &[usize],
    incumbent: &Incumbent,
    enough: usize,
    meter: &mut Meter,
) {
    let known = incumbent.to_beat(index as u32);
    // The part's own vertex comes on top of what is found.
    if meter.stopped || known >= enough || around.len() < known {
        return;
    }
    let rival = Rival { incumbent: Some(incumbent), index: index as u32 };
    part(matrix, around, known.saturating_sub(1), enough - 1, rival, meter);
}

/// Searches the graph on `around` in its own degeneracy order.
fn part(
    matrix: &BitMatrix,
    around: &[usize],
    lower: usize,
    enough: usize,
    rival: Rival<'_>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let whole = matrix.select(around);
    if whole.edge_count() * 4 < whole.n * whole.n {
        // Such parts are small work: the order of the whole graph will do.
        let found = with_width!(whole.words, one(&whole, lower, enough, rival, meter))?;
        return Some(found.into_iter().map(|v| around[v]).collect());
    }
    let cores = degeneracy(&whole);
    let order: Vec<usize> = cores.order.into_iter().rev().filter(|&v| cores.core[v] >= lower).collect();
    if order.len() <= lower {
        return None;
    }
    let sorted = whole.select(&order);
    let found = with_width!(sorted.words, one(&sorted, lower, enough, rival, meter))?;
    Some(found.into_iter().map(|v| around[order[v]]).collect())
}

fn one<const W: usize>(
    matrix: &BitMatrix,
    lower: usize,
    enough: usize,
    rival: Rival<'_>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    search::search::<W>(matrix, lower, enough, rival, meter)
}

/// The largest size found by any part, and the first part that found it.
pub(super) struct Incumbent(AtomicU64);

impl Incumbent {
    /// Larger for a larger clique, then for an earlier part.
    fn pack(size: usize, index: u32) -> u64 {
        (size as u64) << 32 | u64::from(u32::MAX - index)
    }

    fn get(&self) -> (usize, u32) {
        let packed = self.0.load(Ordering::Relaxed);
        ((packed >> 32) as usize, u32::MAX - packed as u32)
    }

    /// Part `index` found a clique of `size` vertices, its own vertex among them.
    pub(super) fn offer(&self, size: usize, index: u32) {
        self.0.fetch_max(Self::pack(size, index), Ordering::Relaxed);
    }

    /// Size that part `index` has to beat: an equal one of a later part does not count. The size known at the start
    /// belongs to part `u32::MAX` but counts always.
    pub(super) fn to_beat(&self, index: u32) -> usize {
        let (size, by) = self.get();
        if by <= index || by == u32::MAX { size } else { size - 1 }
    }
}

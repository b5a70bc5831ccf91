//! Splits a complement search into parts, so that many threads can take them.

use super::budget::Meter;
use super::complement_search::{Tools, size_of, solve};
use super::complement_state::{State, Step, replay};
use super::incumbent::{Incumbent, START};
use super::rows::{count, is_empty};
use super::threads;
use crate::graph::bit_matrix::Apart;

/// An independent set of a complement, a clique of its graph, of more than `lower` vertices: the largest, or one of at
/// least `enough`, which no clique exceeds; or `None`.
///
/// * `hint` – may know a clique of `enough`; asked if the search does not end at once.
///
/// The answer does not depend on the number of threads: of the parts that hold a largest clique the first one wins,
/// and what is returned is what a search of that part finds when it knows the size.
pub(super) fn search<const W: usize>(
    apart: &Apart,
    lower: usize,
    enough: usize,
    hint: &dyn Fn() -> Option<Vec<usize>>,
    meter: &mut Meter,
) -> Option<Vec<usize>> {
    let (mut root, enough) = (State::<W>::of(apart), isize::try_from(enough).unwrap_or(isize::MAX));
    let lower = lower as isize;
    let mut tools = Tools::new(meter, AT_ONCE);
    tools.reduce(&mut root);
    let at_once = solve(root.clone(), lower, enough, &mut tools);
    let log = if tools.patience > 0 {
        at_once
    } else if let Some(clique) = hint() {
        return Some(clique);
    } else {
        in_parts(root, lower, enough, meter)
    };
    Some(replay(&log?, apart.len()))
}

/// Nodes of a search that costs less than a hint.
const AT_ONCE: u64 = 8;

/// Nodes of a search that is not worth a split.
const ALONE: u64 = 128;

/// Parts of a search that is.
const PARTS: usize = 64;

fn in_parts<const W: usize>(
    root: State<W>,
    lower: isize,
    enough: isize,
    meter: &mut Meter,
) -> Option<Vec<Step>> {
    let mut tools = Tools::new(meter, ALONE);
    let alone = solve(root.clone(), lower, enough, &mut tools);
    let known = alone.as_ref().map_or(lower, |log| size_of(log));
    if tools.patience > 0 || known >= enough || tools.meter.stopped {
        return alone;
    }
    let mut tools = Tools::new(meter, u64::MAX);
    let split =
        Split { parts: split(root, known, &mut tools), incumbent: Incumbent::new(known as u64), enough };
    let found = threads::run_all(split.parts.len(), meter, || (), |index, _, meter| split.run(index, meter));
    let (size, index) = split.incumbent.get();
    if index == START {
        return alone;
    }
    if meter.stopped {
        // There is no time to look for the same set each time.
        return found.into_iter().flatten().max_by_key(|log| log.len()).or(alone);
    }
    let part = split.parts.into_iter().nth(index as usize)?;
    solve(part, size as isize - 1, size as isize, &mut Tools::new(&mut Meter::unlimited(), u64::MAX))
}

/// Parts that hold every independent set of more than `lower` vertices, in the order of a search that goes deep first.
fn split<const W: usize>(root: State<W>, lower: isize, tools: &mut Tools<'_>) -> Vec<State<W>> {
    let mut parts = vec![(root, true)];
    while parts.len() < PARTS {
        let open = parts.iter().enumerate().filter(|(_, (_, open))| *open);
        let Some((largest, _)) = open.max_by_key(|(_, (part, _))| count(&part.alive)) else { break };
        let (mut part, _) = parts.remove(largest);
        tools.reduce(&mut part);
        let allowed = lower - part.size();
        if is_empty(&part.alive) || part.component(&part.alive) != part.alive {
            parts.insert(largest, (part, false));
        } else if tools.bound(&part.apart, &part.alive, allowed) > allowed
            && let Some(two) = tools.branch(part)
        {
            parts.splice(largest..largest, two.map(|part| (part, true)));
        }
    }
    parts.into_iter().map(|(part, _)| part).collect()
}

struct Split<const W: usize> {
    parts: Vec<State<W>>,
    incumbent: Incumbent,
    enough: isize,
}

impl<const W: usize> Split<W> {
    fn run(&self, index: usize, meter: &mut Meter) -> Option<Vec<Step>> {
        let known = self.incumbent.to_beat(index as u32, 0) as isize;
        if known >= self.enough {
            return None;
        }
        let log = solve(self.parts[index].clone(), known, self.enough, &mut Tools::new(meter, u64::MAX))?;
        self.incumbent.offer(log.len() as u64, index as u32);
        Some(log)
    }
}

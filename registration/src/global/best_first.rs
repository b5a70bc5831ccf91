use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::Error;

/// A box of poses that best-first branch and bound can split, bound and polish.
pub(super) trait Boxes {
    type Region: Copy;
    type Pose: Copy;

    /// Smaller regions that together hold the region.
    fn parts(&self, region: &Self::Region) -> Vec<Self::Region>;

    /// Whether the region lies wholly in what the search must leave out.
    fn is_excluded(&self, region: &Self::Region) -> bool;

    /// A lower bound of the cost in the region and an estimate of the cost at its centre; the bound may be left
    /// early once it is known to exceed `cut`, with an infinite estimate.
    fn bounds(&mut self, region: &Self::Region, cut: f64) -> (f64, f64);

    /// A pose found from the centre of the region that costs less than `best`, if it is worth the try and there is
    /// one.
    fn improve(
        &mut self,
        region: &Self::Region,
        estimate: f64,
        best: f64,
    ) -> Result<Option<(f64, Self::Pose)>, Error>;
}

/// What a search found.
pub(super) struct Found<P> {
    pub(super) pose: P,
    pub(super) cost: f64,
    /// No pose of the regions searched costs less.
    pub(super) lower_bound: f64,
    /// Whether the search ended by its gap.
    pub(super) certified: bool,
    /// Regions examined.
    pub(super) nodes: usize,
}

/// Splits the region of the smallest lower bound until none can beat the best pose by more than `gap`, or
/// `max_nodes` were examined; `None` when no pose was found.
pub(super) fn best_first<B: Boxes>(
    boxes: &mut B,
    root: B::Region,
    gap: f64,
    max_nodes: usize,
) -> Result<Option<Found<B::Pose>>, Error> {
    let mut best: Option<(f64, B::Pose)> = None;
    let mut heap = BinaryHeap::from([Node { lower: 0.0, id: 0, region: root }]);
    let (mut nodes, mut lower_bound, mut certified) = (0usize, f64::INFINITY, true);
    while let Some(node) = heap.pop() {
        let cut = best.map_or(f64::INFINITY, |b| b.0 - gap);
        if node.lower >= cut || nodes >= max_nodes {
            certified = node.lower >= cut;
            lower_bound = lower_bound.min(node.lower);
            break;
        }
        for region in boxes.parts(&node.region) {
            nodes += 1;
            if boxes.is_excluded(&region) {
                continue;
            }
            let cut = best.map_or(f64::INFINITY, |b| b.0 - gap);
            let (lower, estimate) = boxes.bounds(&region, cut);
            let lower = lower.max(node.lower);
            let cost = best.map_or(f64::INFINITY, |b| b.0);
            best = boxes.improve(&region, estimate, cost)?.or(best);
            if best.is_none_or(|b| lower < b.0 - gap) {
                heap.push(Node { lower, id: nodes, region });
            } else {
                lower_bound = lower_bound.min(lower);
            }
        }
    }
    Ok(best.map(|(cost, pose)| Found {
        pose,
        cost,
        lower_bound: lower_bound.min(cost).max(0.0),
        certified,
        nodes,
    }))
}

/// How many of `count` values a share `keep` is, at least one.
pub(super) fn kept_of(count: usize, keep: f64) -> usize {
    ((count as f64 * keep).ceil() as usize).clamp(1, count)
}

/// Mean of the smallest values, a share `keep` of them, which come to the front.
pub(super) fn mean_kept(squares: &mut [f64], keep: f64) -> f64 {
    let kept = kept_of(squares.len(), keep);
    if kept < squares.len() {
        squares.select_nth_unstable_by(kept - 1, f64::total_cmp);
    }
    squares[..kept].iter().sum::<f64>() / kept as f64
}

/// A stride coprime to `count`, so that its multiples visit all in a scattered order: sums over points then exceed
/// a limit early.
pub(super) fn scattering_stride(count: usize) -> usize {
    (1..).map(|k| count * 2 / 5 + k).find(|stride| gcd(*stride, count) == 1).unwrap_or(1)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

struct Node<R> {
    lower: f64,
    id: usize,
    region: R,
}

impl<R> PartialEq for Node<R> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl<R> Eq for Node<R> {}
impl<R> PartialOrd for Node<R> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<R> Ord for Node<R> {
    /// The heap's greatest is the region with the smallest lower bound, older first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.lower.total_cmp(&self.lower).then(other.id.cmp(&self.id))
    }
}

use nalgebra::SVector;
use pulp::Simd;

use super::bounds::Bounds;
use super::group::Group;
use super::leaf::{LEAF, Leaf};
use super::probe::{Probe, Single};
use super::visitor::{BestPosition, Count, Nearest, Neighbor, Visitor, Within};
use crate::Error;
use crate::parallel::join;

/// A static k-d tree over points in `D` dimensions.
///
/// Any finite points are fine: duplicates, points on a line, one point, none. Equal distances are ordered by
/// index. Building costs O(n log n), a nearest-neighbour query O(log n) on average.
///
/// ```
/// use draco_registration::KdTree;
/// use nalgebra::Vector2;
/// let tree = KdTree::new(&[Vector2::new(0.0, 0.0), Vector2::new(3.0, 4.0)])?;
/// let nearest = tree.nearest(&Vector2::new(2.0, 3.0)).unwrap();
/// assert_eq!((nearest.index, nearest.distance_sq), (1, 2.0));
/// # Ok::<(), draco_registration::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct KdTree<const D: usize> {
    /// Points in tree order: every leaf is a contiguous run.
    points: Vec<SVector<f64, D>>,
    /// Original index of each point in tree order.
    indices: Vec<u32>,
    /// In heap order: the root is 1, the children of `k` are `2 k` and `2 k + 1`. All leaves lie at one depth, after
    /// the inner nodes.
    nodes: Vec<Node<D>>,
    leaves: Vec<Leaf<D>>,
    /// The leaf of each point in tree order.
    leaf_of: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node<const D: usize> {
    /// Where an inner node is cut.
    value: f64,
    axis: usize,
    /// The part of space the cuts above leave to the node.
    cell: Bounds<D>,
    /// The box of its points.
    points: Bounds<D>,
}

impl<const D: usize> KdTree<D> {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`] for the first point with a NaN or infinite coordinate.
    pub fn new(points: &[SVector<f64, D>]) -> Result<Self, Error> {
        if let Some(index) = points.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(Error::NonFinitePoint { index });
        }
        let mut depth = 0;
        while points.len().div_ceil(1 << depth) > LEAF {
            depth += 1;
        }
        let mut items: Vec<(SVector<f64, D>, u32)> =
            points.iter().zip(0u32..).map(|(p, i)| (*p, i)).collect();
        let mut cuts = vec![Cut { value: 0.0, axis: 0 }; (1 << depth) - 1];
        split(&mut items, depth, &mut cuts);
        let (points, indices) = items.into_iter().unzip();
        let mut tree = Self { points, indices, nodes: Vec::new(), leaves: Vec::new(), leaf_of: Vec::new() };
        tree.lay_out(depth, &cuts);
        Ok(tree)
    }

    /// Makes nodes and leaves of the cuts, which come each before those of its left and then its right part.
    fn lay_out(&mut self, depth: u32, cuts: &[Cut]) {
        let cell = Bounds::everywhere();
        self.nodes = vec![Node { value: 0.0, axis: 0, cell, points: cell }; 2 << depth];
        self.leaves.reserve_exact(1 << depth);
        self.leaf_of.reserve_exact(self.points.len());
        if !self.points.is_empty() {
            self.lay_out_part(1, cuts, 0, self.points.len());
        }
    }

    fn lay_out_part(&mut self, k: usize, cuts: &[Cut], begin: usize, end: usize) {
        let Some((&Cut { value, axis }, below)) = cuts.split_first() else {
            return self.lay_out_leaf(k, begin, end);
        };
        let middle = begin + (end - begin) / 2;
        let (left, right) = below.split_at(below.len() / 2);
        (self.nodes[k].value, self.nodes[k].axis) = (value, axis);
        (self.nodes[2 * k].cell, self.nodes[2 * k + 1].cell) = (self.nodes[k].cell, self.nodes[k].cell);
        self.nodes[2 * k].cell.high[axis] = value;
        self.nodes[2 * k + 1].cell.low[axis] = value;
        self.lay_out_part(2 * k, left, begin, middle);
        self.lay_out_part(2 * k + 1, right, middle, end);
        let (a, b) = (self.nodes[2 * k].points, self.nodes[2 * k + 1].points);
        self.nodes[k].points = Bounds { low: a.low.inf(&b.low), high: a.high.sup(&b.high) };
    }

    fn lay_out_leaf(&mut self, k: usize, begin: usize, end: usize) {
        let mut leaf = Leaf { coordinates: [[f64::NAN; LEAF]; D], begin: begin as u32 };
        let mut hull = Bounds { low: self.points[begin], high: self.points[begin] };
        for (slot, point) in self.points[begin..end].iter().enumerate() {
            (0..D).for_each(|axis| leaf.coordinates[axis][slot] = point[axis]);
            hull = Bounds { low: hull.low.inf(point), high: hull.high.sup(point) };
            self.leaf_of.push(self.leaves.len() as u32);
        }
        self.nodes[k].points = hull;
        self.leaves.push(leaf);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The nearest point, or `None` in an empty tree.
    pub fn nearest(&self, query: &SVector<f64, D>) -> Option<Neighbor> {
        self.nearest_within(query, f64::INFINITY)
    }

    /// The nearest point not farther than `max_distance` (metres, inclusive).
    pub fn nearest_within(&self, query: &SVector<f64, D>, max_distance: f64) -> Option<Neighbor> {
        let distance_sq = max_distance * max_distance;
        let mut best = BestPosition { position: u32::MAX, index: u32::MAX, distance_sq };
        self.search(query, &mut best);
        (best.index != u32::MAX)
            .then_some(Neighbor { index: best.index as usize, distance_sq: best.distance_sq })
    }

    /// The `k` nearest points in order of distance; fewer if the tree holds fewer.
    pub fn k_nearest(&self, query: &SVector<f64, D>, k: usize) -> Vec<Neighbor> {
        let mut found = Vec::with_capacity(k.min(self.len()) + 1);
        self.k_nearest_into(query, k, &mut found);
        found
    }

    /// [`KdTree::k_nearest`] into a buffer that is cleared first.
    pub fn k_nearest_into(&self, query: &SVector<f64, D>, k: usize, found: &mut Vec<Neighbor>) {
        found.clear();
        if k > 0 {
            self.search(query, &mut Nearest { k, limit_sq: f64::INFINITY, found });
        }
    }

    /// The `k` nearest points to the one at a tree position, itself included, none of them farther than the root of
    /// `limit_sq`, into a buffer that is cleared first.
    #[inline(always)]
    pub(crate) fn k_nearest_at(&self, position: u32, k: usize, limit_sq: f64, found: &mut Vec<Neighbor>) {
        found.clear();
        if k > 0 {
            let query = self.point_at(position as usize);
            self.search_from(query, position, &mut Nearest { k, limit_sq, found });
        }
    }

    /// Position and squared distance of the nearest point, when the one at `guess` is likely to be it.
    pub(crate) fn nearest_from(&self, query: &SVector<f64, D>, guess: u32) -> (u32, f64) {
        let distance_sq = (self.point_at(guess as usize) - query).norm_squared();
        let mut best = BestPosition { position: guess, index: self.indices[guess as usize], distance_sq };
        self.search_from(query, guess, &mut best);
        (best.position, best.distance_sq)
    }

    /// All points not farther than `radius` (metres, inclusive), in order of index.
    pub fn within(&self, query: &SVector<f64, D>, radius: f64) -> Vec<Neighbor> {
        let mut visitor = Within { radius_sq: radius * radius, found: Vec::new() };
        self.search(query, &mut visitor);
        visitor.found.sort_unstable_by_key(|n| n.index);
        visitor.found
    }

    /// Number of points not farther than `radius`, counting stops at `enough`.
    pub fn count_within(&self, query: &SVector<f64, D>, radius: f64, enough: usize) -> usize {
        let mut visitor = Count { radius_sq: radius * radius, count: 0, enough };
        self.search(query, &mut visitor);
        visitor.count.min(enough)
    }

    /// The point at a tree position (not an original index).
    #[inline]
    pub(crate) fn point_at(&self, position: usize) -> &SVector<f64, D> {
        &self.points[position]
    }

    /// Original indices in tree order.
    pub(crate) fn order(&self) -> &[u32] {
        &self.indices
    }

    /// Visits the points within the visitor's limit, near leaves first.
    #[inline(always)]
    pub(crate) fn search<V: Visitor>(&self, query: &SVector<f64, D>, visitor: &mut V) {
        if !self.points.is_empty() {
            self.walk(self.descend(query, 1), &mut Single { query, visitor });
        }
    }

    /// The same, begun at the leaf of the point at a tree position: what is near that point is found without a way
    /// down the tree.
    #[inline(always)]
    pub(crate) fn search_from<V: Visitor>(&self, query: &SVector<f64, D>, position: u32, visitor: &mut V) {
        self.walk(self.leaf_at(position), &mut Single { query, visitor });
    }

    /// Fills in the nearest points of a group of queries, begun at the leaf of the point at `position` if there is one.
    #[inline(always)]
    pub(crate) fn search_group<S: Simd, const K: usize>(
        &self,
        group: &mut Group<S, D, K>,
        position: Option<u32>,
    ) {
        if !self.points.is_empty() {
            let leaf = match position {
                Some(position) => self.leaf_at(position),
                None => self.descend(group.guide(), 1),
            };
            self.walk(leaf, group);
        }
    }

    #[inline(always)]
    fn leaf_at(&self, position: u32) -> usize {
        self.leaves.len() + self.leaf_of[position as usize] as usize
    }

    /// Up from a leaf until the node at hand holds all that can be near, and down again into what was passed.
    #[inline(always)]
    fn walk(&self, leaf: usize, probe: &mut impl Probe<D>) {
        probe.scan(&self.leaves[leaf - self.leaves.len()], &self.indices);
        let mut k = leaf;
        while k > 1 && !probe.is_settled_in(&self.nodes[k].cell) {
            if probe.may_want(&self.nodes[k ^ 1].points) {
                self.walk_below(k ^ 1, probe);
            }
            k /= 2;
        }
    }

    #[inline(always)]
    fn walk_below(&self, root: usize, probe: &mut impl Probe<D>) {
        let mut k = root;
        loop {
            k = self.descend(probe.guide(), k);
            probe.scan(&self.leaves[k - self.leaves.len()], &self.indices);
            // up to the first node whose other side may hold something near
            loop {
                if k == root {
                    return;
                }
                let is_near = k % 2 == self.side(probe.guide(), k / 2);
                if is_near && probe.may_want(&self.nodes[k ^ 1].points) {
                    k ^= 1;
                    break;
                }
                k /= 2;
            }
        }
    }

    /// The leaf below node `k` whose cell holds the query or is on its side of every cut.
    #[inline(always)]
    fn descend(&self, query: &SVector<f64, D>, mut k: usize) -> usize {
        while k < self.leaves.len() {
            k = 2 * k + self.side(query, k);
        }
        k
    }

    #[inline(always)]
    fn side(&self, query: &SVector<f64, D>, k: usize) -> usize {
        let Node { value, axis, .. } = &self.nodes[k];
        usize::from(query[*axis] >= *value)
    }
}

/// Runs longer than this are split side by side if threads are there.
const PARALLEL: usize = 4096;

#[derive(Debug, Clone, Copy)]
struct Cut {
    value: f64,
    axis: usize,
}

fn split<const D: usize>(items: &mut [(SVector<f64, D>, u32)], levels: u32, cuts: &mut [Cut]) {
    let Some((cut, below)) = cuts.split_first_mut() else { return };
    let (mut low, mut high) = (items[0].0, items[0].0);
    for (point, _) in items.iter() {
        low = low.inf(point);
        high = high.sup(point);
    }
    let axis = (high - low).imax();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    *cut = Cut { value: items[middle].0[axis], axis };
    let parallel = items.len() > PARALLEL;
    let (left, right) = items.split_at_mut(middle);
    let (cuts_left, cuts_right) = below.split_at_mut((1 << (levels - 1)) - 1);
    if parallel {
        join(|| split(left, levels - 1, cuts_left), || split(right, levels - 1, cuts_right));
    } else {
        split(left, levels - 1, cuts_left);
        split(right, levels - 1, cuts_right);
    }
}

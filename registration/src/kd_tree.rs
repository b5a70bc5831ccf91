use nalgebra::SVector;

use crate::Error;
use crate::parallel::join;

/// Points a leaf holds at most; measured best of 4, 8, 12, 16 on scans of 1 000 and clouds of 30 000 points.
const LEAF: usize = 8;

/// One answer of a [`KdTree`] query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Index of the point in the slice the tree was built from.
    pub index: usize,
    /// Squared distance to the query, m².
    pub distance_sq: f64,
}

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
    /// Inner nodes, each before its left and then its right subtree. All leaves lie at one depth, so the children of
    /// `i` with `l` levels below are `i + 1` and `i + 2^(l - 1)`.
    nodes: Vec<Split>,
    depth: u32,
}

#[derive(Debug, Clone, Copy)]
struct Split {
    value: f64,
    axis: usize,
}

/// What a query wants to know; `limit_sq` shrinks as it learns.
pub(crate) trait Visitor {
    fn limit_sq(&self) -> f64;
    fn visit(&mut self, position: usize, index: u32, distance_sq: f64);
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
        let mut nodes = vec![Split { value: 0.0, axis: 0 }; (1 << depth) - 1];
        split(&mut items, depth, &mut nodes);
        let (points, indices) = items.into_iter().unzip();
        Ok(Self { points, indices, nodes, depth })
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
        let mut best = Best { index: u32::MAX, distance_sq: max_distance * max_distance };
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
        self.k_nearest_within(query, k, f64::INFINITY, found);
    }

    /// The `k` nearest points not farther than the root of `limit_sq`, into a buffer that is cleared first.
    pub(crate) fn k_nearest_within(
        &self,
        query: &SVector<f64, D>,
        k: usize,
        limit_sq: f64,
        found: &mut Vec<Neighbor>,
    ) {
        found.clear();
        if k > 0 {
            self.search(query, &mut Nearest { k, limit_sq, found });
        }
    }

    /// Position and squared distance of the nearest point, when the one at `guess` is likely to be it.
    pub(crate) fn nearest_from(&self, query: &SVector<f64, D>, guess: u32) -> (u32, f64) {
        let distance_sq = (self.point_at(guess as usize) - query).norm_squared();
        let mut best = BestPosition { position: guess, index: self.indices[guess as usize], distance_sq };
        self.search(query, &mut best);
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

    #[inline]
    pub(crate) fn search<V: Visitor>(&self, query: &SVector<f64, D>, visitor: &mut V) {
        if !self.points.is_empty() {
            let root = Branch { node: 0, begin: 0, end: self.points.len(), levels: self.depth };
            self.descend(query, visitor, root, &mut SVector::zeros());
        }
    }

    /// `offsets` is the vector from the cell of the branch to the query, zero along axes on which the query is inside.
    ///
    /// Its square is summed afresh in the order in which a distance is, so that rounding cannot make it exceed the
    /// distance of a point of the cell: ties are kept.
    fn descend<V: Visitor>(
        &self,
        query: &SVector<f64, D>,
        visitor: &mut V,
        branch: Branch,
        offsets: &mut SVector<f64, D>,
    ) {
        let Branch { node, begin, end, levels } = branch;
        if levels == 0 {
            for (offset, (point, index)) in
                self.points[begin..end].iter().zip(&self.indices[begin..end]).enumerate()
            {
                let distance_sq = (point - query).norm_squared();
                if distance_sq <= visitor.limit_sq() {
                    visitor.visit(begin + offset, *index, distance_sq);
                }
            }
            return;
        }
        let middle = begin + (end - begin) / 2;
        let Split { value, axis } = self.nodes[node];
        let offset = query[axis] - value;
        let left = Branch { node: node + 1, begin, end: middle, levels: levels - 1 };
        let right = Branch { node: node + (1 << (levels - 1)), begin: middle, end, levels: levels - 1 };
        let (near, far) = if offset < 0.0 { (left, right) } else { (right, left) };
        self.descend(query, visitor, near, offsets);
        let before = std::mem::replace(&mut offsets[axis], offset);
        if offsets.norm_squared() <= visitor.limit_sq() {
            self.descend(query, visitor, far, offsets);
        }
        offsets[axis] = before;
    }
}

/// A subtree: its root, its run of points and the levels below.
#[derive(Clone, Copy)]
struct Branch {
    node: usize,
    begin: usize,
    end: usize,
    levels: u32,
}

/// Runs longer than this are split side by side if threads are there.
const PARALLEL: usize = 4096;

fn split<const D: usize>(items: &mut [(SVector<f64, D>, u32)], levels: u32, nodes: &mut [Split]) {
    let Some((node, below)) = nodes.split_first_mut() else { return };
    let (mut low, mut high) = (items[0].0, items[0].0);
    for (point, _) in items.iter() {
        low = low.inf(point);
        high = high.sup(point);
    }
    let axis = (high - low).imax();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    *node = Split { value: items[middle].0[axis], axis };
    let parallel = items.len() > PARALLEL;
    let (left, right) = items.split_at_mut(middle);
    let (nodes_left, nodes_right) = below.split_at_mut((1 << (levels - 1)) - 1);
    if parallel {
        join(|| split(left, levels - 1, nodes_left), || split(right, levels - 1, nodes_right));
    } else {
        split(left, levels - 1, nodes_left);
        split(right, levels - 1, nodes_right);
    }
}

struct Best {
    index: u32,
    distance_sq: f64,
}

impl Visitor for Best {
    #[inline]
    fn limit_sq(&self) -> f64 {
        self.distance_sq
    }
    #[inline]
    fn visit(&mut self, _: usize, index: u32, distance_sq: f64) {
        if distance_sq < self.distance_sq || index < self.index {
            *self = Best { index, distance_sq };
        }
    }
}

/// The nearest point by tree position, and the distance of the runner-up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TwoNearest {
    pub(crate) position: u32,
    pub(crate) index: u32,
    pub(crate) distance_sq: f64,
    pub(crate) second_sq: f64,
}

impl TwoNearest {
    pub(crate) fn within(max_distance_sq: f64) -> Self {
        Self { position: u32::MAX, index: u32::MAX, distance_sq: f64::INFINITY, second_sq: max_distance_sq }
    }
}

impl Visitor for TwoNearest {
    #[inline]
    fn limit_sq(&self) -> f64 {
        self.second_sq
    }
    #[inline]
    fn visit(&mut self, position: usize, index: u32, distance_sq: f64) {
        if distance_sq < self.distance_sq || (distance_sq == self.distance_sq && index < self.index) {
            if self.position != u32::MAX {
                self.second_sq = self.distance_sq;
            }
            (self.position, self.index, self.distance_sq) = (position as u32, index, distance_sq);
        } else if distance_sq < self.second_sq {
            self.second_sq = distance_sq;
        }
    }
}

/// The nearest point by tree position.
struct BestPosition {
    position: u32,
    index: u32,
    distance_sq: f64,
}

impl Visitor for BestPosition {
    #[inline]
    fn limit_sq(&self) -> f64 {
        self.distance_sq
    }
    #[inline]
    fn visit(&mut self, position: usize, index: u32, distance_sq: f64) {
        if distance_sq < self.distance_sq || index < self.index {
            *self = BestPosition { position: position as u32, index, distance_sq };
        }
    }
}

struct Nearest<'a> {
    k: usize,
    limit_sq: f64,
    found: &'a mut Vec<Neighbor>,
}

impl Visitor for Nearest<'_> {
    #[inline]
    fn limit_sq(&self) -> f64 {
        if self.found.len() < self.k { self.limit_sq } else { self.found[self.k - 1].distance_sq }
    }
    #[inline]
    fn visit(&mut self, _: usize, index: u32, distance_sq: f64) {
        let new = Neighbor { index: index as usize, distance_sq };
        let mut at = self.found.len();
        if at == self.k {
            let worst = self.found[at - 1];
            if (worst.distance_sq, worst.index) <= (distance_sq, new.index) {
                return;
            }
            at -= 1;
            self.found[at] = new;
        } else {
            self.found.push(new);
        }
        while at > 0 && (distance_sq, new.index) < (self.found[at - 1].distance_sq, self.found[at - 1].index)
        {
            self.found.swap(at, at - 1);
            at -= 1;
        }
    }
}

struct Within {
    radius_sq: f64,
    found: Vec<Neighbor>,
}

impl Visitor for Within {
    fn limit_sq(&self) -> f64 {
        self.radius_sq
    }
    fn visit(&mut self, _: usize, index: u32, distance_sq: f64) {
        self.found.push(Neighbor { index: index as usize, distance_sq });
    }
}

struct Count {
    radius_sq: f64,
    count: usize,
    enough: usize,
}

impl Visitor for Count {
    fn limit_sq(&self) -> f64 {
        if self.count < self.enough { self.radius_sq } else { -1.0 }
    }
    fn visit(&mut self, _: usize, _: u32, _: f64) {
        self.count += 1;
    }
}

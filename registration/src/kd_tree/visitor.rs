/// What a query wants to know; `limit_sq` shrinks as it learns.
pub(crate) trait Visitor {
    fn limit_sq(&self) -> f64;
    fn visit(&mut self, position: usize, index: u32, distance_sq: f64);
}

/// One answer of a [`crate::KdTree`] query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Index of the point in the slice the tree was built from.
    pub index: usize,
    /// Squared distance to the query, m².
    pub distance_sq: f64,
}

/// The nearest few points by tree position, in order of distance, then of index.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NearestFew<const K: usize> {
    /// `u32::MAX` where there are fewer.
    pub(crate) positions: [u32; K],
    /// Infinite where there are fewer.
    pub(crate) squares: [f64; K],
    indices: [u32; K],
    max_distance_sq: f64,
}

impl<const K: usize> NearestFew<K> {
    pub(crate) fn within(max_distance_sq: f64) -> Self {
        Self {
            positions: [u32::MAX; K],
            squares: [f64::INFINITY; K],
            indices: [u32::MAX; K],
            max_distance_sq,
        }
    }
}

impl<const K: usize> Visitor for NearestFew<K> {
    #[inline(always)]
    fn limit_sq(&self) -> f64 {
        let last = self.squares[K - 1];
        if last < self.max_distance_sq { last } else { self.max_distance_sq }
    }
    #[inline(always)]
    fn visit(&mut self, position: usize, index: u32, distance_sq: f64) {
        let mut new = (distance_sq, index, position as u32);
        for k in 0..K {
            let old = (self.squares[k], self.indices[k], self.positions[k]);
            if new.0 < old.0 || (new.0 == old.0 && new.1 < old.1) {
                (self.squares[k], self.indices[k], self.positions[k]) = new;
                new = old;
            }
        }
    }
}

/// The nearest point by tree position.
pub(super) struct BestPosition {
    pub(super) position: u32,
    pub(super) index: u32,
    pub(super) distance_sq: f64,
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

pub(super) struct Nearest<'a> {
    pub(super) k: usize,
    pub(super) limit_sq: f64,
    pub(super) found: &'a mut Vec<Neighbor>,
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

pub(super) struct Within {
    pub(super) radius_sq: f64,
    pub(super) found: Vec<Neighbor>,
}

impl Visitor for Within {
    fn limit_sq(&self) -> f64 {
        self.radius_sq
    }
    fn visit(&mut self, _: usize, index: u32, distance_sq: f64) {
        self.found.push(Neighbor { index: index as usize, distance_sq });
    }
}

pub(super) struct Count {
    pub(super) radius_sq: f64,
    pub(super) count: usize,
    pub(super) enough: usize,
}

impl Visitor for Count {
    fn limit_sq(&self) -> f64 {
        if self.count < self.enough { self.radius_sq } else { -1.0 }
    }
    fn visit(&mut self, _: usize, _: u32, _: f64) {
        self.count += 1;
    }
}

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::Point2;

use super::grid::{Cell, Grid, cell_of, distance_sq};
use crate::Error;
use crate::disjoint_sets::DisjointSets;

/// Density clustering of a growing cloud: [`Dbscan::insert`] costs what lies near the new points, not the cloud.
///
/// [`Dbscan::labels`] equals [`dbscan`](crate::dbscan) of all points in the order of their insertion. Points are
/// never moved or removed: after a map correction that moves old points, build a new one.
///
/// ```
/// use draco_graphmatch::Dbscan;
/// use nalgebra::Point2;
///
/// let mut clusters = Dbscan::new(0.5, 2)?;
/// clusters.insert(&[Point2::new(0.0, 0.0), Point2::new(0.8, 0.0)])?;
/// assert_eq!(clusters.labels(), [None, None]);
/// clusters.insert(&[Point2::new(0.4, 0.0)])?;
/// assert_eq!(clusters.labels(), [Some(0), Some(0), Some(0)]);
/// # Ok::<(), draco_graphmatch::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Dbscan {
    eps: f64,
    min_samples: usize,
    grid: Grid,
    points: Vec<Point2<f64>>,
    /// Occupied cells. Never iterated, so its order cannot show.
    cells: HashMap<Cell, Members, BuildHasherDefault<CellHasher>>,
    /// Neighbours of every point, itself included, counted up to `min_samples`.
    neighbours: Vec<u32>,
    /// Core neighbours of a point that is not core (fewer than `min_samples`), else empty.
    touching: Vec<Vec<u32>>,
    sets: DisjointSets,
}

/// Mixes the two numbers of a cell; a look at 25 cells a point is most of the work, and nobody chooses them to collide.
#[derive(Debug, Clone, Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.write_u64(u64::from(b));
        }
    }

    fn write_u64(&mut self, x: u64) {
        // The odd number nearest 2⁶⁴ over the golden ratio spreads neighbours; the table takes the upper bits too.
        self.0 = (self.0.rotate_left(26) ^ x).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_i64(&mut self, x: i64) {
        self.write_u64(x.cast_unsigned());
    }

    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }
}

/// Points of one cell. They are mutual neighbours, so its core points belong to one cluster.
#[derive(Debug, Clone, Default)]
struct Members {
    /// In order of insertion.
    points: Vec<(Point2<f64>, u32)>,
    /// How many are not core points.
    loose: usize,
    /// The first that became a core point; all that did are joined with it.
    anchor: Option<u32>,
}

impl Dbscan {
    /// An empty cloud with the parameters of [`dbscan`](crate::dbscan).
    ///
    /// # Errors
    /// `eps` not positive and finite; `min_samples` 0.
    pub fn new(eps: f64, min_samples: usize) -> Result<Self, Error> {
        super::check(eps, min_samples)?;
        Ok(Self {
            eps,
            min_samples,
            grid: Grid::new(eps),
            points: Vec::new(),
            cells: HashMap::default(),
            neighbours: Vec::new(),
            touching: Vec::new(),
            sets: DisjointSets::default(),
        })
    }

    /// All points, in order of insertion.
    pub fn points(&self) -> &[Point2<f64>] {
        &self.points
    }

    /// Adds points behind those already there.
    ///
    /// # Errors
    /// A point that is not finite, with its index in `points`; none is added then.
    ///
    /// Cost O(neighbours of the new points and of the points they turn into core points).
    pub fn insert(&mut self, points: &[Point2<f64>]) -> Result<(), Error> {
        let mut cells = Vec::with_capacity(points.len());
        for (i, p) in points.iter().enumerate() {
            cells.push(cell_of(self.grid, p, i, self.eps)?);
        }
        for (p, &cell) in points.iter().zip(&cells) {
            self.insert_one(*p, cell);
        }
        Ok(())
    }

    fn insert_one(&mut self, point: Point2<f64>, cell: Cell) {
        let p = self.points.len();
        self.points.push(point);
        self.sets.push();
        self.touching.push(Vec::new());
        let members = self.cells.entry(cell).or_default();
        members.points.push((point, p as u32));
        members.loose += 1;
        let count = self.count(&point, cell);
        self.neighbours.push(0);
        let mut promoted = Vec::new();
        for q in self.loose_near(&point, cell) {
            if q != p {
                self.neighbours[q] += 1;
                if self.is_core(q) {
                    promoted.push(q);
                }
            }
        }
        self.neighbours[p] = count as u32;
        if self.is_core(p) {
            promoted.push(p);
        } else {
            // Newly promoted neighbours add themselves below.
            self.touching[p] = self.core_near(&point, cell, &promoted);
        }
        for q in promoted {
            self.promote(q);
        }
    }

    /// Neighbours of a point, itself included, counted up to `min_samples`.
    fn count(&self, point: &Point2<f64>, cell: Cell) -> usize {
        let eps_sq = self.eps * self.eps;
        let mut count = self.cells.get(&cell).map_or(0, |m| m.points.len());
        for members in self.around(cell).filter(|(c, _)| *c != cell).map(|(_, m)| m) {
            if count >= self.min_samples {
                break;
            }
            count += members.points.iter().filter(|(q, _)| distance_sq(point, q) <= eps_sq).count();
        }
        count.min(self.min_samples)
    }

    fn around(&self, (x, y): Cell) -> impl Iterator<Item = (Cell, &Members)> {
        (0..25).map(move |k| (x + k / 5 - 2, y + k % 5 - 2)).filter_map(|c| Some((c, self.cells.get(&c)?)))
    }

    /// Neighbours that are not core points.
    fn loose_near(&self, point: &Point2<f64>, cell: Cell) -> Vec<usize> {
        let eps_sq = self.eps * self.eps;
        self.around(cell)
            .filter(|(_, members)| members.loose > 0)
            .flat_map(|(_, members)| &members.points)
            .filter(|(q, k)| !self.is_core(*k as usize) && distance_sq(point, q) <= eps_sq)
            .map(|(_, k)| *k as usize)
            .collect()
    }

    /// Neighbours that are core points, without those in `but`.
    fn core_near(&self, point: &Point2<f64>, cell: Cell, but: &[usize]) -> Vec<u32> {
        let eps_sq = self.eps * self.eps;
        self.around(cell)
            .flat_map(|(_, members)| &members.points)
            .filter(|(q, k)| self.is_core(*k as usize) && distance_sq(point, q) <= eps_sq)
            .map(|(_, k)| *k)
            .filter(|k| !but.contains(&(*k as usize)))
            .collect()
    }

    fn is_core(&self, p: usize) -> bool {
        self.neighbours[p] as usize >= self.min_samples
    }

    /// Joins a new core point with its core neighbours and tells the others that they touch it.
    fn promote(&mut self, p: usize) {
        self.touching[p] = Vec::new();
        let point = self.points[p];
        let Some(cell) = self.grid.cell(&point) else { return };
        let Some(members) = self.cells.get_mut(&cell) else { return };
        members.loose -= 1;
        let anchor = *members.anchor.get_or_insert(p as u32);
        self.sets.union(p, anchor as usize);
        for q in self.loose_near(&point, cell) {
            self.touching[q].push(p as u32);
        }
        let eps_sq = self.eps * self.eps;
        let own = self.sets.root(p);
        let mut joined = Vec::new();
        for (_, members) in self.around(cell) {
            // Core points without anchor await their own promotion and then find this one.
            if members.anchor.is_some_and(|k| self.sets.root(k as usize) != own) {
                let mut core = members.points.iter().filter(|(_, k)| self.is_core(*k as usize));
                joined.extend(core.find(|(q, _)| distance_sq(&point, q) <= eps_sq).map(|(_, k)| *k as usize));
            }
        }
        for q in joined {
            self.sets.union(p, q);
        }
    }

    /// Cluster number of every point in order of insertion, `None` for noise. Cost O(n).
    pub fn labels(&self) -> Vec<Option<usize>> {
        let n = self.points.len();
        let roots: Vec<usize> = (0..n).map(|p| self.sets.root(p)).collect();
        let mut number = vec![usize::MAX; n];
        let mut clusters = 0;
        for p in (0..n).filter(|&p| self.is_core(p)) {
            if number[roots[p]] == usize::MAX {
                number[roots[p]] = clusters;
                clusters += 1;
            }
        }
        (0..n)
            .map(|p| {
                if self.is_core(p) {
                    Some(number[roots[p]])
                } else {
                    self.touching[p].iter().map(|&q| number[roots[q as usize]]).min()
                }
            })
            .collect()
    }
}

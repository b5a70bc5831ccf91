use std::collections::HashMap;

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
    /// Points of every cell, in order of insertion. Never iterated, so its order cannot show.
    cells: HashMap<Cell, Vec<u32>>,
    /// Neighbours of every point, itself included, counted up to `min_samples`.
    neighbours: Vec<u32>,
    /// Core neighbours of a point that is not core (fewer than `min_samples`), else empty.
    touching: Vec<Vec<u32>>,
    sets: DisjointSets,
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
            cells: HashMap::new(),
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
        let near = self.near(&point, cell);
        self.points.push(point);
        self.sets.push();
        self.cells.entry(cell).or_default().push(p as u32);
        self.neighbours.push(0);
        self.touching.push(Vec::new());
        self.neighbours[p] = (near.len() + 1).min(self.min_samples) as u32;
        let mut promoted = Vec::new();
        for &q in &near {
            let q = q as usize;
            if !self.is_core(q) {
                self.neighbours[q] += 1;
                if self.is_core(q) {
                    promoted.push(q);
                }
            }
        }
        if self.is_core(p) {
            self.promote(p, &near);
        } else {
            // Newly promoted neighbours add themselves below.
            self.touching[p] = near
                .iter()
                .copied()
                .filter(|&q| self.is_core(q as usize) && !promoted.contains(&(q as usize)))
                .collect();
        }
        for q in promoted {
            let position = self.points[q];
            if let Some(cell) = self.grid.cell(&position) {
                let near: Vec<u32> =
                    self.near(&position, cell).into_iter().filter(|&r| r as usize != q).collect();
                self.promote(q, &near);
            }
        }
    }

    fn is_core(&self, p: usize) -> bool {
        self.neighbours[p] as usize >= self.min_samples
    }

    /// Joins a new core point with its core neighbours and tells the others that they touch it.
    fn promote(&mut self, p: usize, near: &[u32]) {
        self.touching[p] = Vec::new();
        for &q in near {
            if self.is_core(q as usize) {
                self.sets.union(p, q as usize);
            } else {
                self.touching[q as usize].push(p as u32);
            }
        }
    }

    fn near(&self, point: &Point2<f64>, (x, y): Cell) -> Vec<u32> {
        let eps_sq = self.eps * self.eps;
        let mut near = Vec::new();
        for dx in -2..=2 {
            for dy in -2..=2 {
                let Some(cell) = self.cells.get(&(x + dx, y + dy)) else { continue };
                near.extend(
                    cell.iter().copied().filter(|&q| distance_sq(point, &self.points[q as usize]) <= eps_sq),
                );
            }
        }
        near
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

use std::ops::Range;

use nalgebra::Point2;

use super::grid::{Cell, Grid, cell_of, distance_sq};
use crate::Error;
use crate::disjoint_sets::DisjointSets;

/// Cluster number of every point, `None` for noise.
///
/// * `points` – metres, any order, duplicates allowed.
/// * `eps` – radius of a neighbourhood (inclusive), metres, positive.
/// * `min_samples` – points, itself included, that make a point a core point; at least 1.
///
/// # Errors
/// A point that is not finite; `eps` not positive, or below 2⁻⁵⁰ of the largest coordinate; `min_samples` 0.
///
/// Cost O(n log n) for bounded density; cells of the grid that hold `min_samples` points are never searched.
///
/// **Source**: Ester, Kriegel, Sander, Xu, "A density-based algorithm for discovering clusters in large spatial
/// databases with noise", 1996; grid cells as in Gunawan, "A faster algorithm for DBSCAN", 2013.
///
/// ```
/// use draco_graphmatch::dbscan;
/// use nalgebra::Point2;
///
/// let points = [0.0, 0.4, 9.0, 0.8].map(|x| Point2::new(x, 0.0));
/// assert_eq!(dbscan(&points, 0.5, 2)?, [Some(0), Some(0), None, Some(0)]);
/// # Ok::<(), draco_graphmatch::Error>(())
/// ```
pub fn dbscan(points: &[Point2<f64>], eps: f64, min_samples: usize) -> Result<Vec<Option<usize>>, Error> {
    super::check(eps, min_samples)?;
    let cells = Cells::new(points, eps)?;
    let neighbours = cells.neighbours();
    let core = cells.core_points(&neighbours, min_samples);
    let mut sets = cells.connect(&neighbours, &core);
    Ok(cells.labels(&neighbours, &core, &mut sets))
}

/// The cloud sorted by cell. Inside a cell points keep their order, so a cell's first core point has the cell's
/// smallest core index.
struct Cells {
    eps_sq: f64,
    /// Points in cell order, and the index each had in the input.
    points: Vec<Point2<f64>>,
    index: Vec<u32>,
    /// Distinct cells in lexicographic order and the range of points of each.
    keys: Vec<Cell>,
    ranges: Vec<Range<usize>>,
}

impl Cells {
    fn new(points: &[Point2<f64>], eps: f64) -> Result<Self, Error> {
        let grid = Grid::new(eps);
        let mut order = Vec::with_capacity(points.len());
        for (i, p) in points.iter().enumerate() {
            order.push((cell_of(grid, p, i, eps)?, i as u32));
        }
        order.sort_unstable();
        let mut cells = Self {
            eps_sq: eps * eps,
            points: order.iter().map(|&(_, i)| points[i as usize]).collect(),
            index: order.iter().map(|&(_, i)| i).collect(),
            keys: Vec::new(),
            ranges: Vec::new(),
        };
        let mut start = 0;
        for group in order.chunk_by(|a, b| a.0 == b.0) {
            cells.keys.push(group[0].0);
            cells.ranges.push(start..start + group.len());
            start += group.len();
        }
        Ok(cells)
    }

    /// For each cell the five runs of cells (one a column of the 5 × 5 block) that can hold neighbours. Cells are
    /// sorted, so each column's run only moves forward.
    fn neighbours(&self) -> Vec<[Range<u32>; 5]> {
        let mut from = [0; 5];
        let mut to = [0; 5];
        let mut runs = Vec::with_capacity(self.keys.len());
        for &(x, y) in &self.keys {
            runs.push(std::array::from_fn(|column| {
                let x = x + column as i64 - 2;
                while from[column] < self.keys.len() && self.keys[from[column]] < (x, y - 2) {
                    from[column] += 1;
                }
                while to[column] < self.keys.len() && self.keys[to[column]] <= (x, y + 2) {
                    to[column] += 1;
                }
                from[column] as u32..to[column] as u32
            }));
        }
        runs
    }

    fn core_points(&self, neighbours: &[[Range<u32>; 5]], min_samples: usize) -> Vec<bool> {
        let mut core = vec![false; self.points.len()];
        for (cell, range) in self.ranges.iter().enumerate() {
            for p in range.clone() {
                core[p] =
                    range.len() >= min_samples || self.has_neighbours(&neighbours[cell], p, min_samples);
            }
        }
        core
    }

    fn has_neighbours(&self, runs: &[Range<u32>; 5], p: usize, needed: usize) -> bool {
        let mut count = 0;
        for q in self.points_of(runs) {
            count += usize::from(distance_sq(&self.points[p], &self.points[q]) <= self.eps_sq);
            if count >= needed {
                return true;
            }
        }
        false
    }

    /// Points of the runs' cells; a column's cells are adjacent, so each run is one range of points.
    fn points_of<'a>(&'a self, runs: &'a [Range<u32>; 5]) -> impl Iterator<Item = usize> + 'a {
        runs.iter()
            .filter(|run| !run.is_empty())
            .flat_map(|run| self.ranges[run.start as usize].start..self.ranges[run.end as usize - 1].end)
    }

    /// Connected components of core points.
    fn connect(&self, neighbours: &[[Range<u32>; 5]], core: &[bool]) -> DisjointSets {
        let mut sets = DisjointSets::new(self.points.len());
        let first: Vec<Option<usize>> =
            self.ranges.iter().map(|range| range.clone().find(|&p| core[p])).collect();
        for (cell, range) in self.ranges.iter().enumerate() {
            let Some(a) = first[cell] else { continue };
            for p in range.clone().filter(|&p| core[p]) {
                sets.union(a, p);
            }
            for other in neighbours[cell].iter().flat_map(Clone::clone).map(|c| c as usize) {
                let Some(b) = first[other].filter(|_| other > cell) else { continue };
                if sets.find(a) != sets.find(b) && self.touch(range, &self.ranges[other], core) {
                    sets.union(a, b);
                }
            }
        }
        sets
    }

    fn touch(&self, a: &Range<usize>, b: &Range<usize>, core: &[bool]) -> bool {
        a.clone().filter(|&p| core[p]).any(|p| {
            b.clone().any(|q| core[q] && distance_sq(&self.points[p], &self.points[q]) <= self.eps_sq)
        })
    }

    fn labels(
        &self,
        neighbours: &[[Range<u32>; 5]],
        core: &[bool],
        sets: &mut DisjointSets,
    ) -> Vec<Option<usize>> {
        let n = self.points.len();
        let mut position = vec![0_u32; n];
        for (p, &i) in self.index.iter().enumerate() {
            position[i as usize] = p as u32;
        }
        let mut number = vec![usize::MAX; n];
        let mut clusters = 0;
        for p in position.iter().map(|&p| p as usize).filter(|&p| core[p]) {
            let root = sets.find(p);
            if number[root] == usize::MAX {
                number[root] = clusters;
                clusters += 1;
            }
        }
        let mut labels = vec![None; n];
        for (cell, range) in self.ranges.iter().enumerate() {
            for p in range.clone() {
                labels[self.index[p] as usize] = if core[p] {
                    Some(number[sets.find(p)])
                } else {
                    self.points_of(&neighbours[cell])
                        .filter(|&q| core[q] && distance_sq(&self.points[p], &self.points[q]) <= self.eps_sq)
                        .map(|q| number[sets.find(q)])
                        .min()
                };
            }
        }
        labels
    }
}

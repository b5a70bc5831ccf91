use std::f64::consts::{LN_10, PI};

use nalgebra::{Isometry2, Point2, Vector2};

use super::buckets::Buckets;
use super::evidence::{Explanation, middle, ties, weigh_repeated};
use super::problem::Problem;
use super::window::{convex_hull, perimeter, polygon_area};
use crate::rigid::{Tie, fit_rigid};

/// Prior odds, in nats, of a transform under which two structures of one kind are not one: a tenth of the true ones are thought
/// to be so.
pub(super) const APART: f64 = -LN_10;
/// The same of a transform under which one structure goes on in the other: the others are, and by chance a transform lays a lattice
/// of 6 m onto another about once in a thousand times (a twenty-fifth of all places are within the gate, a thirtieth of all turns).
const ONE: f64 = 6.8;
/// Added where both together are one block, or taken away where not: four fifths of fields are (piers are strips), but of the places
/// that lay lattices of a few rows onto each other only a ninth make a block.
const BLOCK: f64 = 1.97;
const NO_BLOCK: f64 = -1.49;

/// Share of the repeated objects that must continue the other map's structure.
const SHARE: f64 = 0.8;
/// Shifts of the structure that are used, those of most pairs.
const SHIFTS: usize = 16;
/// Distance, in spacings, up to which the nearest object is thought the right one before the structures are fitted to each other.
const LOOSE: f64 = 0.35;
/// Objects that may be missing from a block, and the share of it: its outline is known to the noise of the outermost.
const MISSING: f64 = 1.0;
const MISSING_SHARE: f64 = 0.02;

/// What repeats itself in both maps, to tell whether it is one structure. Rows of pilings go on beyond what one robot saw of
/// them.
pub(super) struct Continuation<'a> {
    problem: &'a Problem<'a>,
    /// Of map 1 onto itself, either way, those of most pairs first.
    shifts: &'a [Vector2<f64>],
    structure: Vec<Point2<f64>>,
    /// The structure's, for what lies within `loose`.
    buckets: Buckets,
    loose: f64,
    others: Vec<Point2<f64>>,
    centre: Point2<f64>,
    reach: f64,
    /// Usual distance of neighbours.
    spacing: f64,
    /// Objects for each place of either map's own block, on average.
    fill: f64,
}

impl<'a> Continuation<'a> {
    /// `None` where not both maps repeat themselves, map 1 by shifts.
    pub(super) fn new(problem: &'a Problem, shifts: &'a [Vector2<f64>]) -> Option<Self> {
        let of = |points: &[Point2<f64>], repeated: &[bool]| -> Vec<Point2<f64>> {
            points.iter().zip(repeated).filter(|(_, r)| **r).map(|(p, _)| *p).collect()
        };
        let structure = of(&problem.p1, &problem.repeated1);
        let others = of(&problem.p2, &problem.repeated2);
        if shifts.is_empty() || structure.is_empty() || others.is_empty() {
            return None;
        }
        let spacing = spacing(&structure);
        let places = places(&structure, spacing) + places(&others, spacing);
        let reach = problem.params.gate * problem.largest_sigma;
        let loose = reach.max(LOOSE * spacing);
        Some(Self {
            problem,
            buckets: Buckets::new(&structure, loose),
            loose,
            reach,
            shifts: &shifts[..SHIFTS.min(shifts.len())],
            centre: middle(&structure),
            fill: (structure.len() + others.len()) as f64 / places,
            spacing,
            structure,
            others,
        })
    }

    /// The most that [`Continuation::log_odds`] adds.
    pub(super) const MOST: f64 = ONE + BLOCK;

    /// What the way in which both structures lie adds to an explanation's evidence, nats.
    pub(super) fn log_odds(&self, found: &Explanation) -> f64 {
        let Some(transform) = self.fit(found) else { return APART };
        let block = if self.is_block(&transform) { BLOCK } else { NO_BLOCK };
        (ONE + block - self.strain(found, &transform)).max(APART)
    }

    /// The transform by the explanation's pairs and both structures together, if whole shifts of map 1 onto itself carry map 2's
    /// repeated objects onto its own.
    fn fit(&self, found: &Explanation) -> Option<Isometry2<f64>> {
        let most_missing = (1.0 - SHARE) * self.others.len() as f64;
        let mut transform = found.map1_from_map2;
        for reach in [self.loose, self.reach] {
            // The explanation's few pairs leave its angle too wide for the structure's far end; both fit together are judged.
            let mut all = ties(self.problem, &found.pairs);
            let weight = all.first().map_or(1.0, |tie| tie.weight);
            let mut missing = 0.0;
            for p in &self.others {
                let (carried, shift) = carry(self.shifts, &self.centre, transform * p);
                match self.nearest(&carried, reach) {
                    Some(nearest) => all.push(Tie { first: nearest - shift, second: *p, weight }),
                    None => missing += 1.0,
                }
                if missing > most_missing {
                    return None;
                }
            }
            transform = fit_rigid(&all);
        }
        Some(transform)
    }

    /// The nearest object of the structure within `reach`, at most `loose`.
    fn nearest(&self, point: &Point2<f64>, reach: f64) -> Option<Point2<f64>> {
        let mut best = (reach * reach, None);
        self.buckets.around(point, |k| {
            let distance_sq = (self.structure[k] - point).norm_squared();
            if distance_sq <= best.0 {
                best = (distance_sq, Some(self.structure[k]));
            }
        });
        best.1
    }

    /// Evidence that the explanation's pairs lose under another transform; what they gain there, as their own fit does not weigh
    /// repeated ones less, tells nothing of the structures.
    fn strain(&self, found: &Explanation, transform: &Isometry2<f64>) -> f64 {
        let half_chi2 = |transform: &Isometry2<f64>| -> f64 {
            let weighed = weigh_repeated(self.problem, &found.pairs);
            weighed
                .iter()
                .map(|tie| 0.5 * tie.weight * (tie.first - transform * tie.second).norm_squared())
                .sum()
        };
        (half_chi2(transform) - half_chi2(&found.map1_from_map2)).max(0.0)
    }

    /// Whether both structures together fill their outline as each fills its own.
    fn is_block(&self, transform: &Isometry2<f64>) -> bool {
        let mut all = self.structure.clone();
        let moved = self.others.iter().map(|p| transform * p);
        all.extend(moved.filter(|p| self.nearest(p, self.reach).is_none()));
        let expected = self.fill * places(&all, self.spacing);
        expected - all.len() as f64 <= MISSING + MISSING_SHARE * expected
    }
}

/// Median distance of an object's nearest neighbour.
fn spacing(points: &[Point2<f64>]) -> f64 {
    let nearest = |p: &Point2<f64>| {
        let others = points.iter().map(|q| (p - q).norm()).filter(|d| *d > 0.0);
        others.fold(f64::INFINITY, f64::min)
    };
    let mut distances: Vec<f64> = points.iter().map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    distances[distances.len() / 2]
}

/// Squares of side `spacing` in the hull of the points, grown by half a side all around.
fn places(points: &[Point2<f64>], spacing: f64) -> f64 {
    let hull = convex_hull(points);
    polygon_area(&hull) / spacing.powi(2) + 0.5 * perimeter(&hull) / spacing + 0.25 * PI
}

/// Shifts a point as near to the centre as whole shifts bring it; also what moved it.
fn carry(
    shifts: &[Vector2<f64>],
    centre: &Point2<f64>,
    mut point: Point2<f64>,
) -> (Point2<f64>, Vector2<f64>) {
    let mut moved = Vector2::zeros();
    let mut distance_sq = (point - centre).norm_squared();
    loop {
        let from = point - centre;
        let nearer = shifts.iter().map(|s| (s, (from + s).norm_squared())).min_by(|a, b| a.1.total_cmp(&b.1));
        match nearer {
            // Shrinking by a thousandth at least, so that this ends.
            Some((shift, next)) if next < 0.998 * distance_sq => {
                point += shift;
                moved += shift;
                distance_sq = next;
            }
            _ => return (point, moved),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consensus::ConsensusParams;
    use crate::consensus::evidence::refine;
    use crate::split_mix::SplitMix;
    use crate::{NoSimilarity, Object};

    fn lattice(columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Vec<Point2<f64>> {
        let place = |c: usize, r: usize| Point2::new(6.0 * c as f64, 6.0 * r as f64);
        columns.flat_map(|c| rows.clone().map(move |r| place(c, r))).collect()
    }

    #[test]
    fn a_lattice_has_one_object_a_place() {
        let strip = lattice(0..6, 0..3);
        assert_eq!(spacing(&strip), 6.0);
        // The rounded corners lack a little of the squares there.
        assert!((places(&strip, 6.0) - (18.0 - (1.0 - 0.25 * PI))).abs() < 1e-9);
    }

    #[test]
    fn a_longer_strip_is_full_and_a_corner_is_not() {
        let mut longer = lattice(0..6, 0..3);
        longer.extend(lattice(6..10, 0..3));
        assert!(places(&longer, 6.0) < 30.0);
        let mut corner = lattice(0..6, 0..3);
        corner.extend(lattice(0..3, 3..6));
        assert!(places(&corner, 6.0) > 27.0 + 2.0 * MISSING);
    }

    #[test]
    fn no_explanation_gains_more_than_the_most() {
        let mut draw = SplitMix::new(5);
        let mut noise = || 0.6 * (draw.below(1000) as f64 / 1000.0 - 0.5);
        let params = ConsensusParams::default();
        let places: Vec<Point2<f64>> =
            lattice(0..6, 0..3).into_iter().chain([Point2::new(14.0, 21.0)]).collect();
        let map1: Vec<Object> = places.iter().map(|p| Object::new(*p, 1.0, 1.0)).collect();
        let shifts = [(6.0, 0.0), (0.0, 6.0)].map(|(x, y)| Vector2::new(x, y));
        let shifts = shifts.map(|s| [s, -s]).concat();
        let mut gained = 0;
        for _ in 0..50 {
            let seen = places.iter().map(|p| p + Vector2::new(noise(), noise()));
            let map2: Vec<Object> = seen.map(|p| Object::new(p, 1.0, 1.0)).collect();
            let mut problem = Problem::new(&map1, &map2, &NoSimilarity, &params);
            (problem.repeated1, problem.repeated2) = (vec![true; 19], vec![true; 19]);
            (problem.repeated1[18], problem.repeated2[18]) = (false, false);
            let found = refine(&problem, &Isometry2::identity()).unwrap();
            let continuation = Continuation::new(&problem, &shifts).unwrap();
            let odds = continuation.log_odds(&found);
            assert!(odds <= Continuation::MOST, "{odds}");
            // The pairs' best fit when repeated ones weigh less.
            let better = fit_rigid(&weigh_repeated(&problem, &found.pairs));
            assert!(continuation.strain(&found, &better) >= 0.0);
            gained += usize::from(odds > 0.0);
        }
        assert!(gained > 25, "{gained}");
    }
}

use nalgebra::{Isometry2, Point2};

use super::evidence::{Explanation, middle, ties};
use super::problem::Problem;
use crate::rigid::{Tie, fit_rigid};

/// Evidence, nats, of a structure that goes on. By chance a transform lays a lattice of 6 m onto another about once in a thousand
/// times (a twenty-fifth of all places are within the gate, a thirtieth of all turns); half the true ones are thought to do it.
pub(super) const ONE_STRUCTURE: f64 = 6.0;
/// Share of the repeated objects that must continue the other map's structure.
const SHARE: f64 = 0.8;
/// Shifts of the structure that are used, those of most pairs.
const SHIFTS: usize = 16;
/// Widths of the gate, before the structures are fitted to each other.
const LOOSE: f64 = 2.0;

/// Whether map 2's repeated objects, as the explanation lays them, continue map 1's structure: whole shifts of map 1 onto
/// itself carry them onto its objects. Rows of pilings go on beyond what one robot saw of them.
///
/// * `shifts` – of map 1 onto itself, either way, those of most pairs first.
pub(super) fn continues(problem: &Problem, shifts: &[Isometry2<f64>], found: &Explanation) -> bool {
    let shifts = &shifts[..SHIFTS.min(shifts.len())];
    let structure: Vec<Point2<f64>> =
        problem.p1.iter().zip(&problem.repeated1).filter(|(_, r)| **r).map(|(p, _)| *p).collect();
    let others = problem.p2.iter().zip(&problem.repeated2).filter(|(_, r)| **r).map(|(p, _)| *p);
    let others: Vec<Point2<f64>> = others.collect();
    if shifts.is_empty() || structure.is_empty() || others.is_empty() {
        return false;
    }
    let centre = middle(&structure);
    let reach = problem.params.gate * problem.largest_sigma;
    let needed = SHARE * others.len() as f64;
    let mut transform = found.map1_from_map2;
    for widths in [LOOSE, 1.0] {
        let carried = others.iter().filter_map(|p| {
            let (moved, shift) = carry(shifts, &centre, transform * p);
            let nearest = structure
                .iter()
                .map(|q| q - moved)
                .min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
            (nearest.norm() <= widths * reach).then(|| Tie {
                first: shift.inverse() * (moved + nearest),
                second: *p,
                weight: 1.0,
            })
        });
        let carried: Vec<Tie> = carried.collect();
        if (carried.len() as f64) < needed {
            return false;
        }
        // The explanation's few pairs leave its angle too wide for the structure's far end; both fit together are judged.
        let mut all = ties(problem, &found.pairs);
        let weight = all.first().map_or(1.0, |tie| tie.weight);
        all.extend(carried.into_iter().map(|tie| Tie { weight, ..tie }));
        transform = fit_rigid(&all);
    }
    ties(problem, &found.pairs).iter().all(|tie| (tie.first - transform * tie.second).norm() <= reach)
}

/// Shifts a point as near to the centre as whole shifts bring it; also what moved it.
fn carry(
    shifts: &[Isometry2<f64>],
    centre: &Point2<f64>,
    mut point: Point2<f64>,
) -> (Point2<f64>, Isometry2<f64>) {
    let mut moved = Isometry2::identity();
    let mut distance = (point - centre).norm();
    loop {
        let nearer =
            shifts.iter().map(|s| (s, (s * point - centre).norm())).min_by(|a, b| a.1.total_cmp(&b.1));
        match nearer {
            // Shrinking by a thousandth at least, so that this ends.
            Some((shift, next)) if next < 0.999 * distance => {
                point = shift * point;
                moved = shift * moved;
                distance = next;
            }
            _ => return (point, moved),
        }
    }
}

use std::collections::BTreeSet;

use nalgebra::{Isometry2, Point2, Vector2};

use super::ConsensusParams;
use super::alike::Alike;
use super::evidence::{gather, middle, settle};
use super::hypotheses::{Hypotheses, Ray};
use super::modes::same_mode;
use super::problem::Problem;
use crate::Object;
use crate::disjoint_sets::DisjointSets;

/// Objects tried as pivots; each lies in a strong self-match with a probability above its share.
const PIVOTS: usize = 6;
/// Nearest objects that vote for a turn: a structure shows in its own neighbourhood.
const NEIGHBOURS: usize = 40;
/// Turns and shifts of the map onto itself that are looked at.
const SELF_MATCHES: usize = 40;
/// Share of the objects in the common area that must fall together, and of all objects.
const SHARE_INSIDE: f64 = 0.6;
const SHARE_OF_ALL: f64 = 0.4;
/// Fewest coincidences of a self-match: small maps have five, those of four pairs of places, by chance.
const FEWEST: usize = 6;
/// The same of other than half turns: a square of four falls onto itself at every quarter turn, and a fifth object by chance.
const FEWEST_TURNED: usize = 8;

/// What of a map repeats itself.
pub(super) struct Structure {
    /// Objects that the map shows elsewhere again, in the same company.
    pub(super) repeated: Vec<bool>,
    /// Shifts that lay many objects on others, and their inverses, those of most pairs first.
    pub(super) shifts: Vec<Vector2<f64>>,
}

/// Which objects a shift or turn of the map brings onto other objects together with many more. Rows of pilings match
/// their neighbours as well as themselves, so a match of many of them is no evidence for one shift against the next.
///
/// * `rays` – the map's; `alike` – which of its objects may be taken for each other.
pub(super) fn repeated(
    map: &[Object],
    rays: &[Vec<Ray>],
    alike: &Alike,
    params: &ConsensusParams,
) -> Structure {
    let problem = Problem::new(map, map, alike, params);
    let centre = middle(&problem.p1);
    let pivots = &central(&problem.p1)[..PIVOTS.min(map.len())];
    let near: Vec<Vec<Ray>> =
        rays.iter().map(|rays| rays.iter().take(NEIGHBOURS).copied().collect()).collect();
    let mut kinds = DisjointSets::new(map.len());
    let mut shifts: Vec<(usize, Vector2<f64>)> = Vec::new();
    let identity = Isometry2::identity();
    // Many pivots begin the same self-match.
    let mut seen = BTreeSet::new();
    let moving = Hypotheses::new(&problem, &near, &near, |i, a| i != a && pivots.contains(&i));
    for hypothesis in moving.take(SELF_MATCHES) {
        let Some(first) = gather(&problem, &hypothesis.map1_from_map2) else { continue };
        if !seen.insert(first.clone()) {
            continue;
        }
        let Some(found) = settle(&problem, first) else { continue };
        if same_mode(params, &centre, &found.map1_from_map2, &identity) {
            continue;
        }
        let pairs = found.pairs.len() as f64;
        let angle = found.map1_from_map2.rotation.angle().abs();
        let straight = angle.min(std::f64::consts::PI - angle) < params.mode_angle;
        let fewest = if straight { FEWEST } else { FEWEST_TURNED };
        let strong = coincidences(&problem, &found.pairs) >= fewest
            && pairs >= SHARE_OF_ALL * map.len() as f64
            && pairs >= SHARE_INSIDE * found.inside;
        if strong {
            for &(i, a) in &found.pairs {
                kinds.union(i, a);
            }
            let moves = shift(&problem, &found.pairs);
            let known = |(_, known): &(usize, Vector2<f64>)| {
                [*known, -known].iter().any(|known| (known - moves).norm() < params.mode_distance)
            };
            if angle < params.mode_angle && !shifts.iter().any(known) {
                shifts.push((found.pairs.len(), moves));
            }
        }
    }
    shifts.sort_by_key(|(pairs, _)| std::cmp::Reverse(*pairs));
    let shifts = shifts.into_iter().flat_map(|(_, shift)| [shift, -shift]).collect();
    Structure { repeated: members(&kinds, map.len()), shifts }
}

/// The mean shift of pairs. Without the turn, which a fit leaves open by its noise and many shifts in a row would add up.
fn shift(problem: &Problem, pairs: &[(usize, usize)]) -> Vector2<f64> {
    pairs.iter().map(|&(i, a)| problem.p1[i] - problem.p1[a]).sum::<Vector2<f64>>() / pairs.len() as f64
}

/// Which objects are of a kind that is shown often. Two alike that one shift of the structure happens to bring together are no part
/// of it, unless all come in twos.
fn members(kinds: &DisjointSets, count: usize) -> Vec<bool> {
    let roots: Vec<usize> = (0..count).map(|i| kinds.root(i)).collect();
    let mut sizes = vec![0; count];
    roots.iter().for_each(|&root| sizes[root] += 1);
    let fewest = sizes.iter().copied().max().unwrap_or(0).min(3);
    roots.iter().map(|&root| sizes[root] >= fewest.max(2)).collect()
}

/// Indices of points, the one nearest their middle first.
pub(super) fn central(points: &[Point2<f64>]) -> Vec<usize> {
    let centre = middle(points);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&i, &j| {
        let distance = |k: usize| (points[k] - centre).norm_squared();
        distance(i).total_cmp(&distance(j))
    });
    order
}

/// Coordinates that agree beyond what it takes to fix the transform.
///
/// Things that stand closer together than the gate looks fall together in groups and count once. In a half turn each pair
/// comes twice, as its ends change places; it counts once, and as the angle is given the turn has only two freedoms.
fn coincidences(problem: &Problem, pairs: &[(usize, usize)]) -> usize {
    let apart = 2.0 * problem.params.gate * problem.largest_sigma;
    let far = |k: usize, l: usize| (problem.p1[k] - problem.p1[l]).norm() > apart;
    let mut kept: Vec<(usize, usize)> = Vec::new();
    let mut freedoms = 3;
    for &(i, a) in pairs {
        if kept.contains(&(a, i)) {
            freedoms = 2;
        } else if kept.iter().all(|&(j, _)| far(i, j)) {
            kept.push((i, a));
        }
    }
    (2 * kept.len()).saturating_sub(freedoms)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(count: usize, unions: &[(usize, usize)]) -> Vec<bool> {
        let mut kinds = DisjointSets::new(count);
        unions.iter().for_each(|&(i, a)| kinds.union(i, a));
        members(&kinds, count)
    }

    #[test]
    fn two_alike_beside_a_row_are_no_part_of_it() {
        assert_eq!(joined(6, &[(0, 1), (1, 2), (4, 5)]), [true, true, true, false, false, false]);
    }

    #[test]
    fn a_group_that_is_shown_twice_is_repeated() {
        assert_eq!(joined(5, &[(0, 3), (1, 4)]), [true, true, false, true, true]);
        assert_eq!(joined(3, &[(1, 1)]), [false; 3]);
    }
}

use nalgebra::{Isometry2, Point2};

use super::ConsensusParams;
use super::alike::Alike;
use super::evidence::{middle, refine};
use super::hypotheses::{Ray, hypotheses};
use super::modes::same_mode;
use super::problem::Problem;
use crate::Object;

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
    pub(super) shifts: Vec<Isometry2<f64>>,
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
    let mut repeated = vec![false; map.len()];
    let mut shifts: Vec<(usize, Isometry2<f64>)> = Vec::new();
    let identity = Isometry2::identity();
    let moving = hypotheses(&problem, &near, &near, |i, a| i != a && pivots.contains(&i)).into_iter();
    for hypothesis in moving.take(SELF_MATCHES) {
        let Some(found) = refine(&problem, &hypothesis.map1_from_map2) else { continue };
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
                repeated[i] = true;
                repeated[a] = true;
            }
            let moves = found.map1_from_map2;
            let known = |(_, known): &(usize, Isometry2<f64>)| {
                [*known, known.inverse()].iter().any(|known| same_mode(params, &centre, known, &moves))
            };
            if angle < params.mode_angle && !shifts.iter().any(known) {
                shifts.push((found.pairs.len(), moves));
            }
        }
    }
    shifts.sort_by_key(|(pairs, _)| std::cmp::Reverse(*pairs));
    let shifts = shifts.into_iter().flat_map(|(_, shift)| [shift, shift.inverse()]).collect();
    Structure { repeated, shifts }
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

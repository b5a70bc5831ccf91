use nalgebra::Isometry2;

use super::ConsensusParams;
use super::evidence::{middle, refine};
use super::hypotheses::hypotheses;
use super::modes::same_mode;
use super::problem::Problem;
use crate::{NoSimilarity, Object};

/// Weight of an object that the map shows elsewhere again, in the same company.
const REPEATED: f64 = 0.03;
/// Objects tried as pivots; each lies in a strong self-match with a probability above its share.
const PIVOTS: usize = 6;
/// Turns and shifts of the map onto itself that are looked at.
const SELF_MATCHES: usize = 40;
/// Share of the objects in the common area that must fall together, and of all objects.
const SHARE_INSIDE: f64 = 0.6;
const SHARE_OF_ALL: f64 = 0.4;
/// Fewest pairs of a self-match, which small maps have by chance up to four of.
const FEWEST: usize = 5;

/// How much the place of each object tells: 1, and next to nothing for objects that a shift or turn of the map
/// brings onto other objects together with many more. Rows of pilings match their neighbours as well as themselves,
/// so a match of many of them is no evidence for one shift against the next.
pub(super) fn rarity(map: &[Object], params: &ConsensusParams) -> Vec<f64> {
    let problem = Problem::new(map, map, &NoSimilarity, params);
    let centre = middle(&problem.p1);
    let mut central: Vec<usize> = (0..map.len()).collect();
    central.sort_by(|&i, &j| {
        let distance = |k: usize| (problem.p1[k] - centre).norm_squared();
        distance(i).total_cmp(&distance(j))
    });
    let pivots = central.into_iter().take(PIVOTS);
    let mut rarity = vec![1.0; map.len()];
    let identity = Isometry2::identity();
    let moving = hypotheses(&problem, pivots).into_iter().filter(|h| h.pivot.0 != h.pivot.1);
    for hypothesis in moving.take(SELF_MATCHES) {
        let Some(found) = refine(&problem, &hypothesis.map1_from_map2) else { continue };
        if same_mode(params, &centre, &found.map1_from_map2, &identity) {
            continue;
        }
        let pairs = found.pairs.len() as f64;
        let strong = found.pairs.len() >= FEWEST
            && pairs >= SHARE_OF_ALL * map.len() as f64
            && pairs >= SHARE_INSIDE * found.inside;
        if strong {
            for &(i, a) in &found.pairs {
                rarity[i] = REPEATED;
                rarity[a] = REPEATED;
            }
        }
    }
    rarity
}

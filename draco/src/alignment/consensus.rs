use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry2, Point2};

use super::AlignmentParams;
use crate::keyframe::RobotId;

/// One robot's belief about where two maps lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opinion {
    /// Robot that holds it.
    pub holder: RobotId,
    /// One robot of the pair.
    pub a: RobotId,
    /// The other one.
    pub b: RobotId,
    /// Map of `b` in the map of `a`.
    pub a_from_b: Isometry2<f64>,
    /// A point in the middle of what the two maps share, in the map of `b`, metres.
    pub middle: Point2<f64>,
}

impl Opinion {
    /// The two robots, the smaller number first.
    fn pair(&self) -> (RobotId, RobotId) {
        (self.a.min(self.b), self.a.max(self.b))
    }
}

/// Which opinions to act on: those of the placement of all maps that most opinions share.
///
/// Two robots that compare the same two maps at different times can come to different answers, and three alignments
/// have to close a cycle. Where two placements have equally many supporters, an opinion needs both of them: without a
/// third view nobody can tell who is wrong.
///
/// Returns one flag an opinion. Cost: `O(n²)` for each of `n` opinions as a seed.
pub fn consensus(opinions: &[Opinion], params: &AlignmentParams) -> Vec<bool> {
    let supports: Vec<Vec<bool>> =
        (0..opinions.len()).map(|seed| supporters(opinions, seed, params)).collect();
    // both robots of a pair compare the same two maps: their agreement is one vote
    let count = |flags: &Vec<bool>| {
        let pairs = opinions.iter().zip(flags).filter(|(_, supports)| **supports).map(|(o, _)| o.pair());
        pairs.collect::<BTreeSet<_>>().len()
    };
    let mut kept = vec![false; opinions.len()];
    for part in parts(opinions) {
        let most = part.iter().map(|&seed| count(&supports[seed])).max().unwrap_or(0);
        let best: Vec<_> = part.iter().filter(|&&seed| count(&supports[seed]) == most).collect();
        for &opinion in &part {
            kept[opinion] = best.iter().all(|&&seed| supports[seed][opinion]);
        }
    }
    kept
}

/// Opinions that agree with the placement grown from one of them.
fn supporters(opinions: &[Opinion], seed: usize, params: &AlignmentParams) -> Vec<bool> {
    let mut placed = BTreeMap::from([(opinions[seed].a, Isometry2::identity())]);
    placed.insert(opinions[seed].b, opinions[seed].a_from_b);
    while let Some((robot, place)) = next_robot(opinions, &placed, params) {
        placed.insert(robot, place);
    }
    opinions.iter().map(|o| fits(o, &placed, params)).collect()
}

/// The robot next to those placed, and its place, that most opinions support; ties go to the earlier opinion.
fn next_robot(
    opinions: &[Opinion],
    placed: &BTreeMap<RobotId, Isometry2<f64>>,
    params: &AlignmentParams,
) -> Option<(RobotId, Isometry2<f64>)> {
    let mut best: Option<(usize, RobotId, Isometry2<f64>)> = None;
    for o in opinions {
        let (robot, place) = match (placed.get(&o.a), placed.get(&o.b)) {
            (Some(a), None) => (o.b, a * o.a_from_b),
            (None, Some(b)) => (o.a, b * o.a_from_b.inverse()),
            _ => continue,
        };
        let mut with = placed.clone();
        with.insert(robot, place);
        let votes =
            opinions.iter().filter(|o| (o.a == robot || o.b == robot) && fits(o, &with, params)).count();
        if best.is_none_or(|(most, _, _)| votes > most) {
            best = Some((votes, robot, place));
        }
    }
    best.map(|(_, robot, place)| (robot, place))
}

fn fits(opinion: &Opinion, placed: &BTreeMap<RobotId, Isometry2<f64>>, params: &AlignmentParams) -> bool {
    let (Some(a), Some(b)) = (placed.get(&opinion.a), placed.get(&opinion.b)) else { return false };
    params.same(&a.inv_mul(b), &opinion.a_from_b, &opinion.middle)
}

/// Opinions by connected parts of the team.
fn parts(opinions: &[Opinion]) -> Vec<Vec<usize>> {
    let mut left: BTreeSet<usize> = (0..opinions.len()).collect();
    let mut parts = Vec::new();
    while let Some(first) = left.pop_first() {
        let mut part = vec![first];
        let mut robots = BTreeSet::from([opinions[first].a, opinions[first].b]);
        while let Some(&next) =
            left.iter().find(|&&o| robots.contains(&opinions[o].a) || robots.contains(&opinions[o].b))
        {
            left.remove(&next);
            robots.extend([opinions[next].a, opinions[next].b]);
            part.push(next);
        }
        part.sort_unstable();
        parts.push(part);
    }
    parts
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    fn opinion(holder: RobotId, a: RobotId, b: RobotId, x: f64) -> Opinion {
        let a_from_b = Isometry2::new(Vector2::new(x, 0.0), 0.0);
        Opinion { holder, a, b, a_from_b, middle: Point2::origin() }
    }

    fn kept(opinions: &[Opinion]) -> Vec<bool> {
        consensus(opinions, &AlignmentParams::default())
    }

    #[test]
    fn a_cycle_outvotes_the_one_that_breaks_it() {
        // maps 1, 2, 3 lie at 0, 10 and 25 m; robot 1 believes that 2 lies at 60 m
        let wrong = opinion(1, 1, 2, 60.0);
        let right = [
            opinion(1, 1, 3, 25.0),
            opinion(2, 2, 3, 15.0),
            opinion(3, 3, 1, -24.0),
            opinion(2, 2, 1, -10.0),
        ];
        assert_eq!(kept(&[&[wrong], &right[..]].concat()), [false, true, true, true, true]);
        // with no second voice on 1-2 either that or 2-3 may be wrong, however often one of them is told
        let told_twice = [&[wrong], &right[..3], &[opinion(3, 3, 2, -15.0)]].concat();
        assert_eq!(kept(&told_twice), [false, true, false, true, false]);
    }

    #[test]
    fn two_against_each_other_are_both_left_out() {
        assert_eq!(kept(&[opinion(1, 1, 2, 60.0), opinion(2, 2, 1, -10.0)]), [false, false]);
        assert_eq!(kept(&[opinion(1, 1, 2, 10.0), opinion(2, 2, 1, -11.0)]), [true, true]);
    }

    #[test]
    fn what_the_doubt_does_not_touch_stays() {
        let all = [opinion(1, 1, 2, 60.0), opinion(2, 2, 1, -10.0), opinion(1, 1, 3, 25.0)];
        assert_eq!(kept(&all), [false, false, true]);
    }

    #[test]
    fn teams_that_have_not_met_are_judged_apart() {
        assert_eq!(kept(&[opinion(1, 1, 2, 5.0), opinion(4, 4, 7, 90.0)]), [true, true]);
        assert!(kept(&[]).is_empty());
    }
}

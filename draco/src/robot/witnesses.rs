//! Which pairs of other robots a robot takes into account, so that a step costs it by the robots it meets and not by the
//! pairs among them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use crate::keyframe::RobotId;

/// Two robots, the lower number first.
pub(super) type RobotPair = (RobotId, RobotId);

/// Of the pairs of robots with closures those that `own` takes into account.
///
/// All of its own; those without which a robot would not be joined to it; and of the others, most closures first, those
/// whose robots are both in fewer than `each` pairs of others so far. A pair of others closes a cycle with the own closures
/// of its two robots, and a few cycles tell what is wrong with these. Of the `(n - 1) (n - 2) / 2` pairs of others in a team
/// of `n` at most `each (n - 1) / 2` are taken in, and a tree where it takes others to be joined.
/// What is left out is judged by the robots it joins.
///
/// * `closures` – how many closures a pair has.
///
/// Cost: `O(n)` a pair for `n` robots.
pub(super) fn considered(
    own: RobotId,
    closures: &BTreeMap<RobotPair, usize>,
    each: usize,
) -> BTreeSet<RobotPair> {
    let (mut taken, others): (BTreeSet<RobotPair>, BTreeSet<RobotPair>) =
        closures.keys().partition(|pair| pair.0 == own || pair.1 == own);
    let mut others = Vec::from_iter(others);
    others.sort_by_key(|pair| (Reverse(closures[pair]), *pair));
    let mut teams = Teams::default();
    for pair in &taken {
        teams.join(*pair);
    }
    let (joining, rest): (Vec<_>, Vec<_>) = others.into_iter().partition(|pair| teams.join(*pair));
    let mut pairs_of: BTreeMap<RobotId, usize> = BTreeMap::new();
    let needed = joining.len();
    for (index, pair) in joining.into_iter().chain(rest).enumerate() {
        let count = |robot| pairs_of.get(&robot).copied().unwrap_or(0);
        if index < needed || count(pair.0).max(count(pair.1)) < each {
            taken.insert(pair);
            *pairs_of.entry(pair.0).or_default() += 1;
            *pairs_of.entry(pair.1).or_default() += 1;
        }
    }
    taken
}

/// Which robots are joined so far.
#[derive(Default)]
struct Teams {
    team_of: BTreeMap<RobotId, RobotId>,
}

impl Teams {
    /// Joins two robots. Returns whether they were apart.
    fn join(&mut self, (a, b): RobotPair) -> bool {
        let team = |team_of: &mut BTreeMap<_, _>, robot| *team_of.entry(robot).or_insert(robot);
        let (kept, gone) = (team(&mut self.team_of, a), team(&mut self.team_of, b));
        self.team_of.values_mut().filter(|team| **team == gone).for_each(|team| *team = kept);
        kept != gone
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all_pairs(robots: RobotId) -> impl Iterator<Item = RobotPair> {
        (1..=robots).flat_map(move |a| (a + 1..=robots).map(move |b| (a, b)))
    }

    #[test]
    fn a_small_team_leaves_out_nothing() {
        for robots in 2..=5 {
            let closures: BTreeMap<_, _> =
                all_pairs(robots).map(|pair| (pair, 3 + pair.0 as usize)).collect();
            assert_eq!(considered(2, &closures, 3).len(), closures.len());
        }
    }

    #[test]
    fn the_pairs_with_most_closures_are_taken_and_a_chain_stays_whole() {
        // robot 1 has met 2 to 5; 6 and 7 are known through others alone
        let mut closures: BTreeMap<_, _> =
            all_pairs(5).map(|pair| (pair, (10 * pair.0 + pair.1) as usize)).collect();
        closures.extend([((5, 6), 1), ((6, 7), 1)]);
        let others: Vec<_> = considered(1, &closures, 2).into_iter().filter(|pair| pair.0 != 1).collect();
        // 5 is in one pair for the sake of 6, and so is in one more, that with 4
        assert_eq!(others, [(2, 3), (3, 4), (4, 5), (5, 6), (6, 7)]);
    }

    proptest! {
        #[test]
        fn few_pairs_are_taken_and_nobody_is_lost(
            robots in 2..20u32, counts in prop::collection::vec(0..40usize, 190), own in 1..20u32, each in 0..4usize,
        ) {
            let closures: BTreeMap<RobotPair, usize> =
                all_pairs(robots).zip(counts).filter(|(_, count)| *count > 25).collect();
            let taken = considered(own, &closures, each);
            let (mut all, mut left) = (Teams::default(), Teams::default());
            closures.keys().for_each(|pair| {
                all.join(*pair);
            });
            taken.iter().for_each(|pair| {
                left.join(*pair);
            });
            for robot in 1..=robots {
                for other in 1..=robots {
                    let joined = |teams: &Teams| {
                        let team = |robot| teams.team_of.get(robot);
                        team(&robot).is_some_and(|of_robot| team(&other) == Some(of_robot))
                    };
                    prop_assert_eq!(joined(&all), joined(&left));
                }
            }
            let others = taken.iter().filter(|pair| pair.0 != own && pair.1 != own).count();
            prop_assert!(others <= (1 + each) * robots as usize);
            let mut of_own = closures.keys().filter(|pair| pair.0 == own || pair.1 == own);
            prop_assert!(of_own.all(|pair| taken.contains(pair)));
        }
    }
}

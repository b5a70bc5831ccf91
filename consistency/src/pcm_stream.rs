use std::collections::BTreeMap;

use crate::clique::Incremental;
use crate::pair_test::{End, gate, scaled};
use crate::pcm::judge;
use crate::{Closure, Error, PairTest, PcmParams, Pose, Selection, Trajectories, Trajectory};

/// [`pcm`](crate::pcm()) one closure at a time: after every insert the accepted set is what a batch over all closures
/// so far may give (of several largest sets, the one held is kept).
///
/// An insert costs one pair test a closure of the same robot pair and an incremental clique step.
///
/// ```
/// use draco_consistency::simulate::{Harbor, harbor};
/// use draco_consistency::{Pcm, PcmParams};
/// use nalgebra::Isometry2;
/// use rand::SeedableRng;
///
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let team = harbor::<3, Isometry2<f64>>(&Harbor::default(), &mut rng)?;
/// let mut stream = Pcm::new(team.trajectories, PcmParams::default())?;
/// for closure in &team.closures {
///     let change = stream.insert(closure)?;
///     assert!(change.accepted.iter().all(|c| !change.withdrawn.contains(c)));
/// }
/// assert!(!stream.selection().accepted.is_empty());
/// # Ok::<(), draco_consistency::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Pcm<G, const N: usize> {
    trajectories: Trajectories<G, N>,
    params: PcmParams,
    limit: f64,
    closures: Vec<Closure<G, N>>,
    sets: BTreeMap<(u32, u32), PairSet<G, N>>,
}

/// How an insert changed the accepted set; indices count the closures in the order of their inserts.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Change {
    /// Accepted now and not before.
    pub accepted: Vec<usize>,
    /// Accepted before and not now.
    pub withdrawn: Vec<usize>,
}

/// The closures of one robot pair.
#[derive(Debug, Clone)]
struct PairSet<G, const N: usize> {
    members: Vec<usize>,
    ends: Vec<End<G, N>>,
    cliques: Incremental,
}

impl<G: Pose<N>, const N: usize> Pcm<G, N> {
    /// Without closures.
    ///
    /// # Errors
    /// A probability outside (0, 1).
    pub fn new(trajectories: Trajectories<G, N>, params: PcmParams) -> Result<Self, Error> {
        let limit = scaled(gate::<N>(params.probability)?, params.scale)?;
        Ok(Self { trajectories, params, limit, closures: Vec::new(), sets: BTreeMap::new() })
    }

    /// Adds a closure, numbered next.
    ///
    /// # Errors
    /// An unknown pose, a bad pose or covariance; the closure is then not added.
    pub fn insert(&mut self, closure: &Closure<G, N>) -> Result<Change, Error> {
        let index = self.closures.len();
        closure.check(index)?;
        let end = End::new(&self.trajectories, index, closure)?;
        let robots = closure.robots();
        let budget = self.params.budget;
        let set = self.sets.entry(robots).or_insert_with(|| PairSet {
            members: Vec::new(),
            ends: Vec::new(),
            cliques: Incremental::new(budget),
        });
        let before = set.cliques.best().vertices.clone();
        let mut ends = std::mem::take(&mut set.ends);
        ends.push(end);
        let test = PairTest::of_ends(&self.trajectories, robots, ends, self.limit);
        let own = test.len() - 1;
        let neighbors: Vec<usize> = (0..own).filter(|&other| test.agree(other, own)).collect();
        set.ends = test.into_ends();
        set.members.push(index);
        set.cliques.insert(&neighbors)?;
        self.closures.push(*closure);
        Ok(set.change_from(&before, self.params.minimum))
    }

    /// Replaces a robot's trajectory, for example after an optimisation, and tests its closures anew.
    ///
    /// # Errors
    /// A closure so far names a pose that the new trajectory does not have.
    pub fn set_trajectory(&mut self, robot: u32, trajectory: Trajectory<G, N>) -> Result<(), Error> {
        let mut fresh = Self::new(self.trajectories.clone(), self.params.clone())?;
        fresh.trajectories.insert(robot, trajectory);
        for closure in &self.closures {
            fresh.insert(closure)?;
        }
        *self = fresh;
        Ok(())
    }

    /// The accepted set now, and for every other closure why not.
    pub fn selection(&self) -> Selection {
        let mut selection = Selection::default();
        for (&robots, set) in &self.sets {
            let test = PairTest::of_ends(&self.trajectories, robots, set.ends.clone(), self.limit);
            let mut chosen = set.cliques.best().vertices.clone();
            chosen.sort_unstable();
            judge(&test, &set.members, &chosen, self.params.minimum, &mut selection);
        }
        selection.sort();
        selection
    }
}

/// What of `all` is not among `others`; both ascend.
fn without(all: &[usize], others: &[usize]) -> Vec<usize> {
    let mut others = others;
    let is_missing = |c: &&usize| {
        while let [first, rest @ ..] = others
            && first < c
        {
            others = rest;
        }
        others.first() != Some(*c)
    };
    all.iter().filter(is_missing).copied().collect()
}

impl<G, const N: usize> PairSet<G, N> {
    /// What is accepted, and no longer, since the largest set was `before`.
    fn change_from(&self, before: &[usize], minimum: usize) -> Change {
        let after = &self.cliques.best().vertices;
        if after == before {
            return Change::default();
        }
        let believed = |set: &[usize]| if set.len() < minimum { Vec::new() } else { self.names(set) };
        let (before, after) = (believed(before), believed(after));
        Change { accepted: without(&after, &before), withdrawn: without(&before, &after) }
    }

    /// Closures of vertices, both ascending.
    fn names(&self, vertices: &[usize]) -> Vec<usize> {
        vertices.iter().map(|&v| self.members[v]).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use nalgebra::Isometry2;
    use rand::SeedableRng;
    use rand::seq::SliceRandom;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::simulate::{Planted, planted};

    #[test]
    fn what_is_missing_of_ascending_numbers() {
        assert_eq!(without(&[1, 3, 4, 7, 9], &[0, 3, 5, 6, 7, 8]), [1, 4, 9]);
        assert_eq!(without(&[2, 5], &[]), [2, 5]);
        assert!(without(&[], &[1]).is_empty() && without(&[2, 5], &[2, 5]).is_empty());
    }

    #[test]
    fn changes_add_up_to_what_is_accepted() {
        let rng = &mut ChaCha8Rng::seed_from_u64(2);
        let mut team = planted::<3, Isometry2<f64>>(&Planted::default(), rng).unwrap();
        team.closures.shuffle(rng);
        let mut stream = Pcm::new(team.trajectories, PcmParams::default()).unwrap();
        let mut told = BTreeSet::new();
        for closure in &team.closures {
            let change = stream.insert(closure).unwrap();
            assert!(change.withdrawn.iter().all(|c| told.remove(c)));
            assert!(change.accepted.iter().all(|&c| told.insert(c)));
            assert_eq!(stream.selection().accepted, told.iter().copied().collect::<Vec<_>>());
        }
        assert!(!told.is_empty());
    }
}

use std::collections::BTreeSet;

use super::block::Blocks;
use super::params::GcmParams;
use super::posterior::{Gcm, gcm_with_history};
use crate::{Closure, Error, MapTransform, Pose, Trajectories, Trajectory};

/// [`gcm`](crate::gcm()) that keeps what it has seen: nothing is discarded or frozen, an accepted closure is withdrawn
/// when later groups contradict it, and comes back when they are contradicted in turn.
///
/// An accepted group stays accepted down to `params.withdraw`. An insert solves the blocks it touches (robots that fall
/// apart without the reference are blocks of their own) and gives what a batch over all closures so far would give.
#[derive(Debug, Clone)]
pub struct GcmOnline<G, const N: usize> {
    trajectories: Trajectories<G, N>,
    priors: Vec<MapTransform<G, N>>,
    params: GcmParams,
    closures: Vec<Closure<G, N>>,
    blocks: Blocks,
    accepted: BTreeSet<usize>,
    ever: BTreeSet<usize>,
}

/// A verdict that changed; the number counts the closures in the order of their inserts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Event {
    /// Accepted for the first time.
    Accepted(usize),
    /// Accepted before, not any more.
    Retracted(usize),
    /// Accepted again after it was retracted.
    Revived(usize),
}

impl<G: Pose<N>, const N: usize> GcmOnline<G, N> {
    /// Without closures.
    ///
    /// # Errors
    /// Parameters outside their range, bad priors.
    pub fn new(
        trajectories: Trajectories<G, N>,
        priors: Vec<MapTransform<G, N>>,
        params: GcmParams,
    ) -> Result<Self, Error> {
        params.check()?;
        priors.iter().enumerate().try_for_each(|(index, prior)| prior.check(index))?;
        let (accepted, ever) = (BTreeSet::new(), BTreeSet::new());
        Ok(Self {
            trajectories,
            priors,
            params,
            closures: Vec::new(),
            blocks: Blocks::default(),
            accepted,
            ever,
        })
    }

    /// Adds closures, numbered on, and returns the posterior and what changed.
    ///
    /// # Errors
    /// Unknown poses, bad poses or covariances; nothing is then added.
    pub fn insert(&mut self, closures: &[Closure<G, N>]) -> Result<(Gcm<N>, Vec<Event>), Error> {
        let known = self.closures.len();
        self.closures.extend_from_slice(closures);
        let result = self.update();
        if result.is_err() {
            self.closures.truncate(known);
        }
        result
    }

    /// Replaces a robot's trajectory, for example after an optimisation; the next insert or update uses it.
    pub fn set_trajectory(&mut self, robot: u32, trajectory: Trajectory<G, N>) {
        self.trajectories.insert(robot, trajectory);
        self.blocks = Blocks::default();
    }

    /// Runs the posterior over all closures so far.
    ///
    /// # Errors
    /// A closure names a pose that a replaced trajectory does not have.
    pub fn update(&mut self) -> Result<(Gcm<N>, Vec<Event>), Error> {
        let result = gcm_with_history(
            &self.trajectories,
            &self.closures,
            &self.priors,
            &self.params,
            &self.accepted,
            &mut self.blocks,
        )?;
        let now: BTreeSet<usize> = result.selection.accepted.iter().copied().collect();
        let mut events: Vec<Event> = self.accepted.difference(&now).map(|&c| Event::Retracted(c)).collect();
        events.extend(
            now.difference(&self.accepted)
                .map(|&c| if self.ever.contains(&c) { Event::Revived(c) } else { Event::Accepted(c) }),
        );
        self.ever.extend(&now);
        self.accepted = now;
        Ok((result, events))
    }
}

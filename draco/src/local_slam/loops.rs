use draco_consistency::{Closure2, PoseKey, Trajectories2, Trajectory2, pcm};
use draco_lie::LieGroup;
use draco_pgo::Marginals;
use draco_registration::correlative::{Start, Target};
use nalgebra::{Isometry2, Matrix3};
use serde::{Deserialize, Serialize};

use super::{LocalSlam, key};
use crate::Error;

/// A place seen again within the robot's own map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct OwnClosure {
    /// The later keyframe, which is measured.
    pub(super) source: usize,
    /// The earlier keyframe, which the measurement is expressed in.
    pub(super) target: usize,
    pub(super) measured: Isometry2<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) accepted: bool,
}

/// The keyframes `k - half ..= k + half`.
#[derive(Debug, Clone, Copy)]
struct Submap {
    k: usize,
    half: usize,
}

impl OwnClosure {
    /// The inverse of the covariance.
    pub(super) fn information(&self) -> Result<Matrix3<f64>, Error> {
        let (from, to) = (self.target as u32, self.source as u32);
        let information = self.covariance.cholesky().ok_or(Error::LocalCovariance { from, to })?.inverse();
        Ok((information + information.transpose()) * 0.5)
    }
}

impl LocalSlam {
    /// Looks for loops of the newest keyframe that has all its neighbours. Returns how many were found.
    pub(super) fn find_loops(&mut self, newest: usize) -> Result<usize, Error> {
        let params = &self.params.loops;
        let Some(source) = newest.checked_sub(params.source_half) else { return Ok(0) };
        let places = self.loop_targets(source).into_iter().map(|k| Submap { k, half: params.target_half });
        let targets: Vec<_> = self.submaps_before(source).chain(places).collect();
        if targets.is_empty() {
            return Ok(0);
        }
        let marginals = self.marginals()?;
        let mut found = Vec::new();
        for target in targets {
            found.extend(self.register_loop(source, &target, &marginals)?);
        }
        let count = found.len();
        self.closures.extend(found);
        Ok(count)
    }

    /// The submaps next before that of `source`, as large as it, that share no scan with it nor with each other.
    ///
    /// A step is matched with a whole window but tells only where it lies from the keyframe before; what the window has
    /// bent in itself stays. These hold submap to submap.
    fn submaps_before(&self, source: usize) -> impl Iterator<Item = Submap> + use<> {
        let half = self.params.loops.source_half;
        (1..=self.params.loops.submaps_before)
            .map_while(move |count| source.checked_sub(count * (2 * half + 1)))
            .map(move |k| Submap { k, half })
    }

    /// The nearest earlier keyframes, not next to each other.
    fn loop_targets(&self, source: usize) -> Vec<usize> {
        let params = &self.params.loops;
        let distance =
            |k: usize| (self.poses[k].translation.vector - self.poses[source].translation.vector).norm();
        // scans that both submaps hold would tell that nothing moved
        let apart = params.min_separation.max(params.source_half + params.target_half + 1);
        let mut near: Vec<usize> =
            (0..(source + 1).saturating_sub(apart)).filter(|&k| distance(k) < params.max_distance).collect();
        near.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        let mut chosen: Vec<usize> = Vec::new();
        for k in near {
            if chosen.len() < params.per_keyframe
                && chosen.iter().all(|&c| c.abs_diff(k) > params.target_half)
            {
                chosen.push(k);
            }
        }
        chosen
    }

    /// Registers the surroundings of `source` with `target`.
    fn register_loop(
        &self,
        source: usize,
        target: &Submap,
        marginals: &Marginals<Isometry2<f64>, 3>,
    ) -> Result<Option<OwnClosure>, Error> {
        let params = &self.params.loops;
        let around = |k: usize, half: usize| self.submap(k.saturating_sub(half), k + half, k);
        let points = around(source, params.source_half);
        let map = around(target.k, target.half);
        let target = target.k;
        if points.len() < self.params.min_points || map.len() < self.params.min_points {
            return Ok(None);
        }
        let covariance = marginals.relative(key(target), key(source))?;
        let spread = covariance.fixed_view::<2, 2>(0, 0).symmetric_eigenvalues().max().max(0.0).sqrt();
        let mut radius = (params.sigmas * spread).clamp(params.radius.0, params.radius.1);
        let mut angle = (params.sigmas * covariance[(2, 2)].max(0.0).sqrt()).clamp(0.03, params.max_angle);
        let start =
            Start { target_from_source: self.poses[target].between(&self.poses[source]), covariance: None };
        let prepared = Target::new(&map, &params.matching)?;
        let mut found = prepared.locate_within(&points, &start, radius, angle)?;
        // the best place at the border of the window means that the map is off by more than its covariance tells
        while found.at_border && radius < params.radius.1 {
            radius = (2.0 * radius).min(params.radius.1);
            angle = (2.0 * angle).min(params.max_angle);
            found = prepared.locate_within(&points, &start, radius, angle)?;
        }
        if found.at_border || found.score < params.min_score {
            return Ok(None);
        }
        let around = Start { target_from_source: found.target_from_source, covariance: None };
        let finer = Target::new(&map, &params.refinement)?.locate(&points, &around)?;
        Ok(Some(OwnClosure {
            source,
            target,
            measured: finer.target_from_source,
            covariance: found.covariance,
            accepted: false,
        }))
    }

    /// Lets PCM choose among all closures found so far.
    pub(super) fn judge_loops(&mut self) -> Result<(), Error> {
        let steps: Vec<_> =
            self.factors()?.into_iter().take(self.steps.len()).map(|f| f.covariance).collect();
        let trajectory = Trajectory2::from_steps(self.poses.clone(), &steps)?;
        let mut trajectories = Trajectories2::new();
        trajectories.insert(0, trajectory);
        let closures: Vec<_> = self
            .closures
            .iter()
            .map(|closure| Closure2 {
                source: PoseKey::new(0, closure.source),
                target: PoseKey::new(0, closure.target),
                target_from_source: closure.measured,
                covariance: closure.covariance,
            })
            .collect();
        let selection = pcm(&trajectories, &closures, &self.params.pcm)?;
        for closure in &mut self.closures {
            closure.accepted = false;
        }
        for index in selection.accepted {
            self.closures[index].accepted = true;
        }
        Ok(())
    }
}

use std::collections::{BTreeMap, BTreeSet};

use super::clusters::{Cluster, clusters};
use super::frames::implied;
use super::grouping::{Station, stations};
use super::params::GcmParams;
use super::votes::Evidence;
use crate::{Closure, Error, MapTransform, Pose, Trajectories};

/// The checked input in canonical form, with its clusters.
#[derive(Debug, Clone)]
pub(crate) struct Problem<G, const N: usize> {
    pub(crate) teams: Teams,
    /// Canonical direction.
    closures: Vec<Closure<G, N>>,
    priors: Vec<MapTransform<G, N>>,
    transforms: Vec<G>,
    pub(crate) stations: Vec<Station>,
    pub(crate) clusters: Vec<Cluster>,
    pub(crate) noise_scale: f64,
}

impl<const N: usize, G: Pose<N>> Problem<G, N> {
    /// # Errors
    /// Unknown poses, bad poses, covariances or priors.
    pub(crate) fn new(
        trajectories: &Trajectories<G, N>,
        closures: &[Closure<G, N>],
        priors: &[MapTransform<G, N>],
        params: &GcmParams,
    ) -> Result<Self, Error> {
        for (index, closure) in closures.iter().enumerate() {
            closure.check(index)?;
            trajectories.of(index, closure.source)?;
            trajectories.of(index, closure.target)?;
        }
        for (index, prior) in priors.iter().enumerate() {
            prior.check(index)?;
        }
        let teams = Teams::new(closures, priors, params.reference);
        let canonical: Vec<_> = closures.iter().map(|c| c.with_source_robot(teams.source_of(c))).collect();
        // in one direction too, so that telling a prior the other way round changes no bit
        let priors = priors
            .iter()
            .map(|p| {
                let (first, second) = (p.source.min(p.target), p.source.max(p.target));
                let target = if teams.reference_of.get(&second) == Some(&second) { second } else { first };
                if p.target == target { *p } else { p.reversed() }
            })
            .collect();
        let transforms: Vec<G> = canonical.iter().map(|c| implied(trajectories, c)).collect();
        let stations = stations(trajectories, &canonical, params.unit);
        let (clusters, noise_scale) = clusters(trajectories, &canonical, &stations, params)?;
        Ok(Self { teams, closures: canonical, priors, transforms, stations, clusters, noise_scale })
    }

    pub(crate) fn evidence<'a>(
        &'a self,
        trajectories: &'a Trajectories<G, N>,
        params: &'a GcmParams,
    ) -> Evidence<'a, G, N> {
        Evidence {
            trajectories,
            closures: &self.closures,
            transforms: &self.transforms,
            stations: &self.stations,
            priors: &self.priors,
            clusters: &self.clusters,
            noise_scale: self.noise_scale,
            params,
        }
    }
}

/// The connected teams of robots, each with its reference.
#[derive(Debug, Clone)]
pub(crate) struct Teams {
    pub(crate) robots_by_reference: BTreeMap<u32, BTreeSet<u32>>,
    reference_of: BTreeMap<u32, u32>,
}

impl Teams {
    fn new<const N: usize, G: Pose<N>>(
        closures: &[Closure<G, N>],
        priors: &[MapTransform<G, N>],
        preferred: Option<u32>,
    ) -> Self {
        let pairs: BTreeSet<(u32, u32)> = closures
            .iter()
            .map(Closure::robots)
            .chain(priors.iter().map(|p| (p.source.min(p.target), p.source.max(p.target))))
            .collect();
        let all: BTreeSet<u32> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
        let mut robots_by_reference = BTreeMap::new();
        let mut reference_of = BTreeMap::new();
        for robots in components(&all, &pairs, None) {
            let smallest = robots.first().copied();
            if let Some(reference) = preferred.filter(|p| robots.contains(p)).or(smallest) {
                reference_of.extend(robots.iter().map(|&robot| (robot, reference)));
                robots_by_reference.insert(reference, robots);
            }
        }
        Self { robots_by_reference, reference_of }
    }

    /// The reference of the team that `robot` belongs to.
    pub(crate) fn reference_of(&self, robot: u32) -> Option<u32> {
        self.reference_of.get(&robot).copied()
    }

    /// The robot that holds the source in the canonical direction: the reference, else the smaller id.
    fn source_of<G: Pose<N>, const N: usize>(&self, closure: &Closure<G, N>) -> u32 {
        let (first, second) = closure.robots();
        if self.reference_of.get(&second) == Some(&second) { second } else { first }
    }
}

/// Connected components of `robots` under `pairs`, without the robot `removed`; by smallest member.
pub(crate) fn components(
    robots: &BTreeSet<u32>,
    pairs: &BTreeSet<(u32, u32)>,
    removed: Option<u32>,
) -> Vec<BTreeSet<u32>> {
    let mut label: BTreeMap<u32, u32> =
        robots.iter().filter(|r| Some(**r) != removed).map(|&r| (r, r)).collect();
    for (a, b) in pairs {
        if let (Some(&la), Some(&lb)) = (label.get(a), label.get(b)) {
            let (keep, drop) = (la.min(lb), la.max(lb));
            label.values_mut().filter(|l| **l == drop).for_each(|l| *l = keep);
        }
    }
    let mut found: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for (robot, l) in label {
        found.entry(l).or_default().insert(robot);
    }
    found.into_values().collect()
}

//! Which closures to believe: the tests of `draco-consistency` by name.

use std::fmt;
use std::str::FromStr;

use draco_consistency::{
    Closure2, GcmParams, GroupParams, MapTransform2, PcmParams, PooledParams, Selection, Trajectories2, gcm,
    gcm_group, gcm_pooled, pcm,
};

use crate::error::Error;
use crate::keyframe::RobotId;

/// A consistency test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Every closure is believed.
    None,
    /// Pairwise consistency maximisation, robot pair by robot pair.
    Pcm,
    /// The rule of the published system's code: one clique over the closures of all neighbours.
    GcmPooled,
    /// The published group cost.
    GcmGroup,
    /// The calibrated posterior over groups.
    #[default]
    Gcm,
}

impl Method {
    /// All methods with their names on the command line.
    pub const ALL: [(Method, &'static str); 5] = [
        (Method::None, "none"),
        (Method::Pcm, "pcm"),
        (Method::GcmPooled, "gcm-pooled"),
        (Method::GcmGroup, "gcm-group"),
        (Method::Gcm, "gcm"),
    ];
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Method::ALL.iter().find(|(method, _)| method == self).map_or("", |(_, name)| name);
        f.pad(name)
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = Method::ALL.map(|(_, name)| name).join(", ");
        let found = Method::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(method, _)| *method).ok_or_else(|| format!("no such method; there are {names}"))
    }
}

/// What a test needs to know.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The robot that judges. `gcm` compares in the map of the robot with the lowest number of those that closures join,
    /// whoever judges; the tests of the published system in this robot's.
    pub reference: RobotId,
    /// Trajectories of all robots that closures touch, with the covariance of the keyframes touched.
    pub trajectories: Trajectories2,
    /// The closures to judge.
    pub closures: Vec<Closure2>,
    /// Where maps lie, from map alignment: never from the closures that are judged.
    pub map_transforms: Vec<MapTransform2>,
}

/// The verdicts of a test.
#[derive(Debug, Clone)]
pub struct Judgement {
    /// Accepted, rejected and undecided closures, by their place in [`Evidence::closures`].
    pub selection: Selection,
    /// Factor by which the closures' noise exceeds their covariances, as far as the test can tell.
    pub noise_scale: f64,
}

/// Judges all closures of `evidence`.
///
/// # Errors
/// Those of the test: bad covariances, poses without covariance.
pub fn select(method: Method, evidence: &Evidence) -> Result<Judgement, Error> {
    let Evidence { reference, trajectories, closures, map_transforms } = evidence;
    let reference = *reference;
    let mut noise_scale = 1.0;
    let selection = match method {
        Method::None => Selection { accepted: (0..closures.len()).collect(), ..Selection::default() },
        Method::Pcm => pcm(trajectories, closures, &PcmParams::default())?,
        Method::GcmPooled => {
            let params = PooledParams { reference, ..PooledParams::default() };
            gcm_pooled(trajectories, closures, map_transforms, &params)?
        }
        Method::GcmGroup => {
            let params = GroupParams { reference, ..GroupParams::default() };
            gcm_group(trajectories, closures, map_transforms, &params)?
        }
        Method::Gcm => {
            let result = gcm(trajectories, closures, map_transforms, &GcmParams::default())?;
            noise_scale = result.noise_scale;
            result.selection
        }
    };
    Ok(Judgement { selection, noise_scale })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_is_found_by_its_name() {
        for (method, name) in Method::ALL {
            assert_eq!(name.parse::<Method>(), Ok(method));
            assert_eq!(method.to_string(), name);
        }
        assert!("best".parse::<Method>().unwrap_err().contains("gcm-pooled"));
    }
}

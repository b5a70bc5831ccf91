use draco_lie::GaussianPose2;

use crate::object::check_map;
use crate::{AsCodedParams, ConsensusParams, Error, Object, ShapeSimilarity, as_coded, consensus};

/// Object `first` of map 1 and object `second` of map 2 are the same thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pair {
    /// Index in map 1.
    pub first: usize,
    /// Index in map 2.
    pub second: usize,
}

/// One explanation of the two maps: a transform and the pairs it brings together.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Pose of map 2's frame in map 1's, `p₁ = T p₂`; covariance order `[x, y, θ]`, frame of map 2.
    pub map1_from_map2: GaussianPose2,
    /// Pairs in order of `first`.
    pub pairs: Vec<Pair>,
    /// Logarithm of how much better this transform explains the maps than chance does.
    pub score: f64,
    /// Share of all explanations, "the maps have nothing in common" included; they sum to at most 1.
    pub probability: f64,
}

/// What a match may be used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// One transform explains the maps and no other comes near it.
    Unique,
    /// Several separate transforms explain the maps; do not use the best one without further evidence.
    Ambiguous,
    /// No transform explains the maps better than chance.
    None,
}

/// The answer to "which object is which".
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// Pairs of the best mode, in order of `first`; empty without a mode.
    pub pairs: Vec<Pair>,
    /// Transform of the best mode, whatever the verdict; `None` without a mode.
    pub map1_from_map2: Option<GaussianPose2>,
    /// Separate explanations, best first.
    pub modes: Vec<Mode>,
    /// Whether the best mode may be trusted.
    pub verdict: Verdict,
}

impl Match {
    pub(crate) fn from_modes(modes: Vec<Mode>, verdict: Verdict) -> Self {
        let best = modes.first();
        Self {
            pairs: best.map(|m| m.pairs.clone()).unwrap_or_default(),
            map1_from_map2: best.map(|m| m.map1_from_map2),
            modes,
            verdict,
        }
    }
}

/// Which pipeline matches.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// Ours: transform hypotheses weighed by their evidence.
    Consensus(ConsensusParams),
    /// The published pipeline, for comparison.
    AsCoded(AsCodedParams),
}

impl Default for Method {
    fn default() -> Self {
        Self::Consensus(ConsensusParams::default())
    }
}

/// Matches two object maps, by length and breadth as well as by place.
///
/// # Errors
/// An object that is not finite, has a negative extent or an invalid covariance; a parameter out of range.
///
/// ```
/// use draco_graphmatch::{Method, Object, Verdict, match_objects};
/// use nalgebra::{Isometry2, Point2, Vector2};
///
/// let places = [(0.0, 0.0), (9.0, 2.0), (4.0, 12.0), (-6.0, 7.0), (15.0, -8.0), (3.0, -11.0)];
/// let map1: Vec<_> = places.iter().map(|&(x, y)| Object::new(Point2::new(x, y), 4.0, 2.0)).collect();
/// let map1_from_map2 = Isometry2::new(Vector2::new(30.0, -5.0), 2.0);
/// let map2: Vec<_> = map1
///     .iter()
///     .map(|o| Object { centroid: map1_from_map2.inverse_transform_point(&o.centroid), ..*o })
///     .collect();
///
/// let found = match_objects(&map1, &map2, &Method::default())?;
/// assert_eq!(found.verdict, Verdict::Unique);
/// assert_eq!(found.pairs.len(), 6);
/// # Ok::<(), draco_graphmatch::Error>(())
/// ```
pub fn match_objects(map1: &[Object], map2: &[Object], method: &Method) -> Result<Match, Error> {
    check_map(map1, "map1")?;
    check_map(map2, "map2")?;
    match method {
        Method::Consensus(params) => {
            consensus(map1, map2, &ShapeSimilarity::new(map1, map2, params.shape_sigma)?, params)
        }
        Method::AsCoded(params) => as_coded(map1, map2, params),
    }
}

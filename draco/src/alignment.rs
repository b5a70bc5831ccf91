//! Map-to-map transforms without a prior: where does the partner's map lie in mine?
//!
//! [`align_cells`] lays the partner's persistent cells over the robot's own in every heading and returns the separate
//! ways in which they fit. A fit is only a *hypothesis*: a false one brings in closures that agree with each other, so
//! nothing after it can find the mistake. [`judge`] believes it when it is clearly better than the second way **and**
//! enough of the closures tried under it pass their gate; [`cycle_error`] checks three robots against each other.
//! Otherwise the answer is to wait until the maps have grown.

use draco_lie::LieGroup;
use draco_registration::correlative::{MapAlignmentParams, MapMode, align_maps};
use nalgebra::{Isometry2, Point2};

use crate::Error;
use crate::objects::cells::CellParams;

/// How maps are aligned and when an alignment is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlignmentParams {
    /// Reduction of a map to cells.
    pub cells: CellParams,
    /// The search.
    pub search: MapAlignmentParams,
    /// Fewest cells of either map. Default 60: fewer have no shape of their own.
    pub min_cells: usize,
    /// Largest score of the second way over that of the first. Default 0.90.
    pub max_ratio: f64,
    /// Fewest closures tried before their share counts. Default 10.
    pub min_tried: usize,
    /// Least share of tried closures that pass their gate. Default 0.3: right alignments reach 0.4 to 0.7, wrong ones
    /// 0.1.
    pub min_share: f64,
    /// Largest error of position around a cycle of three robots, metres. Default 5 m: three alignments of maps that
    /// are each good to 2 m.
    pub max_cycle_distance: f64,
    /// Largest error of heading around a cycle, radians. Default 10°.
    pub max_cycle_angle: f64,
}

impl Default for AlignmentParams {
    fn default() -> Self {
        Self {
            cells: CellParams::default(),
            search: MapAlignmentParams::default(),
            min_cells: 60,
            max_ratio: 0.90,
            min_tried: 10,
            min_share: 0.3,
            max_cycle_distance: 5.0,
            max_cycle_angle: 10f64.to_radians(),
        }
    }
}

/// The ways in which a partner's map fits the robot's own.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// `own_from_partner` with covariance and score, best first; never empty.
    pub modes: Vec<MapMode>,
    /// Score of the second mode over that of the first, 0 when there is no second.
    pub ratio: f64,
}

impl Alignment {
    /// The best way.
    pub fn own_from_partner(&self) -> Isometry2<f64> {
        self.modes[0].target_from_source
    }

    fn new(modes: Vec<MapMode>) -> Option<Self> {
        let first = modes.first()?;
        let ratio = modes.get(1).map_or(0.0, |second| second.score / first.score);
        Some(Self { modes, ratio })
    }
}

/// Lays the centres of the partner's cells over the robot's own, each in its own map frame. `None` when either map is
/// still too small.
///
/// # Errors
/// Cells too far apart for the grid of the correlation.
pub fn align_cells(
    own: &[Point2<f64>],
    partner: &[Point2<f64>],
    params: &AlignmentParams,
) -> Result<Option<Alignment>, Error> {
    if own.len().min(partner.len()) < params.min_cells {
        return Ok(None);
    }
    // The map with more cells is the field; the score then counts how much of the smaller one is explained.
    let modes = if own.len() >= partner.len() {
        align_maps(own, partner, &params.search)?
    } else {
        align_maps(partner, own, &params.search)?.into_iter().map(inverted).collect()
    };
    Ok(Alignment::new(modes))
}

/// The mode told from the other side.
fn inverted(mode: MapMode) -> MapMode {
    let adjoint = mode.target_from_source.adjoint();
    MapMode {
        target_from_source: mode.target_from_source.inverse(),
        covariance: adjoint * mode.covariance * adjoint.transpose(),
        score: mode.score,
    }
}

/// How the closures tried under a hypothesis fared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Closures registered.
    pub tried: usize,
    /// Those that passed their gate.
    pub passed: usize,
}

/// What becomes of a hypothesis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Believed: its closures may enter the map.
    Accepted,
    /// The second way fits nearly as well.
    Ambiguous,
    /// Too few closures could be tried so far.
    Untried,
    /// Too few of the closures tried passed.
    Refuted,
}

/// Whether a hypothesis is believed.
pub fn judge(ratio: f64, tally: &Tally, params: &AlignmentParams) -> Verdict {
    if ratio >= params.max_ratio {
        Verdict::Ambiguous
    } else if tally.tried < params.min_tried {
        Verdict::Untried
    } else if (tally.passed as f64) < params.min_share * tally.tried as f64 {
        Verdict::Refuted
    } else {
        Verdict::Accepted
    }
}

/// What is left when one goes around three robots: metres at the first robot's origin, and radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleError {
    /// Metres, at the point asked for.
    pub distance: f64,
    /// Radians.
    pub angle: f64,
}

/// Goes around `a_from_b · b_from_c · c_from_a` and tells by how far `at`, a point of `a`'s map where its robot has
/// been, comes back elsewhere.
pub fn cycle_error(
    a_from_b: &Isometry2<f64>,
    b_from_c: &Isometry2<f64>,
    c_from_a: &Isometry2<f64>,
    at: &Point2<f64>,
) -> CycleError {
    let around = a_from_b * b_from_c * c_from_a;
    CycleError { distance: (around * at - at).norm(), angle: around.rotation.angle().abs() }
}

impl CycleError {
    /// Whether the three transforms belong together.
    pub fn closes(&self, params: &AlignmentParams) -> bool {
        self.distance <= params.max_cycle_distance && self.angle <= params.max_cycle_angle
    }
}

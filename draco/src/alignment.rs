//! Map-to-map transforms without a prior: where does the partner's map lie in mine?
//!
//! Persistent cells of both maps are correlated over all headings. The answer is one transform only when the best fit
//! stands clear of the second best; closures registered under it have to confirm it before it is believed. Both gates
//! rest on one idea: a wrong alignment of a repetitive place has rivals, and under it scans do not register.

use draco_registration::correlative::{MapAlignmentParams, MapMode, align_maps};
use nalgebra::Point2;

use crate::error::Error;
use crate::message::CellMap;

/// When an alignment is considered and when it is believed.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignmentParams {
    /// The search.
    pub search: MapAlignmentParams,
    /// Fewest cells of each map. Default 40: below that, a straight piece of wall is all there is.
    pub min_cells: usize,
    /// Largest score of the second best fit over that of the best. Default 0.90, from the real recording, where
    /// right alignments have 0.69 to 0.88 and wrong ones 0.93 and 1.
    pub max_ratio: f64,
    /// Attempts in a row, each with larger maps, that have to fit in the same clear way before it is a hypothesis, and
    /// to fit elsewhere before a hypothesis is withdrawn. Default 3: a false fit rarely survives the growth of a map.
    pub min_streak: usize,
    /// Largest distance, at the middle of the partner's map, of two fits that are the same. Default 6 m, three cells.
    pub same_distance: f64,
    /// Largest difference in heading of two fits that are the same. Default 10°.
    pub same_angle: f64,
    /// Registrations under an alignment before it is judged. Default 10.
    pub min_tested: usize,
    /// Least share of them that has to pass its gate. Default 0.3: right alignments have 0.43 to 0.68, wrong ones at
    /// most 0.11 on the real recording.
    pub min_share: f64,
}

impl Default for AlignmentParams {
    fn default() -> Self {
        AlignmentParams {
            search: MapAlignmentParams::default(),
            min_cells: 40,
            max_ratio: 0.90,
            min_streak: 3,
            same_distance: 6.0,
            same_angle: 10f64.to_radians(),
            min_tested: 10,
            min_share: 0.3,
        }
    }
}

impl AlignmentParams {
    /// Whether two fits are the same one, told at the point `middle` of the partner's map.
    pub fn agree(&self, a: &MapMode, b: &MapMode, middle: &Point2<f64>) -> bool {
        let (a, b) = (a.target_from_source, b.target_from_source);
        (a * middle - b * middle).norm() <= self.same_distance
            && a.rotation.angle_to(&b.rotation).abs() <= self.same_angle
    }

    /// Whether registrations under an alignment confirm it (`Some(true)`) or refute it; `None` while there are too few.
    pub fn judge(&self, passed: usize, tested: usize) -> Option<bool> {
        (tested >= self.min_tested).then(|| passed as f64 >= self.min_share * tested as f64)
    }
}

/// How two maps fit.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// In one way, clear of all others: `own_from_partner`.
    Clear(MapMode),
    /// In several ways that score about the same.
    Ambiguous {
        /// Score of the second best over that of the best.
        ratio: f64,
    },
    /// There is too little to compare.
    None,
}

/// Compares two maps.
///
/// # Errors
/// Those of the search.
pub fn align(own: &CellMap, partner: &CellMap, params: &AlignmentParams) -> Result<Verdict, Error> {
    if own.cells.len().min(partner.cells.len()) < params.min_cells {
        return Ok(Verdict::None);
    }
    let modes = align_maps(&own.centres(), &partner.centres(), &params.search)?;
    Ok(match modes.as_slice() {
        [] => Verdict::None,
        [only] => Verdict::Clear(*only),
        [best, second, ..] => {
            let ratio = second.score / best.score;
            if ratio <= params.max_ratio { Verdict::Clear(*best) } else { Verdict::Ambiguous { ratio } }
        }
    })
}

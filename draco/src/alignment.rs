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
            min_tested: 10,
            min_share: 0.3,
        }
    }
}

impl AlignmentParams {
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
    let modes = align_maps(&centres(own), &centres(partner), &params.search)?;
    Ok(match modes.as_slice() {
        [] => Verdict::None,
        [only] => Verdict::Clear(*only),
        [best, second, ..] => {
            let ratio = second.score / best.score;
            if ratio <= params.max_ratio { Verdict::Clear(*best) } else { Verdict::Ambiguous { ratio } }
        }
    })
}

fn centres(map: &CellMap) -> Vec<Point2<f64>> {
    let centre = |[i, j]: &[i32; 2]| Point2::new(f64::from(*i) + 0.5, f64::from(*j) + 0.5) * map.size;
    map.cells.iter().map(centre).collect()
}

//! Map-to-map transforms without a prior: where does the partner's map lie in mine?
//!
//! Persistent cells of both maps are correlated over all headings. The answer is one transform only when the best fit
//! stands clear of the second best; closures registered under it have to confirm it before it is believed. Both gates
//! rest on one idea: a wrong alignment of a repetitive place has rivals, and under it scans do not register.

mod consensus;
mod objects;

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use draco_registration::correlative::{MapAlignmentParams, MapMode, align_maps};
use nalgebra::{Isometry2, Point2};

use crate::error::Error;
use crate::message::CellMap;

pub use consensus::{Opinion, consensus};
pub use objects::{ObjectMatcher, align_objects};

/// What of two maps is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapKind {
    /// Persistent cells, by correlation over all headings.
    #[default]
    Cells,
    /// Objects cut to bounded segments, by consensus: fewer bits, and enough where things stand apart.
    Segments,
    /// Whole objects by spectral matching, as the published system's code does: the baseline. On a long quay the middle
    /// of an object depends on what was seen of it, and the matching fails.
    Objects,
}

impl MapKind {
    /// All kinds with their names on the command line.
    pub const ALL: [(MapKind, &'static str); 3] =
        [(MapKind::Cells, "cells"), (MapKind::Segments, "segments"), (MapKind::Objects, "objects")];
}

impl fmt::Display for MapKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(MapKind::ALL.iter().find(|(kind, _)| kind == self).map_or("", |(_, name)| name))
    }
}

impl FromStr for MapKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = MapKind::ALL.map(|(_, name)| name).join(", ");
        let found = MapKind::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(kind, _)| *kind).ok_or_else(|| format!("no such maps; there are {names}"))
    }
}

/// When an alignment is considered and when it is believed.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignmentParams {
    /// What is compared. Default cells.
    pub maps: MapKind,
    /// The search. Default with fits kept apart from 4 m, two cells: a place that repeats every few metres has its rival
    /// fits there, and a fit that swallows its rivals hides that the answer is ambiguous.
    pub search: MapAlignmentParams,
    /// Fewest cells of each map. Default 40: below that, a straight piece of wall is all there is.
    pub min_cells: usize,
    /// Weight of the share of cells that would stand in free space against the score. Default 2: such a cell speaks
    /// louder against a fit than a matching one speaks for it, since there are many ways to match.
    pub conflict_weight: f64,
    /// Largest score of the second best fit over that of the best. Default 0.90, from the real recording, where
    /// right alignments have 0.69 to 0.88 and wrong ones 0.93 and 1.
    pub max_ratio: f64,
    /// Attempts in a row, each with both maps larger, that have to fit in the same clear way before it is a hypothesis, and
    /// attempts to fit elsewhere before a hypothesis is withdrawn. Default 3: a false fit rarely survives the growth of the
    /// maps. It does survive the growth of one map alone.
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
            maps: MapKind::default(),
            search: MapAlignmentParams { separate_distance: 4.0, modes: 10, ..MapAlignmentParams::default() },
            min_cells: 40,
            conflict_weight: 2.0,
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
    /// Whether two transforms are the same one, told at the point `middle` of the partner's map.
    pub fn same(&self, a: &Isometry2<f64>, b: &Isometry2<f64>, middle: &Point2<f64>) -> bool {
        (a * middle - b * middle).norm() <= self.same_distance
            && a.rotation.angle_to(&b.rotation).abs() <= self.same_angle
    }

    /// Whether registrations under an alignment confirm it (`Some(true)`) or refute it; `None` while there are too few.
    pub fn judge(&self, passed: usize, tested: usize) -> Option<bool> {
        (tested >= self.min_tested).then_some(passed as f64 >= self.min_share * tested as f64)
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

/// The own map as an alignment needs it.
#[derive(Debug, Clone)]
pub struct OwnMap {
    /// What several keyframes saw.
    pub cells: CellMap,
    /// What several keyframes looked through, in cells of the same size.
    pub free: BTreeSet<[i32; 2]>,
}

/// Compares two maps.
///
/// A repetitive place fits itself best where it overlaps most, whether or not it lies there. So the fits are ranked
/// by their score less the share of the partner's cells that would stand where the own robot looked through.
///
/// # Errors
/// Those of the search.
pub fn align(own: &OwnMap, partner: &CellMap, params: &AlignmentParams) -> Result<Verdict, Error> {
    if own.cells.cells.len().min(partner.cells.len()) < params.min_cells {
        return Ok(Verdict::None);
    }
    let centres = partner.centres();
    let mut modes = align_maps(&own.cells.centres(), &centres, &params.search)?;
    for mode in &mut modes {
        mode.score -= params.conflict_weight * conflict(own, &centres, &mode.target_from_source);
    }
    modes.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(match modes.as_slice() {
        [] => Verdict::None,
        [best, ..] if best.score <= 0.0 => Verdict::None,
        [only] => Verdict::Clear(*only),
        [best, second, ..] => {
            let ratio = second.score / best.score;
            if ratio <= params.max_ratio { Verdict::Clear(*best) } else { Verdict::Ambiguous { ratio } }
        }
    })
}

/// Share of the partner's cells that would stand in the own robot's free space.
fn conflict(own: &OwnMap, centres: &[Point2<f64>], own_from_partner: &Isometry2<f64>) -> f64 {
    let in_free = |centre: &&Point2<f64>| {
        let p = own_from_partner * *centre;
        own.free.contains(&[(p.x / own.cells.size).floor() as i32, (p.y / own.cells.size).floor() as i32])
    };
    centres.iter().filter(in_free).count() as f64 / centres.len().max(1) as f64
}

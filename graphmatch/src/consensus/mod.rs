//! Matching by transform hypotheses and their evidence.

mod alike;
mod buckets;
mod continuation;
mod evidence;
mod hypotheses;
mod modes;
mod overlap;
mod polish;
mod problem;
mod repeated;
mod window;

pub use modes::consensus;

use crate::Error;

/// Knobs of [`consensus`]. The defaults fit objects seen by sonar with 0.2 m of noise.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsensusParams {
    /// Standard deviation of one coordinate of an object's centre between the two maps, metres.
    ///
    /// Default 0.2. Objects with an own covariance replace half of this variance by it.
    pub position_sigma: f64,
    /// Standard deviation of an object's length (breadth) between the two maps, metres. Default 0.2.
    pub shape_sigma: f64,
    /// Distance, in standard deviations, beyond which two centres are not the same. Default 3.5.
    pub gate: f64,
    /// Shortest distance of two objects of one map that gives a direction, metres. Default 1.
    pub min_edge: f64,
    /// Most hypotheses that are refined and weighed. Default 300; the right one is nearly always among the first
    /// ten.
    pub max_hypotheses: usize,
    /// Most modes returned. Default 5.
    pub max_modes: usize,
    /// Transforms that put the middle of map 2 closer than this are one mode, if `mode_angle` agrees; metres.
    /// Default 2.
    pub mode_distance: f64,
    /// Transforms that differ by less than this are one mode, if `mode_distance` agrees; radians. Default 10°.
    pub mode_angle: f64,
    /// Least share of the best mode among all modes for [`Verdict::Unique`](crate::Verdict::Unique). Default 0.92,
    /// 2.4 nats ahead of all others together.
    pub unique_probability: f64,
    /// Probability, before looking, that both robots were sent over one area, from 0 to below 1; else their areas overlap in
    /// part. Default 0.75: robots that compare maps share a job. Maps that repeat themselves are not asked.
    pub one_area: f64,
    /// Logarithm of the odds, before looking, that the maps have nothing in common; below it a best mode is
    /// [`Verdict::None`](crate::Verdict::None). Default −2.5: robots compare maps when they expect an overlap.
    pub log_odds_nothing: f64,
    /// Fewest pairs of a mode. Default 4; one fewer will do where a map repeats itself, as two pilings of a row and one other
    /// object may be all that two robots share, and where their looks make them worth as much.
    pub min_pairs: usize,
}

impl Default for ConsensusParams {
    fn default() -> Self {
        Self {
            position_sigma: 0.2,
            shape_sigma: 0.2,
            gate: 3.5,
            min_edge: 1.0,
            max_hypotheses: 300,
            max_modes: 5,
            mode_distance: 2.0,
            mode_angle: 10_f64.to_radians(),
            unique_probability: 0.92,
            one_area: 0.75,
            log_odds_nothing: -2.5,
            min_pairs: 4,
        }
    }
}

impl ConsensusParams {
    fn check(&self) -> Result<(), Error> {
        let positive = [
            ("position_sigma", self.position_sigma),
            ("shape_sigma", self.shape_sigma),
            ("gate", self.gate),
            ("min_edge", self.min_edge),
            ("mode_distance", self.mode_distance),
            ("mode_angle", self.mode_angle),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::BadParameter { name, value, need: "finite and positive" });
            }
        }
        if !(0.0..=1.0).contains(&self.unique_probability) {
            let value = self.unique_probability;
            return Err(Error::BadParameter { name: "unique_probability", value, need: "between 0 and 1" });
        }
        if !(0.0..1.0).contains(&self.one_area) {
            let value = self.one_area;
            return Err(Error::BadParameter { name: "one_area", value, need: "from 0 to below 1" });
        }
        Ok(())
    }
}

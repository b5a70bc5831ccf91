use nalgebra::Point2;

use super::ConsensusParams;
use super::buckets::Buckets;
use super::window::Window;
use crate::object::centroids;
use crate::{Object, Similarity};

/// Two maps and what every pair of their objects is worth.
pub(super) struct Problem<'a> {
    pub(super) params: &'a ConsensusParams,
    pub(super) p1: Vec<Point2<f64>>,
    pub(super) p2: Vec<Point2<f64>>,
    /// Variance of a coordinate's difference, row-major, `p1.len() × p2.len()`.
    variance: Vec<f64>,
    /// Evidence of a pair at distance 0: likeness and rarity of the place; -∞ where ruled out.
    gain: Vec<f64>,
    /// The part of `gain` that comes from likeness.
    looks: Vec<f64>,
    /// Whether any pair gains by its looks.
    looks_tell: bool,
    /// Whether the map shows an object elsewhere again, in the same company.
    pub(super) repeated1: Vec<bool>,
    pub(super) repeated2: Vec<bool>,
    /// Place evidence of a pair of ordinary accuracy.
    pub(super) place: f64,
    pub(super) largest_sigma: f64,
    pub(super) window1: Window,
    pub(super) window2: Window,
    pub(super) buckets: Buckets,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        map1: &[Object],
        map2: &[Object],
        similarity: &impl Similarity,
        params: &'a ConsensusParams,
    ) -> Self {
        let (p1, p2) = (centroids(map1), centroids(map2));
        let half = 0.5 * params.position_sigma * params.position_sigma;
        let of = |o: &Object| o.covariance.map_or(half, |c| 0.5 * c.trace());
        let (var1, var2): (Vec<f64>, Vec<f64>) =
            (map1.iter().map(of).collect(), map2.iter().map(of).collect());
        let margin = params.gate * params.position_sigma;
        let (window1, window2) = (Window::new(&p1, margin), Window::new(&p2, margin));
        let density = ((p1.len() as f64 / window1.area) * (p2.len() as f64 / window2.area)).sqrt();
        let mut variance = Vec::with_capacity(p1.len() * p2.len());
        let mut gain = Vec::with_capacity(p1.len() * p2.len());
        let mut all_looks = Vec::with_capacity(p1.len() * p2.len());
        // Most pairs are as accurate as the last.
        let (mut known_variance, mut place) = (0.0, 0.0);
        for (i, v1) in var1.iter().enumerate() {
            for (a, v2) in var2.iter().enumerate() {
                // A variance of zero would make a pair infinitely good; a millimetre is below any map's truth.
                let v = (v1 + v2).max(1e-6);
                variance.push(v);
                if v != known_variance {
                    (known_variance, place) = (v, -(std::f64::consts::TAU * v * density).ln());
                }
                let looks = similarity.log_ratio(i, a).unwrap_or(f64::NEG_INFINITY);
                gain.push(place + looks);
                all_looks.push(looks);
            }
        }
        let largest_sigma = variance.iter().fold(0.0, |m: f64, v| m.max(*v)).sqrt();
        // The first pass of a refinement looks twice as far as the gate.
        let buckets = Buckets::new(&p1, 2.0 * params.gate * largest_sigma.max(1e-3));
        let place = -(std::f64::consts::TAU * params.position_sigma * params.position_sigma * density).ln();
        let (repeated1, repeated2) = (vec![false; p1.len()], vec![false; p2.len()]);
        Self {
            looks_tell: all_looks.iter().any(|looks| *looks > 0.0),
            params,
            p1,
            p2,
            variance,
            gain,
            looks: all_looks,
            repeated1,
            repeated2,
            place,
            largest_sigma,
            window1,
            window2,
            buckets,
        }
    }

    pub(super) fn variance(&self, i: usize, a: usize) -> f64 {
        self.variance[i * self.p2.len() + a]
    }

    pub(super) fn gain(&self, i: usize, a: usize) -> f64 {
        self.gain[i * self.p2.len() + a]
    }

    /// Gains and variances of all pairs with object `i` of map 1.
    pub(super) fn row(&self, i: usize) -> (&[f64], &[f64]) {
        let row = i * self.p2.len()..(i + 1) * self.p2.len();
        (&self.gain[row.clone()], &self.variance[row])
    }

    /// Whether a pair is one of many that stand or fall together.
    pub(super) fn is_repeated(&self, i: usize, a: usize) -> bool {
        self.repeated1[i] || self.repeated2[a]
    }

    /// Fewest pairs of a mode.
    pub(super) fn fewest_pairs(&self) -> usize {
        self.params.min_pairs.saturating_sub(usize::from(self.repeats() || self.looks_tell))
    }

    /// Least evidence of a mode's pairs: where looks tell, few pairs will do that are worth as many as are asked for.
    pub(super) fn least_sum(&self, pairs: usize) -> f64 {
        if pairs >= self.params.min_pairs || self.repeats() {
            return f64::NEG_INFINITY;
        }
        self.params.min_pairs as f64 * self.place
    }

    /// Whether either map repeats itself.
    pub(super) fn repeats(&self) -> bool {
        self.repeated1.contains(&true) || self.repeated2.contains(&true)
    }

    /// Likeness of a pair, -∞ where ruled out.
    pub(super) fn looks(&self, i: usize, a: usize) -> f64 {
        self.looks[i * self.p2.len() + a]
    }
}

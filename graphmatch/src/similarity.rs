use crate::{Error, Object};

/// How much two objects look alike, beyond where they are: intensity, shape descriptors, classes.
pub trait Similarity {
    /// Logarithm of how much likelier the looks of object `first` of map 1 and `second` of map 2 are if they are
    /// one thing than if they are any two; `None` rules the pair out.
    fn log_ratio(&self, first: usize, second: usize) -> Option<f64>;
}

/// Objects all look alike: only places count.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoSimilarity;

impl Similarity for NoSimilarity {
    fn log_ratio(&self, _first: usize, _second: usize) -> Option<f64> {
        Some(0.0)
    }
}

/// Likeness of length and breadth with Gaussian noise; shapes that both maps are full of count little.
#[derive(Debug, Clone)]
pub struct ShapeSimilarity {
    columns: usize,
    log_ratio: Vec<Option<f64>>,
}

/// Difference of a dimension, in standard deviations, beyond which two objects are not the same.
const GATE: f64 = 3.5;

impl ShapeSimilarity {
    /// Log ratios of all pairs.
    ///
    /// * `sigma` – standard deviation of the difference of a dimension seen twice, metres.
    ///
    /// ```text
    /// log N(ΔL; σ²) N(ΔB; σ²) − log ḡ,   ḡ = mean over both maps' objects of the same kernel at the pair's mean shape
    /// ```
    /// so a pair of a shape that every object has gets 0, and a rare shape much.
    ///
    /// # Errors
    /// `sigma` not finite and positive.
    pub fn new(map1: &[Object], map2: &[Object], sigma: f64) -> Result<Self, Error> {
        if !(sigma.is_finite() && sigma > 0.0) {
            return Err(Error::BadParameter {
                name: "shape_sigma",
                value: sigma,
                need: "finite and positive",
            });
        }
        let all: Vec<[f64; 2]> =
            map1.iter().chain(map2).map(|o| [o.length / sigma, o.breadth / sigma]).collect();
        let (first, second) = all.split_at(map1.len());
        let mut log_ratio = Vec::with_capacity(first.len() * second.len());
        for a in first {
            for b in second {
                log_ratio.push(log_ratio_of(a, b, &all));
            }
        }
        Ok(Self { columns: second.len(), log_ratio })
    }
}

fn log_ratio_of(a: &[f64; 2], b: &[f64; 2], all: &[[f64; 2]]) -> Option<f64> {
    let (dl, db) = (a[0] - b[0], a[1] - b[1]);
    if dl.abs() > GATE || db.abs() > GATE {
        return None;
    }
    let mean = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    // The pair itself is among `all` and keeps the density above 2/n of a kernel: a shape seen once is worth at
    // most log(n/2) more than its neighbourhood shows.
    let density: f64 = all
        .iter()
        .map(|o| 0.25 * ((o[0] - mean[0]).powi(2) + (o[1] - mean[1]).powi(2)))
        // What lies farther adds less than a millionth of the pair's own share.
        .filter(|far| *far < 20.0)
        .map(|far| (-far).exp() * 0.5)
        .sum::<f64>()
        / all.len() as f64;
    Some(-0.5 * (dl * dl + db * db) - density.ln())
}

impl Similarity for ShapeSimilarity {
    fn log_ratio(&self, first: usize, second: usize) -> Option<f64> {
        self.log_ratio.get(first * self.columns + second).copied().flatten()
    }
}

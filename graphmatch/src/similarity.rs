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
const GATE: f64 = 4.5;

impl ShapeSimilarity {
    /// Log ratios of all pairs.
    ///
    /// * `sigma` – standard deviation of the difference of a dimension seen twice, metres.
    ///
    /// ```text
    /// log N(ΔL; σ²) N(ΔB; σ²) − log ḡ,   ḡ = (g₀ + Σ g) / (1 + n)
    /// ```
    /// where ḡ is the density of shapes, the geometric mean of that at both: g the kernels of width √2 σ about the n other objects
    /// of both maps, and g₀ even over the rectangle of all shapes, one more object's worth, for shapes not seen yet (the prediction
    /// of a Dirichlet process of mass 1). A pair of a shape that every object has gets 0, a rare one much.
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
        let even = even_density(&all);
        let (first, second) = all.split_at(map1.len());
        let density = |o: &[f64; 2]| even + all.iter().map(|other| kernel(o, other)).sum::<f64>();
        let densities: Vec<f64> = all.iter().map(density).collect();
        let (density1, density2) = densities.split_at(map1.len());
        let others = (all.len().max(2) - 1) as f64;
        let mut log_ratio = Vec::with_capacity(first.len() * second.len());
        for (a, of_a) in first.iter().zip(density1) {
            for (b, of_b) in second.iter().zip(density2) {
                let (dl, db) = (a[0] - b[0], a[1] - b[1]);
                let admissible = dl.abs() <= GATE && db.abs() <= GATE;
                log_ratio.push(admissible.then(|| {
                    // The two themselves tell nothing of what others look like.
                    let own = kernel(a, a) + kernel(a, b);
                    let product = (of_a - own).max(even) * (of_b - own).max(even);
                    -0.5 * (dl * dl + db * db) - 0.5 * product.ln() + others.ln()
                }));
            }
        }
        Ok(Self { columns: second.len(), log_ratio })
    }
}

/// A normal density of width √2 about `a`, in units of the likelihood's peak.
fn kernel(a: &[f64; 2], b: &[f64; 2]) -> f64 {
    0.5 * (-0.25 * ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2))).exp()
}

/// Density of shapes spread evenly over the rectangle of `all`, two standard deviations more on each side, in units of the
/// likelihood's peak.
fn even_density(all: &[[f64; 2]]) -> f64 {
    let sides = [0, 1].map(|d| {
        let (low, high) =
            all.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), o| (low.min(o[d]), high.max(o[d])));
        (high - low).max(0.0) + 4.0
    });
    std::f64::consts::TAU / (sides[0] * sides[1])
}

impl Similarity for ShapeSimilarity {
    fn log_ratio(&self, first: usize, second: usize) -> Option<f64> {
        self.log_ratio.get(first * self.columns + second).copied().flatten()
    }
}

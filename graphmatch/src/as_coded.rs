use draco_lie::GaussianPose2;
use nalgebra::{Isometry2, Matrix3, Point2, UnitComplex, Vector2};

use crate::affinity::{Affinity, AffinityParams, Attributes, Kernel};
use crate::object::{centroids, check_map};
use crate::spectral::principal_eigenvector;
use crate::{Costs, Error, Match, Mode, Object, Pair, Verdict, assign};

/// Knobs of [`as_coded`], with the published pipeline's values as defaults.
#[derive(Debug, Clone, PartialEq)]
pub struct AsCodedParams {
    /// Decay of an affinity with the difference of edge lengths, 1/m. Default 8.
    pub mu: f64,
    /// Decay of a pair's weight with the difference of length and of breadth, 1/m. Default 2; 0 ignores shape.
    pub mu_shape: f64,
    /// Whether equal edges get affinity 0 as in the published code (identical maps then match at random).
    /// Default true.
    pub zero_difference_flaw: bool,
    /// Whether the translation of the similarity transform is kept when its scale is dropped, as in the
    /// published code. Default true; false fits a rigid transform to the inliers.
    pub scaled_translation_flaw: bool,
    /// Distance below which a pair supports a transform, metres. Default 5.
    pub inlier_radius: f64,
    /// Fewest inliers. Default 4.
    pub min_inliers: usize,
    /// Fewest objects of a map, and fewest pairs. Default 5.
    pub min_objects: usize,
    /// Most samples of the similarity search. Default 2000.
    pub samples: usize,
    /// Seed of the samples, used only where there are more pairs of pairs than `samples`. Default 0.
    pub seed: u64,
}

impl Default for AsCodedParams {
    fn default() -> Self {
        Self {
            mu: 8.0,
            mu_shape: 2.0,
            zero_difference_flaw: true,
            scaled_translation_flaw: true,
            inlier_radius: 5.0,
            min_inliers: 4,
            min_objects: 5,
            samples: 2000,
            seed: 0,
        }
    }
}

/// The published pipeline: exponential affinity, principal eigenvector, assignment, similarity by random samples,
/// match again. It never doubts: the verdict is `Unique` or, where a step has too little, `None`. A mode's
/// `score` is the number of inliers.
///
/// # Errors
/// As [`match_objects`](crate::match_objects).
///
/// **Source**: the pipeline of DRACo-SLAM2 (Huang, McConnell, Lin, Englot, 2025) written anew. The eigenvector
/// starts from ones instead of at random, affinities below 10⁻¹² are 0, and where all pairs of pairs fit into
/// `samples` all are tried.
pub fn as_coded(map1: &[Object], map2: &[Object], params: &AsCodedParams) -> Result<Match, Error> {
    check_map(map1, "map1")?;
    check_map(map2, "map2")?;
    let none = Match::from_modes(Vec::new(), Verdict::None);
    if map1.len().min(map2.len()) < params.min_objects {
        return Ok(none);
    }
    let (p1, p2) = (centroids(map1), centroids(map2));
    let pairs = spectral_pairs(map1, map2, params)?;
    if pairs.len() < params.min_objects {
        return Ok(none);
    }
    let Some((transform, inliers)) = similarity(&p1, &p2, &pairs, params) else { return Ok(none) };
    let mode = Mode {
        // The published pipeline has no covariance; a metre and ten degrees say as much.
        map1_from_map2: GaussianPose2::new(
            transform,
            Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, 0.03)),
        )
        .map_err(|_| Error::NonFinitePoint { what: "map1", index: 0 })?,
        pairs: rematch(&p1, &p2, &transform, params.inlier_radius)?,
        score: inliers as f64,
        probability: 1.0,
    };
    Ok(Match::from_modes(vec![mode], Verdict::Unique))
}

fn spectral_pairs(map1: &[Object], map2: &[Object], params: &AsCodedParams) -> Result<Vec<Pair>, Error> {
    let attributes = if params.mu_shape > 0.0 {
        Attributes::Laplacian { mu: params.mu_shape }
    } else {
        Attributes::Ignore
    };
    let kernel = Kernel::Laplacian { mu: params.mu };
    let mut affinity =
        Affinity::new(map1, map2, &AffinityParams { kernel, attributes, ..AffinityParams::default() })?;
    if params.zero_difference_flaw {
        affinity.drop_exact_ones();
    }
    let vector = principal_eigenvector(&affinity, None);
    let costs: Vec<f64> = vector.vector.iter().map(|x| -x.abs()).collect();
    let found = assign(Costs::new(map1.len(), map2.len(), &costs)?)?;
    Ok(pairs_of(&found.column_of_row))
}

fn pairs_of(column_of_row: &[Option<usize>]) -> Vec<Pair> {
    column_of_row
        .iter()
        .enumerate()
        .filter_map(|(first, second)| second.map(|second| Pair { first, second }))
        .collect()
}

/// `p₁ ≈ s R p₂ + t` as the complex factor `s e^{iθ}` and `t`.
#[derive(Debug, Clone, Copy)]
struct Similar {
    factor: Vector2<f64>,
    shift: Vector2<f64>,
}

impl Similar {
    fn apply(&self, p: &Point2<f64>) -> Vector2<f64> {
        let f = self.factor;
        Vector2::new(f.x * p.x - f.y * p.y, f.y * p.x + f.x * p.y) + self.shift
    }

    /// Least squares; `None` where the points of map 2 coincide.
    fn fit(p1: &[Point2<f64>], p2: &[Point2<f64>], pairs: &[Pair]) -> Option<Self> {
        let n = pairs.len() as f64;
        let c1 = pairs.iter().fold(Vector2::zeros(), |s, p| s + p1[p.first].coords) / n;
        let c2 = pairs.iter().fold(Vector2::zeros(), |s, p| s + p2[p.second].coords) / n;
        let (mut dot, mut cross, mut norm) = (0.0, 0.0, 0.0);
        for p in pairs {
            let (a, b) = (p2[p.second].coords - c2, p1[p.first].coords - c1);
            dot += a.dot(&b);
            cross += a.perp(&b);
            norm += a.norm_squared();
        }
        let linear = Self { factor: Vector2::new(dot, cross) / norm, shift: Vector2::zeros() };
        (norm > 0.0 && dot * dot + cross * cross > 0.0)
            .then(|| Self { shift: c1 - linear.apply(&Point2::from(c2)), ..linear })
    }
}

fn similarity(
    p1: &[Point2<f64>],
    p2: &[Point2<f64>],
    pairs: &[Pair],
    params: &AsCodedParams,
) -> Option<(Isometry2<f64>, usize)> {
    let inliers_of = |s: &Similar| -> Vec<Pair> {
        let near = |p: &&Pair| (s.apply(&p2[p.second]) - p1[p.first].coords).norm() < params.inlier_radius;
        pairs.iter().filter(near).copied().collect()
    };
    let mut best: Vec<Pair> = Vec::new();
    for (a, b) in samples(pairs.len(), params) {
        let Some(s) = Similar::fit(p1, p2, &[pairs[a], pairs[b]]) else { continue };
        let inliers = inliers_of(&s);
        if inliers.len() > best.len() {
            best = inliers;
        }
    }
    if best.len() < params.min_inliers {
        return None;
    }
    let fitted = Similar::fit(p1, p2, &best)?;
    let rotation = UnitComplex::new(fitted.factor.y.atan2(fitted.factor.x));
    let shift = if params.scaled_translation_flaw {
        fitted.shift
    } else {
        let n = best.len() as f64;
        best.iter().fold(Vector2::zeros(), |s, p| s + p1[p.first].coords - rotation * p2[p.second].coords) / n
    };
    Some((Isometry2::from_parts(shift.into(), rotation), best.len()))
}

/// All pairs below `n` where they are few, else random ones.
fn samples(n: usize, params: &AsCodedParams) -> Vec<(usize, usize)> {
    if n * (n - 1) / 2 <= params.samples {
        return (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    }
    let mut random = crate::split_mix::SplitMix::new(params.seed);
    (0..params.samples)
        .map(|_| {
            let a = random.below(n);
            let b = random.below(n - 1);
            (a, if b >= a { b + 1 } else { b })
        })
        .collect()
}

fn rematch(
    p1: &[Point2<f64>],
    p2: &[Point2<f64>],
    transform: &Isometry2<f64>,
    radius: f64,
) -> Result<Vec<Pair>, Error> {
    let distance = |p: &Pair| (p1[p.first] - transform * p2[p.second]).norm();
    let costs: Vec<f64> = (0..p1.len())
        .flat_map(|first| (0..p2.len()).map(move |second| Pair { first, second }))
        .map(|p| distance(&p))
        .collect();
    let found = assign(Costs::new(p1.len(), p2.len(), &costs)?)?;
    Ok(pairs_of(&found.column_of_row).into_iter().filter(|p| distance(p) < radius).collect())
}

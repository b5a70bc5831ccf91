use nalgebra::{Isometry2, Matrix3, Point2, UnitComplex, Vector2};

/// A point of map 2 that belongs on a point of map 1, with weight 1/σ².
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tie {
    pub(crate) first: Point2<f64>,
    pub(crate) second: Point2<f64>,
    pub(crate) weight: f64,
}

/// The transform that minimises the weighted squared distances of `first` from `T second`; identity rotation
/// where the points leave it open.
pub(crate) fn fit_rigid(ties: &[Tie]) -> Isometry2<f64> {
    let total: f64 = ties.iter().map(|t| t.weight).sum();
    if total <= 0.0 {
        return Isometry2::identity();
    }
    let mean = |f: fn(&Tie) -> Point2<f64>| {
        ties.iter().fold(Vector2::zeros(), |sum, t| sum + f(t).coords * t.weight) / total
    };
    let (c1, c2) = (mean(|t| t.first), mean(|t| t.second));
    let (mut dot, mut cross) = (0.0, 0.0);
    for t in ties {
        let (a, b) = (t.second.coords - c2, t.first.coords - c1);
        dot += t.weight * a.dot(&b);
        cross += t.weight * a.perp(&b);
    }
    let rotation = UnitComplex::new(cross.atan2(dot));
    Isometry2::from_parts((c1 - rotation * c2).into(), rotation)
}

/// Information of the transform, order `[x, y, θ]`, perturbation on the right, in the frame of map 2.
pub(crate) fn information(ties: &[Tie]) -> Matrix3<f64> {
    ties.iter().fold(Matrix3::zeros(), |sum, t| {
        // T exp(ξ) p moves by R (ρ + θ J p); R drops out of an isotropic weight.
        let (x, y) = (t.second.x, t.second.y);
        sum + t.weight * Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, -y, x, x * x + y * y)
    })
}
